// What the service says: the JSON of REST and of the live feed, under the names that it uses.

export interface Lines {
  sent: number;
  acknowledged: number;
  executing: number;
  executed: number;
  total: number;
}

export interface LaserView {
  connected: boolean;
  age_s: number;
  enabled: boolean;
  permitted: boolean;
  emitting: boolean;
  power_setpoint_w: number;
  power_readback_w: number;
  faults: string[];
  interlocks: string[];
}

export interface FeederView {
  connected: boolean;
  age_s: number;
  rate_setpoint_g_min: number;
  rate_readback_g_min: number;
  carrier_gas_setpoint_l_min: number;
  carrier_gas_readback_l_min: number;
  shield_gas_setpoint_l_min: number;
  shield_gas_readback_l_min: number;
  hopper_fraction: number;
  faults: string[];
}

export interface IoView {
  connected: boolean;
  age_s: number;
  estop_ok: boolean;
  door_closed: boolean;
  chiller_ok: boolean;
  gas_pressure_ok: boolean;
  fume_extraction_ok: boolean;
  head_deployed: boolean;
  head_parked: boolean;
}

export interface CncView {
  connected: boolean;
  age_s: number;
  firmware: string;
  state: string;
  machine: Record<string, number>;
  work: Record<string, number>;
  feed_mm_min: number;
  spindle_rpm: number;
  tool: number;
  planner_free: number;
  rx_free: number;
  feed_override: number;
  planner_fill_percent: number | null;
  rx_fill_percent: number | null;
}

export interface OverridesView {
  feed_percent: number;
  feed_min: number;
  feed_max: number;
  laser_percent: number;
  laser_min: number;
  laser_max: number;
  laser_window_w: [number, number];
  powder_percent: number;
  powder_min: number;
  powder_max: number;
  powder_window_g_min: [number, number];
}

export interface Permissive {
  name: string;
  ok: boolean;
  why: string;
  level: string;
  age_s: number;
  stale_s: number;
}

export interface Alarm {
  id: number;
  at: number;
  code: string;
  cause: string;
  remedy: string;
  acknowledged_by: string;
  acknowledged_at: number;
}

/** One alarm of an incident. line, layer: where the job was, counted from 0; null: not known. */
export interface AlarmTold {
  seq: number;
  at: number;
  code: string;
  cause: string;
  remedy: string;
  line: number | null;
  layer: number | null;
  instead_of: string[];
  acknowledged_by: string;
  acknowledged_at: number | null;
}

/** What was latched between two resets; ended_at null: it is latched. */
export interface Incident {
  id: number;
  at: number;
  ended_at: number | null;
  duration_s: number;
  job: string;
  job_name: string;
  first: AlarmTold;
  followed: AlarmTold[];
  reset_by: string;
  because: string;
}

/** Channels in buckets of time; samples 0: a gap. */
export interface TrendsDocument {
  from_at: number;
  to_at: number;
  step_s: number;
  made_of_s: number;
  at: number[];
  samples: number[];
  series: Record<string, { min: (number | null)[]; max: (number | null)[]; mean: (number | null)[] }>;
}

export interface TrendMark {
  seq: number;
  at: number;
  kind: "alarm" | "hold" | "reset" | "acknowledge" | "job" | "layer";
  text: string;
  job: string;
  code: string;
  layer: number | null;
}

export interface TrendMarks {
  items: TrendMark[];
  more: boolean;
}

export interface Control {
  holder: string;
  client: string;
  since: number;
  seen_at: number;
  absent: boolean;
}

export interface JobView {
  id: string;
  name: string;
  layer: number;
  layers: number;
  operation: number;
  operation_kind: string;
  progress: number;
  elapsed_s: number;
  remaining_s: number;
  outcome: string;
  arc_mm: number;
}

export interface TickView {
  count: number;
  missed: number;
  jitter_p99_ms: number;
  scheduler: string;
  longest_ms: number;
  worst_ms: number;
}

export type Vector = [number, number, number];

export interface Snapshot {
  seq: number;
  at: number;
  cell: string;
  mode: string;
  state: string;
  execution: string;
  because: string;
  waiting: string;
  tip: Vector;
  tool_axis: Vector;
  tip_speed_mm_s: number;
  lines: Lines;
  laser: LaserView;
  feeder: FeederView;
  io: IoView;
  cnc: CncView;
  job: JobView | null;
  permissives: Permissive[];
  alarms: Alarm[];
  tick: TickView;
  control: Control | null;
  table: { disturbed_at: number; because: string };
  overrides: OverridesView;
  hand: { has_pilot: boolean; pilot: boolean; pilot_left_s: number; flow_left_s: number; places: string[] };
  position: string;
}

export interface CellEvent {
  seq: number;
  at: number;
  kind: string;
  text: string;
  job: string;
  data: Record<string, unknown>;
}

export type Role = "viewer" | "operator" | "engineer" | "admin";

export type Scope = "read" | "jobs" | "cell" | "admin";

export interface Session {
  name: string;
  role: Role;
  scopes: Scope[];
  is_user: boolean;
  csrf: string;
  stop_url: string;
}

export interface Finding {
  kind: string;
  count: number;
  place_mm: number[] | null;
  mended: boolean;
  volume_change_mm3: number;
  text: string;
}

export interface Part {
  id: string;
  name: string;
  units: "mm" | "inch";
  bytes: number;
  bbox_mm: number[][];
  facets: number;
  volume_mm3: number;
  findings: Finding[];
}

export interface Problem {
  title: string;
  detail: string;
  hint?: string;
  status?: number;
}

export interface Job {
  id: string;
  name: string;
  part_id: string;
  state: string;
  why: string;
  material: string;
  cell: string;
  recipe: Record<string, unknown>;
  created_at: number;
  created_by: string;
  error: Problem | null;
  proof: Record<string, unknown> | null;
  stage: string;
  progress: number;
  layers: number;
  lines_executed: number;
  lines_total: number;
  duration_s: number;
  approved_by: string;
  approve_because: string;
  override_reason: string;
  table_clear: boolean;
  continues_job: string | null;
  resumption: Record<string, number> | null;
  plan_sha256: string | null;
  program_sha256: string | null;
  proof_sha256: string | null;
  timestamps: Record<string, number>;
  waits_for: Wait[];
  after: { job: string; name: string; state: string; until: string; met: boolean }[];
  not_before: number | null;
  priority: number;
  rank: number;
  tags: string[];
  made_from: string | null;
  made_how: string;
  changes: Change[];
  cleared_at: number | null;
}

/** One thing that a job waits for. blocked: it will not come about by itself */
export interface Wait {
  kind: string;
  text: string;
  job: string | null;
  until: string | null;
  at: number | null;
  blocked: boolean;
}

/** A field of a recipe that differs. */
export interface Change {
  field: string;
  before: unknown;
  after: unknown;
}

/** A queue in its order. version: of the order, given to a move */
export interface Queue {
  version: number;
  length: number;
  first: number;
  items: Job[];
  next: string | null;
}

/** What lies on the cell's table. */
export interface TableState {
  job: string | null;
  name: string;
  state: string;
  cleared_at: number | null;
  cleared_by: string;
  next: string | null;
  next_name: string;
}

export interface JobStep {
  at: number;
  left: string;
  state: string;
  why: string;
  who: string;
  lasted_s: number | null;
}

export interface JobNote {
  seq: number;
  at: number;
  who: string;
  text: string;
}

export interface JobAttachment {
  id: string;
  at: number;
  who: string;
  name: string;
  bytes: number;
  is_image: boolean;
}

/** A place on a program. known_by: "tick" or "sample" */
export interface Standpoint {
  line: number;
  fraction: number;
  layer: number;
  operation: number;
  process: string;
  pass: number;
  arc_mm: number;
  path_mm: number;
  tip_mm: number[];
  known_by: string;
  known_by_text: string;
  text: string;
}

/** Where metal ended in a job that was interrupted, and what one may go on from. */
export interface ResumptionPoint {
  job: string;
  possible: boolean;
  why_not: string;
  metal_end: Standpoint | null;
  lines_executed: number;
  lines_total: number;
  layers: number;
  choices: { layer: number; operation: number; process: string }[];
  notes: string[];
  continues_job: string | null;
  continued_by: string[];
}

/** The begin of a program. head_lines: those generated for the joint */
export interface ProgramHead {
  lines: string[];
  head_lines: number;
  lines_total: number;
}

/** A cell of the house. age_s: since its service was heard, when this was read */
export interface FleetCell {
  cell: string;
  here: boolean;
  path: string;
  url: string;
  state: string;
  because: string;
  job: { id: string; name: string; remaining_s: number | null } | null;
  alarms: number;
  queued: number;
  age_s: number;
  heard: "living" | "silent" | "dead";
  software: string;
}

export interface Fleet {
  shared: boolean;
  here: string;
  unassigned: number;
  cells: FleetCell[];
}

export interface Page<T> {
  items: T[];
  next: string | null;
}

export interface PlanOperation {
  index: number;
  process: string;
  passes: number;
  length_mm: number;
}

/** Where a layer lies, mm, build frame. Heights say it only where tilt_deg is 0; bottom, top: point and normal of its planes. */
export interface LayerPlace {
  index: number;
  z_bottom: number;
  z_top: number;
  bottom: number[];
  top: number[];
  tilt_deg: number;
  thickness_mm: number[];
  subcomponent: number;
  overlap_mm2: number;
  overhang_mm2: number;
}

export interface PlanLayer extends LayerPlace {
  operations: PlanOperation[];
}

export interface Subcomponent {
  name: string;
  parent: number; // number of the piece that it stands on, -1: the plate
  setup: number;
  layers: [number, number]; // first, and one past the last
  thickness_mm: number[];
  volume_mm3: number;
  joint_mm2: number;
  overhang_mm2: number;
  unsupported_mm: number;
  support_mm3: number;
  why: string[];
}

export interface Setup {
  direction: number[];
  turn: string;
  subcomponents: number[];
}

export interface Candidate {
  name: string;
  subcomponents: number;
  setups: number;
  overhang_mm2: number | null;
  time_s: number | null;
  score: number | null;
  buildable: number | null;
  chosen: boolean;
  note: string;
}

export interface Plan {
  subcomponents: Subcomponent[];
  setups: Setup[];
  candidates: Candidate[];
  part: string;
  layers: PlanLayer[];
  bounds: number[][];
  build_from_part: number[][];
  tolerance_mm: number;
  findings: string[];
  volumes: Record<string, number>;
}

export interface ProofFinding {
  kind: string;
  text: string;
  line: number;
  layer: number;
  operation: number;
  count: number;
  severity: "error" | "warning";
  at_mm: [number, number, number] | null;
  depth_mm: number;
  help: string;
}

export interface ProofDocument {
  schema: number;
  passed: boolean;
  reasons: string[];
  findings: ProofFinding[];
}

export interface Tool {
  number: number;
  name: string;
  kind: string;
  diameter_mm: number;
  holder_diameter_mm: number;
  flute_length_mm: number;
  corner_radius_mm: number;
  shank_diameter_mm: number | null;
  stickout_mm: number | null;
  tip_mm: Vector;
  nozzle: { standoff_mm: number; end_diameter_mm: number; cone_length_mm: number; body_length_mm: number };
}

export interface Joint {
  axis: string;
  direction: Vector;
  point_mm: Vector;
}

/** A body of the machine, machine frame at all joints zero. carrier: what moves it */
export interface Solid {
  name: string;
  carrier: string;
  shape: "box" | "cylinder" | "cone" | "stl";
  at_mm: Vector;
  size_mm: Vector | null;
  diameter_mm: number | null;
  end_diameter_mm: number | null;
  length_mm: number | null;
  axis: Vector;
  turn_deg: Vector;
}

export interface MachineFacts {
  solids: Solid[];
  parked_offset_mm: Vector;
  clamps: { count: number; width_mm: number; overlap_mm: number; outside_mm: number; above_mm: number };
}

export interface CellFacts {
  axes: { letter: string; kind: "linear" | "rotary"; min: number; max: number; max_velocity: number }[];
  tools: Tool[];
  kinematics: { table: Joint[]; head: Joint[] };
  placement: { part_origin_mm: Vector; rotation_deg: number; pivots_mm: Record<string, Vector> };
  plate: { size_mm: Vector; top_mm: Vector };
  machine: MachineFacts | null;
}

export type LiveMessage =
  | { type: "snapshot"; snapshot: Snapshot }
  | { type: "event"; event: CellEvent }
  | { type: "job"; job: Job };
