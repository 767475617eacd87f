// Where the machine's links are, from its joints: the cell file's chain, in the frame in which the part is drawn.
import { Matrix4, Vector3 } from "three";
import type { CellFacts, Joint } from "../api/types";

export interface Pose {
  /** Motion of a carrier from the pose at all joints zero, build frame from machine frame at zero. */
  of(carrier: string): Matrix4;
}

function motion(joint: Joint, value: number, isRotary: boolean, point: number[]): Matrix4 {
  const direction = new Vector3(...joint.direction);
  if (!isRotary) return new Matrix4().makeTranslation(direction.multiplyScalar(value));
  const pivot = new Vector3(...(point as [number, number, number]));
  return new Matrix4()
    .makeTranslation(pivot)
    .multiply(new Matrix4().makeRotationAxis(direction, (value * Math.PI) / 180))
    .multiply(new Matrix4().makeTranslation(pivot.clone().negate()));
}

/** Table frame (machine frame at all joints zero) from the build frame, as the workpiece is placed. */
export function tableFromBuild(facts: CellFacts): Matrix4 {
  const { part_origin_mm: at, rotation_deg } = facts.placement;
  return new Matrix4().makeTranslation(...at).multiply(new Matrix4().makeRotationZ((rotation_deg * Math.PI) / 180));
}

/** joints: machine coordinates by axis letter, mm or deg. slide: 0 parked to 1 deployed. */
export function poseOf(facts: CellFacts, joints: Record<string, number>, slide: number): Pose {
  const kinds = new Map(facts.axes.map((axis) => [axis.letter, axis.kind]));
  const motions = new Map<string, Matrix4>([["base", new Matrix4()]]);
  const chain = (all: Joint[]): Matrix4 => {
    let world = new Matrix4();
    for (const joint of all) {
      const point = facts.placement.pivots_mm[joint.axis] ?? joint.point_mm;
      world = world.clone().multiply(motion(joint, joints[joint.axis] ?? 0, kinds.get(joint.axis) === "rotary", point));
      motions.set(joint.axis, world);
    }
    return world;
  };
  const head = chain(facts.kinematics.head);
  const table = chain(facts.kinematics.table);
  const park = new Vector3(...(facts.machine?.parked_offset_mm ?? [0, 0, 0])).multiplyScalar(1 - slide);
  motions.set("spindle", head);
  motions.set("head_slide", head.clone().multiply(new Matrix4().makeTranslation(park)));
  motions.set("table", table);
  const buildFromWorld = tableFromBuild(facts).invert().multiply(table.clone().invert());
  return { of: (carrier) => buildFromWorld.clone().multiply(motions.get(carrier) ?? new Matrix4()) };
}
