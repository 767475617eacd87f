// What the service says of estimates, recipes and plans in figures.

export interface Missing {
  file: "cell" | "material";
  name: string;
  field: string;
  unit: string;
}

export interface Cost {
  currency: string;
  machine: number;
  powder: number;
  gas: number;
  total: number;
}

export interface Estimate {
  part_id: string;
  material: string;
  layers: number;
  thickness_mm: [number, number];
  direction: number[];
  pieces: number;
  setups: number;
  build_time_s: number;
  time_range_s: [number, number];
  times_s: Record<string, number>;
  powder_g: number;
  powder_range_g: [number, number];
  mass_g: number;
  milled_mm3: number;
  cost: Cost | null;
  missing: Missing[];
  uncertainty: number;
  basis: string[];
}

export interface Field {
  default?: unknown;
  description?: string;
  type?: string;
  enum?: string[];
  const?: unknown;
  anyOf?: Field[];
  minimum?: number;
  maximum?: number;
  exclusiveMinimum?: number;
}

export interface Schema {
  properties: Record<string, Field>;
}

export interface Window {
  min: number;
  usual: number;
  max: number;
}

export interface MaterialFacts {
  name: string;
  density_g_mm3: number;
  deposition: Record<string, Window | number | null>;
}

export interface LayerFigures {
  index: number;
  subcomponent: number;
  z_top_mm: number;
  direction: number[];
  thickness_mm: number[];
  deposit_mm: number;
  mill_mm: number;
  deposit_s: number;
  mill_s: number;
  link_s: number;
  powder_g: number;
}

export interface ProcessFigures {
  process: string;
  cutter_diameter_mm: number;
  operations: number;
  passes: number;
  length_mm: number;
  time_s: number;
}

export interface PlanFigures {
  part: string;
  material: string;
  layers: LayerFigures[];
  processes: ProcessFigures[];
  totals: Record<string, number>;
  volumes_mm3: Record<string, number>;
}

export interface ProofFigures {
  passed: boolean;
  schema: number;
  reasons: string[];
  deviation: Record<string, number>;
  milled: Record<string, number> | null;
  allowed_mm: number;
  tolerance_mm: number;
  allowed_missing_share: number;
  clearance_mm: number | null;
  thresholds: Record<string, number>;
  duration_s: number;
  histogram: { edges_mm: number[]; counts: number[] } | null;
}
