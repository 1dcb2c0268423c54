/** Numbers and times as a person reads them. */

/**
 * Three or four significant digits, no exponent where it can be avoided, a true minus sign.
 * @param {number | null | undefined} value
 * @param {number} [digits]
 */
export function number(value, digits = 3) {
  if (value === null || value === undefined || Number.isNaN(value)) return '–';
  if (!Number.isFinite(value)) return value > 0 ? '∞' : '−∞';
  if (value === 0) return '0';
  const size = Math.abs(value);
  let text;
  if (size >= 1e6 || size < 1e-4) text = value.toExponential(digits - 1).replace('e+', 'e');
  else if (size >= 10 ** digits) text = Math.round(value).toString();
  else text = Number(value.toPrecision(digits)).toString();
  return text.replace('-', '−');
}

/** Decimals that give a value of this size three digits; null where it takes an exponent. @param {number} size */
export function places(size) {
  if (size === 0) return 2;
  const decimals = 2 - Math.floor(Math.log10(size));
  return decimals > 6 || size >= 1e6 ? null : Math.max(0, decimals);
}

/**
 * A value for a readout that must not dance: with so many decimals, or with three digits where that is null.
 * @param {number} value
 * @param {number | null} decimals
 */
export function readout(value, decimals) {
  if (!Number.isFinite(value)) return '–';
  if (decimals !== null) return value.toFixed(decimals).replace(/^-(0(?:[.]0+)?)$/, '$1').replace('-', '−');
  const size = Math.abs(value);
  const own = places(size);
  return (own === null ? value.toExponential(2).replace('e+', 'e') : value.toFixed(own)).replace('-', '−');
}

/** The unit as shown: nothing for a pure number. @param {string | null | undefined} unit */
export function unitText(unit) {
  return !unit || unit === '1' ? '' : unit.replace('^2', '²').replace('deg', '°').replace('° ', '°');
}

/** @param {number | null | undefined} value @param {string | null | undefined} unit @param {number} [digits] */
export function quantity(value, unit, digits = 3) {
  const text = number(value, digits);
  const symbol = text === '–' ? '' : unitText(unit);
  if (!symbol) return text;
  return symbol === '°' ? `${text}°` : `${text} ${symbol}`;
}

/**
 * Minutes and seconds, hours where needed.
 * @param {number} seconds
 * @param {number} [decimals]
 */
export function clock(seconds, decimals = 0) {
  const scale = 10 ** decimals;
  const whole = Math.round(Math.max(0, seconds) * scale);
  const s = (whole / scale) % 60;
  const minutes = Math.floor(whole / scale / 60);
  const tail = s.toFixed(decimals).padStart(decimals ? 3 + decimals : 2, '0');
  if (minutes < 60) return `${minutes}:${tail}`;
  return `${Math.floor(minutes / 60)}:${String(minutes % 60).padStart(2, '0')}:${tail}`;
}

/** How many decimals tell two epochs apart. @param {number} period */
export function decimalsOf(period) {
  return period >= 1 ? 0 : period >= 0.1 ? 1 : period >= 0.01 ? 2 : 3;
}

/** A step of 1, 2, 5, 10, 15, 30, 60 ... seconds giving at most `count` ticks. @param {number} span @param {number} count */
export function timeStep(span, count) {
  const steps = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 20, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200];
  return steps.find((step) => span / step <= count) ?? 3600 * Math.ceil(span / 3600 / count);
}

/** Ticks of a time axis. @param {number} from @param {number} to @param {number} count @returns {number[]} */
export function timeTicks(from, to, count) {
  const step = timeStep(to - from, count);
  const ticks = [];
  for (let i = Math.ceil(from / step - 1e-9); i * step <= to + 1e-9; i += 1) ticks.push(i * step);
  return ticks;
}

/** A text in which no line ends between a number and its unit. @param {string} text */
export function kept(text) {
  return text.replace(/(\d) (?=(?:%|°|[a-zµ]{1,4}\/[a-z]{1,4}²?|s|m|h|km|mg|min|rad|arcsec)(?![\w/]))/g, '$1\u00a0');
}

/**
 * Ticks of a time axis that is so many pixels wide, so that no two labels touch; whether a label stands at the very end.
 * @param {number} from
 * @param {number} to
 * @param {number} width [px]
 * @param {number} most
 * @returns {{at: number, text: string, end: boolean}[]}
 */
export function labelledTicks(from, to, width, most) {
  const longest = clock(to, decimalsOf(timeStep(to - from, most))).length;
  const ticks = timeTicks(from, to, Math.max(2, Math.min(most, Math.floor(width / (6.2 * longest + 14)))));
  const decimals = ticks.length > 1 ? decimalsOf(ticks[1] - ticks[0]) : 0;
  return ticks.map((at) => ({ at, text: clock(at, decimals), end: to - at < 0.02 * (to - from) }));
}

/** `main.part` -> `main part`. @param {string} name */
export function words(name) {
  return name.replace(/[._-]+/g, ' ').trim();
}

/** With a capital and a full stop. @param {string} text */
export function sentenced(text) {
  return text && `${capital(text)}${/[.!?]$/.test(text) ? '' : '.'}`;
}

/** @param {string} text */
export function capital(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
