// Where the machine stands, from a snapshot or from a moment of the program.
import type { Snapshot, Vector } from "../api/types";
import { operations } from "../state/plan";
import type { Stand } from "./head";
import type { Holding } from "./layer";
import type { Moment } from "./track";

/** Null while no job is on the cell: then there is no tip in the part's frame. */
export function standOfSnapshot(snapshot: Snapshot): Stand | null {
  if (!snapshot.job || snapshot.job.outcome) return null;
  return {
    tool: snapshot.cnc.tool,
    isMilling: snapshot.job.operation_kind === "mill",
    tip: snapshot.tip,
    axis: snapshot.tool_axis,
    joints: snapshot.cnc.connected ? snapshot.cnc.machine : null,
    isLit: snapshot.laser.emitting,
  };
}

export function standOfMoment(moment: Moment, axes: string[], tip: Vector, holding: Holding | null): Stand {
  const process = operations.value[moment.operation]?.process ?? "";
  return {
    tool: 0,
    isMilling: process.startsWith("mill"),
    tip,
    axis: moment.axis,
    joints: Object.fromEntries(axes.map((letter, k) => [letter, moment.joints[k] ?? 0])),
    isLit: holding !== null && !holding.isLink && holding.power > 0,
  };
}
