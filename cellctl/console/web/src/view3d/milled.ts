// Up to which layer the sides are milled, by the plan.
import type { PlanLayer } from "../api/types";

/** How many layers from the first on have smooth sides when all before `end` is done. 0 where layers are not level: there no height says it. */
export function milledLayers(layers: PlanLayer[], end: number): number {
  if (layers.some((layer) => layer.tilt_deg > 0)) return 0;
  for (let n = Math.min(end, layers.length) - 1; n >= 0; n--) {
    if (layers[n]?.operations.some(({ process }) => process === "mill_side" || process === "mill_scallop")) return n + 1;
  }
  return 0;
}
