/** What travels between server and page. The server's OpenAPI document is the authority; these are its words for the editor. */

export type Health = "ok" | "suspect" | "isolated" | "off" | "faulted";

export interface KindInfo { label: string; sentence: string; unit: string | null; parameters: string[] }
export interface Channel {
  name: string; label: string; unit: string; sensor: string; group: string; kinds: string[]; typical: number;
  faults: Record<string, KindInfo>;
}
export interface Subsystem { name: string; label: string; isolable: boolean }
export interface Test { name: string; label: string; subjects: string[]; dof: string; source: string; unit: string; alarm_when: "above" | "below"; probability: "exact" | "bounded" | "approximate"; probability_note: string }
export interface Signal { name: string; label: string; unit: string; group: string; factor: number }
export type Role = "protected" | "local" | "unprotected" | "statistic" | "threshold" | "component" | "weight";
export interface Trace {
  signal: string; label: string; role: Role; sigma: string | null; across: string | null; code: string | null; item: string | null;
}
export interface Region { label: string; meaning: string; health: Health; corners: ["zero" | "limit" | "end", "zero" | "limit" | "end"][] }
export interface Chart {
  id: string; title: string; unit: string; group: string; kind: "time" | "xy" | "sky" | "bars"; scale: "linear" | "log"; stacked: boolean;
  levels: string[]; across: string; upward: string; limit: string | null; regions: Region[]; traces: Trace[]; shown: boolean;
}
export interface Block {
  id: string; label: string; kind: string; x: number; y: number; width: number; height: number;
  sensor: string | null; subsystem: string | null; settings: string[];
}
export interface Wire { source: string; target: string; carries: string | null }
export interface SceneItem { id: string; label: string; kind: string; frame: string; picture: string; family: string; channel: string | null }
export interface Schema {
  type?: string; title?: string; description?: string; default?: unknown; enum?: unknown[]; const?: unknown; unit?: string;
  minimum?: number; maximum?: number; exclusiveMinimum?: number; exclusiveMaximum?: number; multipleOf?: number;
  properties?: Record<string, Schema>; anyOf?: Schema[]; allOf?: Schema[]; $ref?: string; $defs?: Record<string, Schema>; items?: Schema;
  prefixItems?: Schema[]; source?: string;
}
export interface IndicatorMap { label: string; unit: string; low: number; high: number; bands: { start: number; end: number; label: string }[] }
export interface Indicator {
  id: string; label: string; value: number | null; unit: string; ideal: number | null; better: "higher" | "lower" | null; field: string | null;
  note: string; map: IndicatorMap | null;
}
export interface SystemDescription {
  id: string; title: string; summary: string; source: string; epoch: number;
  channels: Channel[]; subsystems: Subsystem[]; estimators: Record<string, string>; tests: Test[]; signals: Signal[]; charts: Chart[];
  blocks: Block[]; wires: Wire[]; scene: SceneItem[]; settings_schema: Schema; parameters_schema: Schema; fault_schema: Schema;
}
export interface Scenario { id: string; title: string; summary: string; hint: string; system: string; duration: number; source?: string }
export interface Clock { state: "paused" | "running" | "advancing" | "finished" | "failed"; time: number; epoch: number; period: number; speed: number | "max"; duration: number; reason?: string | null }
export interface Fault {
  id: string; channel: string; kind: string; magnitude: number; unit: string | null; start: number; end: number | null;
  state: "armed" | "active" | "ended"; acting: boolean; acted_epochs: number; silent_because: string | null;
}
export interface SubsystemState { enabled: boolean; used: boolean; health: Health }
export interface Experiment {
  id: string; title: string; system: string; seed: number; scenario: { id: string; title: string; hint: string };
  clock: Clock; faults: Fault[]; subsystems: Record<string, SubsystemState>; settings: Record<string, unknown>;
  unavailable: Record<string, string>; not_in_view: string[]; idle_settings: Record<string, string>;
  parent: string | null; ghost_of: string | null; watchers: number; spare: boolean;
}
export interface Event { index: number; time: number; run: number; kind: string; subject: string; detail: Record<string, any> }
export interface BlockView { health: Health; text: string }
export interface ItemView { vector: [number, number, number] | null; rotation?: [number, number, number, number] | null; health: Health; visible: boolean }
export interface View { time: number; blocks: Record<string, BlockView>; items: Record<string, ItemView> }
export interface HeadlineItem { label: string; value: number | null; unit: string; note?: string; detail?: string; compare_label: string | null; compare: number | null }
export interface Score { headline: HeadlineItem[] }
export interface Series { time: number[]; signals: Record<string, (number | null)[]> }
export interface LogLimits { observation_bytes: number; navigation_bytes: number; epochs: number; noise_floor: number; least_noise_floor: number; largest_noise_floor: number }
export interface Call { method: string; path: string; body?: unknown; status: number | null; ms: number; at: number }

/** A stretch of time in which something was so: a fault live, a test alarmed, a subsystem isolated. */
export interface Span { row: "injected" | "alarmed" | "isolated"; key: string; label: string; start: number; end: number | null; index: number }
/** One thing the operator did. */
export interface Point { time: number; label: string; index: number }

export interface Notice { tone: "error" | "warning" | "info"; text: string; action?: { label: string; run: () => void }; /** Stays until it is dismissed. */ sticky?: boolean; /** Is to be copied as it stands. */ verbatim?: boolean }

export interface State {
  scenarios: Scenario[];
  description: SystemDescription | null;
  experiment: Experiment | null;
  relatives: Experiment[];
  events: Event[];
  now: number;
  view: View | null;
  pastView: View | null;
  cursor: number | null;
  hover: number | null;
  zoom: [number, number] | null;
  follow: number | null;
  shown: string[];
  ghost: Experiment | null;
  score: Score | null;
  connection: "idle" | "connecting" | "open" | "lost" | "gone";
  theme: "dark" | "light";
  notice: Notice | null;
  /** Why there is no room for an experiment of this page, and how to ask again. */
  full: { text: string; again: () => Promise<unknown> } | null;
  welcome: boolean;
  prefill: { channel: string } | null;
  busy: string | null;
  /** The scene is at full size. */
  large: boolean;
  /** Which of the system's pictures the scene shows; empty, or one that it has not: the first. */
  picture: string;
  /** Seconds of flight a second, as measured; null while that cannot be told. */
  rate: number | null;
}

declare global {
  interface Window { Plotly?: { react(el: HTMLElement, data: object[], layout: object, config?: object): Promise<unknown>; purge(el: HTMLElement): void } }
}
