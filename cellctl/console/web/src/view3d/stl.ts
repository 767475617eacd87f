// Binary STL, as the service sends every part.
import type { Drawing } from "./container";

const HEADER = 80;
const FACET = 50; // normal, three corners, two bytes

/** The facets' corners, mm, and at each the normal of its facet as bytes. Raises RangeError for a file that is cut off. */
export function facetsOf(bytes: ArrayBuffer): Drawing {
  const view = new DataView(bytes);
  const count = bytes.byteLength < HEADER + 4 ? 0 : view.getUint32(HEADER, true);
  if (bytes.byteLength < HEADER + 4 + count * FACET) throw new RangeError("STL: the file is cut off");
  const position = new Float32Array(count * 9);
  const normal = new Int8Array(count * 12);
  for (let facet = 0; facet < count; facet++) {
    const at = HEADER + 4 + facet * FACET + 12;
    for (let k = 0; k < 9; k++) position[facet * 9 + k] = view.getFloat32(at + 4 * k, true);
    const turned = normalOf(position, facet * 9, facet * 9 + 3, facet * 9 + 6);
    for (let corner = 0; corner < 3; corner++) normal.set(turned, facet * 12 + corner * 4);
  }
  return { header: { kind: "part", origin: [0, 0, 0], step_mm: 1 }, arrays: { position, normal } };
}

/** Normal of three corners (places of their x in the array), as bytes. */
function normalOf(p: Float32Array, i: number, j: number, k: number): [number, number, number] {
  const [ux, uy, uz] = [p[j]! - p[i]!, p[j + 1]! - p[i + 1]!, p[j + 2]! - p[i + 2]!];
  const [vx, vy, vz] = [p[k]! - p[i]!, p[k + 1]! - p[i + 1]!, p[k + 2]! - p[i + 2]!];
  const [x, y, z] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
  const size = 127 / (Math.hypot(x, y, z) || 1);
  return [x * size, y * size, z * size];
}
