'use strict';
(() => {
  const facts = JSON.parse(document.getElementById('data').textContent);
  const $ = (id) => document.getElementById(id);
  const el = (tag, text, attributes = {}) => Object.assign(document.createElement(tag), { textContent: text ?? '' }, attributes);
  const say = (value, unit = '') => {
    if (value === null || value === undefined) return '–';
    const size = Math.abs(value);
    const text = size !== 0 && (size >= 1e5 || size < 1e-3) ? value.toExponential(2) : String(+value.toPrecision(4));
    return unit && unit !== '1' ? `${text} ${unit}` : text;
  };

  // A number and its unit stay on one line.
  const joined = (parts) => parts.filter(Boolean).join('; ').replace(/(\d) (?=(?:%|s|m|m\/s|h|mg|rad|°)(?![\w/]))/g, '$1\u00a0');

  function table(into, caption, columns, rows) {
    if (!rows.length) return;
    into.append(el('h3', caption));
    const body = el('table');
    const head = body.createTHead().insertRow();
    for (const name of columns) head.append(el('th', name, { scope: 'col' }));
    const cells = body.createTBody();
    for (const row of rows) {
      const line = cells.insertRow();
      for (const value of row) line.append(el('td', value));
    }
    const frame = el('div', '', { className: 'scroll', tabIndex: 0 });
    frame.append(body);
    into.append(frame);
  }

  $('title').textContent = facts.title;
  $('about').textContent = facts.summary;
  const runs = facts.runs > 1 ? `${facts.runs} runs (charts and events: the first)` : '1 run';
  $('facts').textContent = [facts.system, facts.source, `seed ${facts.seed}`, runs, `${say(facts.time)} s flown`, `FTLab ${facts.ftlab}`].filter(Boolean).join(' · ');

  const score = facts.score;
  const said = new Set();
  for (const item of score.headline ?? []) {
    const box = el('div');
    const value = el('dd');
    value.append(el('b', say(item.value, item.unit)));
    const told = el('dd', '', { className: 'told' });
    const compared = item.compare_label ? `${item.compare_label} ${say(item.compare, item.unit)}` : '';
    told.append(el('p', joined([item.note, compared])));
    if (item.detail && !said.has(item.detail)) told.append(el('p', joined([item.detail]), { className: 'dim' }));
    said.add(item.detail);
    box.append(el('dt', item.label), value, told);
    $('headline').append(box);
  }
  const first = (delays) => Object.entries(delays).filter(([, delay]) => delay !== null).sort((a, b) => a[1] - b[1]).map(([test, delay]) => `${test} ${say(delay, 's')}`).join(', ') || 'none';
  table($('faults'), 'Faults (delays: medians, from the first epoch in which it acted)', ['fault', 'from', 'to', 'what came of it', 'alarms after', 're-admitted after'],
    (score.faults ?? []).map((f) => [f.label, say(f.start, 's'), f.end === null ? 'to the end' : say(f.end, 's'), f.words, first(f.time_to_alarm), f.readmission ? `${say(f.time_to_readmit, 's')}, in ${f.readmission.words}` : '–']));
  table($('faults'), 'What each fault changed (in the first run)', ['fault', 'first at', 'epochs', 'now'],
    facts.deeds.map(([name, first, epochs, now]) => [name, say(first, 's'), epochs, now]));
  table($('estimators'), 'Estimators (root mean square, worst)', ['estimator', 'position (m)', 'velocity (m/s)', 'attitude (rad)', 'NEES'],
    Object.entries(score.estimators ?? {}).map(([name, e]) => [facts.estimators[name] ?? name, ...['position', 'velocity', 'attitude'].map((q) => `${say(e[q]?.rms)}, ${say(e[q]?.worst)}`), `${say(e.nees)}${e.nees_dof ? ` of ${e.nees_dof}` : ''}`]));
  const between = (low, high) => low === null ? '–' : `${say(low)} to ${say(high)}`;
  table($('tests'), `False alarms: while nothing that concerns the subject was wrong, nor up to ${say(score.recovery, 's')} before`, ['test', 'subject', 'alarms', 'of tests', 'rate', '95 % interval, tests taken as independent', 'in stretches', 'in runs', 'alarms while another faulty sensor entered the test'],
    (score.tests ?? []).filter((t) => t.epochs + t.reached_epochs > 0).map((t) => [t.name, t.subject, t.alarms, t.epochs, say(t.false_alarm_rate), between(t.low, t.high), `${t.stretches}${t.clustered ? ' (clustered: the true interval is wider)' : ''}`, t.runs.words, `${t.reached_alarms} of ${t.reached_epochs} tests`]));
  table($('isolations'), `False isolations: of a subject that nothing was wrong with, nor up to ${say(score.recovery, 's')} before`, ['subject', 'isolations', 'with nothing wrong at all', 'in runs', 'hours in use and sound', 'an hour', '95 % interval', 'when (s)'],
    (score.isolations ?? []).map((i) => [i.label, i.count, i.calm, i.runs.words, say(i.hours), say(i.per_hour), between(i.low, i.high), i.first.map((w) => score.runs > 1 ? `${say(w.time)} (run ${w.run})` : say(w.time)).join(', ') || '–']));

  const COLOURS = { protected: ['#0072b2'], unprotected: ['#5b6168'], statistic: ['#0072b2'], threshold: ['#1d1f21'], local: ['#b35c00', '#00734f', '#9a3f74'], component: ['#0072b2', '#b35c00', '#00734f', '#9a3f74', '#56b4e9', '#8a7400'], weight: ['#0072b2', '#b35c00', '#00734f', '#9a3f74'] };
  const DASHES = { local: ['dash', 'dashdot', 'longdash'], unprotected: ['dot'], threshold: ['longdash'] };
  const marks = [];
  for (const event of facts.events) {
    const line = (color, dash) => marks.push({ type: 'line', xref: 'x', yref: 'paper', x0: event.time, x1: event.time, y0: 0, y1: 1, line: { color, width: 1, dash } });
    if (event.kind === 'subsystem.isolated') line('#9a3f74', 'dash');
    if (event.kind === 'subsystem.readmitted') line('#00734f', 'dot');
  }
  for (const f of score.faults ?? []) marks.push({ type: 'rect', xref: 'x', yref: 'paper', x0: f.start, x1: f.end ?? facts.time, y0: 0, y1: 1, fillcolor: '#d55e00', opacity: 0.08, line: { width: 0 } });
  $('legend').textContent = 'Shaded: a fault is live. Dashed line: isolated. Dotted line: re-admitted. Band: 3 sigma.';

  const last = (column) => (column ?? []).reduce((kept, value) => value ?? kept, null);
  const told = (chart) => chart.traces.filter((trace) => (chart.columns[trace.signal] ?? []).some((value) => value !== null));
  const SHADE = { ok: '#00734f', suspect: '#d8b300', faulted: '#d55e00', isolated: '#9a3f74', off: '#5b6168' };
  // Charts of one moment show the last one, and a plane of signals shows all.
  const MOMENTS = {
    sky: (chart) => ({
      data: [{ type: 'scatterpolar', mode: 'markers+text', textposition: 'middle right', marker: { color: '#0072b2', size: 8 }, text: told(chart).map((t) => t.label),
        r: told(chart).map((t) => 90 - last(chart.columns[t.signal])), theta: told(chart).map((t) => last(chart.columns[t.across])) }],
      layout: { polar: { angularaxis: { direction: 'clockwise', rotation: 90, tickvals: [0, 90, 180, 270], ticktext: ['N', 'E', 'S', 'W'] }, radialaxis: { range: [0, 90], tickvals: [30, 60], ticktext: ['60°', '30°'] } } },
    }),
    bars: (chart) => ({
      data: [{ type: 'bar', x: told(chart).filter((t) => t.role !== 'threshold').map((t) => t.label), y: told(chart).filter((t) => t.role !== 'threshold').map((t) => last(chart.columns[t.signal])), marker: { color: '#0072b2' } }],
      layout: { shapes: told(chart).filter((t) => t.role === 'threshold').flatMap((t) => [1, -1].map((sign) => ({ type: 'line', xref: 'paper', x0: 0, x1: 1, y0: sign * last(chart.columns[t.signal]), y1: sign * last(chart.columns[t.signal]), line: { dash: 'dash', width: 1 } }))) },
    }),
    xy: (chart) => {
      const limit = last(chart.columns[chart.limit]);
      const values = chart.traces.flatMap((t) => [...(chart.columns[t.signal] ?? []), ...(chart.columns[t.across] ?? [])]).filter((v) => v !== null);
      const end = limit === null ? null : Math.min(2.5 * limit, Math.max(1.3 * limit, 1.05 * values.reduce((most, v) => Math.max(most, v), 0)));
      const at = { zero: 0, limit, end };
      const range = end === null ? {} : { range: [0, end] };
      return {
        data: chart.traces.map((t) => ({ mode: 'markers', name: t.label, x: chart.columns[t.across], y: chart.columns[t.signal], marker: { size: 4, color: '#0072b2' } })),
        layout: {
          xaxis: { title: { text: chart.across }, ...range }, yaxis: { title: { text: chart.upward }, ...range },
          shapes: limit === null ? [] : chart.regions.map((r) => ({ type: 'path', layer: 'below', path: `M${r.corners.map(([x, y]) => `${at[x]} ${at[y]}`).join('L')}Z`, fillcolor: SHADE[r.health], opacity: 0.14, line: { width: 0 } })),
          annotations: limit === null ? [] : chart.regions.map((r) => ({ text: r.label, showarrow: false, x: r.corners.reduce((s, [x]) => s + at[x], 0) / r.corners.length, y: r.corners.reduce((s, [, y]) => s + at[y], 0) / r.corners.length })),
        },
      };
    },
  };

  function draw(box, chart) {
    if (MOMENTS[chart.kind]) {
      const { data, layout } = MOMENTS[chart.kind](chart);
      Plotly.newPlot(box, data, {
        margin: { l: 60, r: 12, t: 34, b: 40 }, title: { text: `${chart.title}${chart.kind === 'xy' ? '' : ', at the end'}`, font: { size: 13 }, x: 0, xanchor: 'left' }, font: { family: 'system-ui, sans-serif', size: 11 }, showlegend: false, ...layout,
      }, { responsive: true, displaylogo: false });
      return;
    }
    const used = {};
    const traces = [];
    for (const trace of told(chart)) {
      const nth = (used[trace.role] = (used[trace.role] ?? -1) + 1);
      const colours = COLOURS[trace.role] ?? COLOURS.component;
      const dashes = DASHES[trace.role] ?? ['solid'];
      const color = colours[nth % colours.length];
      if (trace.sigma && chart.columns[trace.sigma]) {
        const three = chart.columns[trace.sigma].map((v) => (v === null ? null : 3 * v));
        const edge = { x: chart.time, mode: 'lines', line: { width: 0 }, hoverinfo: 'skip', showlegend: false };
        traces.push({ ...edge, y: three.map((v) => (v === null ? null : -v)) }, { ...edge, y: three, fill: 'tonexty', fillcolor: `${color}22` });
      }
      traces.push({ x: chart.time, y: chart.columns[trace.signal], name: trace.label, mode: 'lines', stackgroup: chart.stacked ? 'all' : undefined, line: { color, width: trace.role === 'protected' ? 1.8 : 1.1, dash: dashes[nth % dashes.length], shape: chart.levels.length ? 'hv' : 'linear' } });
    }
    const axis = { gridcolor: '#e6e8ea', zerolinecolor: '#d5d8dc' };
    Plotly.newPlot(box, traces, {
      margin: { l: 60, r: 12, t: 30, b: 34 }, title: { text: chart.title, font: { size: 13 }, x: 0, xanchor: 'left' }, font: { family: 'system-ui, sans-serif', size: 11 },
      xaxis: { ...axis, title: { text: 'time, s' } }, yaxis: { ...axis, type: chart.scale, ...(chart.levels.length ? { tickvals: chart.levels.map((_, i) => i), ticktext: chart.levels } : {}), title: { text: chart.unit === '1' ? '' : chart.unit } },
      legend: { orientation: 'h', y: 1.13, x: 1, xanchor: 'right' }, shapes: marks, hovermode: 'x unified',
    }, { responsive: true, displaylogo: false });
  }

  for (const chart of facts.charts) {
    const box = el('div', '', { className: 'chart' });
    box.setAttribute('role', 'img');
    box.setAttribute('aria-label', chart.title);
    if (chart.shown) {
      $('charts').append(box);
      draw(box, chart);
    } else {
      const more = el('details');
      more.append(el('summary', chart.title), box);
      more.addEventListener('toggle', () => { if (more.open && !box.data) draw(box, chart); });
      $('charts').append(more);
    }
  }

  const detail = (d) => Object.entries(d).filter(([, v]) => v !== null && typeof v !== 'object').map(([k, v]) => `${k} ${typeof v === 'number' ? say(v) : v}`).join(', ');
  table($('events'), facts.events_left_out ? `The first ${facts.events.length}; ${facts.events_left_out} more are left out` : `${facts.events.length}`, ['time', 'event', 'subject', 'numbers'], facts.events.map((e) => [say(e.time, 's'), e.kind, e.subject, detail(e.detail)]));
  const text = JSON.stringify(facts.scenario, null, 2);
  $('scenario').textContent = text;
  $('download').href = `data:application/json;charset=utf-8,${encodeURIComponent(text)}`;
})();
