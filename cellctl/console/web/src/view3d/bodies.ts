// The bodies of the cell file as meshes: nozzle and head, flutes, shank and holder, plate and clamps, and what the file draws of the machine.
import { BoxGeometry, BufferGeometry, CylinderGeometry, LatheGeometry, Matrix4, Quaternion, Vector2, Vector3 } from "three";
import type { CellFacts, Solid, Tool } from "../api/types";

export interface Body {
  name: string;
  geometry: BufferGeometry;
  kind: "work" | "head" | "machine"; // what touches the part, what carries it, everything else
}

const ROUND = 40;
const BALL_STEPS = 10;

/** A frustum that stands on z = low, along z. */
function frustum(low: number, high: number, lower: number, upper: number): BufferGeometry {
  const made = new CylinderGeometry(upper / 2, lower / 2, Math.max(high - low, 1e-3), ROUND);
  return made.rotateX(Math.PI / 2).translate(0, 0, (low + high) / 2);
}

/** A cutter's end whose corners are rounded; a ball where the corner is the radius. */
function rounded(radius: number, corner: number, length: number): BufferGeometry {
  const profile = Array.from({ length: BALL_STEPS + 1 }, (_, k) => {
    const angle = (Math.PI / 2) * (k / BALL_STEPS);
    return new Vector2(radius - corner + corner * Math.sin(angle), corner - corner * Math.cos(angle));
  });
  return new LatheGeometry([new Vector2(0, 0), ...profile, new Vector2(radius, length)], ROUND).rotateX(Math.PI / 2);
}

/** A tool from its tip upwards, z into the head; as the twin's collision watch has it. */
export function toolBodies(tool: Tool): Body[] {
  const gauge = -tool.tip_mm[2];
  if (tool.kind === "deposition") {
    const { standoff_mm: off, end_diameter_mm: end, cone_length_mm: cone, body_length_mm: body } = tool.nozzle;
    return [
      { name: "nozzle", kind: "work", geometry: frustum(off, off + cone, end, tool.holder_diameter_mm) },
      { name: "head body", kind: "head", geometry: frustum(off + cone, off + cone + body, tool.holder_diameter_mm, tool.holder_diameter_mm) },
    ];
  }
  const wanted = tool.stickout_mm ?? tool.flute_length_mm + tool.diameter_mm;
  const out = gauge > 0 ? Math.min(wanted, gauge) : wanted;
  const flutes = Math.min(tool.flute_length_mm || out, out);
  const shank = tool.shank_diameter_mm ?? tool.diameter_mm;
  const radius = tool.diameter_mm / 2;
  const end = tool.corner_radius_mm > 0 ? rounded(radius, tool.corner_radius_mm, flutes) : frustum(0, flutes, tool.diameter_mm, tool.diameter_mm);
  const bodies: Body[] = [{ name: "flutes", kind: "work", geometry: end }];
  if (out > flutes) bodies.push({ name: "shank", kind: "work", geometry: frustum(flutes, out, shank, shank) });
  if (gauge > out) bodies.push({ name: "holder", kind: "head", geometry: frustum(out, gauge, tool.holder_diameter_mm, tool.holder_diameter_mm) });
  return bodies;
}

function turned(solid: Solid): Matrix4 {
  const [a, b, c] = solid.turn_deg.map((degrees) => (degrees * Math.PI) / 180) as [number, number, number];
  return new Matrix4().makeRotationZ(c).multiply(new Matrix4().makeRotationY(b)).multiply(new Matrix4().makeRotationX(a));
}

/** A solid of the cell file in the machine frame at all joints zero; null for an STL, whose file the page does not have. */
export function solidGeometry(solid: Solid): BufferGeometry | null {
  const place = new Matrix4().makeTranslation(...solid.at_mm);
  if (solid.shape === "box" && solid.size_mm) return new BoxGeometry(...solid.size_mm).applyMatrix4(place.multiply(turned(solid)));
  if (solid.shape === "stl" || !solid.diameter_mm || !solid.length_mm) return null;
  const upright = new Matrix4().makeRotationFromQuaternion(new Quaternion().setFromUnitVectors(new Vector3(0, 0, 1), new Vector3(...solid.axis)));
  return frustum(0, solid.length_mm, solid.diameter_mm, solid.end_diameter_mm ?? solid.diameter_mm).applyMatrix4(place.multiply(upright));
}

const EDGES: Record<number, [number, number][]> = {
  0: [],
  2: [[1, 0], [-1, 0]],
  4: [[1, 0], [0, 1], [-1, 0], [0, -1]],
};

/** Plate and clamps in the table frame. */
export function plateBodies(facts: CellFacts): { name: string; geometry: BufferGeometry }[] {
  const { size_mm: size, top_mm: top } = facts.plate;
  const bodies = [{ name: "plate", geometry: new BoxGeometry(...size).translate(top[0], top[1], top[2] - size[2] / 2) as BufferGeometry }];
  const clamps = facts.machine?.clamps;
  if (!clamps) return bodies;
  const deep = clamps.overlap_mm + clamps.outside_mm;
  const high = clamps.above_mm + size[2];
  const out = (clamps.outside_mm - clamps.overlap_mm) / 2;
  for (const [x, y] of EDGES[clamps.count] ?? []) {
    const edge = (Math.abs(x) * size[0] + Math.abs(y) * size[1]) / 2;
    const box: [number, number, number] = x ? [deep, clamps.width_mm, high] : [clamps.width_mm, deep, high];
    bodies.push({
      name: "clamp",
      geometry: new BoxGeometry(...box).translate(top[0] + x * (edge + out), top[1] + y * (edge + out), top[2] + high / 2 - size[2]),
    });
  }
  return bodies;
}
