// Binary STL, as the service sends every part.
import { BufferAttribute, BufferGeometry } from "three";

const HEADER = 80;
const FACET = 50; // normal, three corners, two bytes

/** The facets as a geometry with flat normals. Raises RangeError for a file that is cut off. */
export function geometryOf(bytes: ArrayBuffer): BufferGeometry {
  const view = new DataView(bytes);
  const count = view.getUint32(HEADER, true);
  if (bytes.byteLength < HEADER + 4 + count * FACET) throw new RangeError("STL: the file is cut off");
  const points = new Float32Array(count * 9);
  for (let facet = 0; facet < count; facet++) {
    const at = HEADER + 4 + facet * FACET + 12;
    for (let k = 0; k < 9; k++) points[facet * 9 + k] = view.getFloat32(at + 4 * k, true);
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(points, 3));
  geometry.computeVertexNormals();
  return geometry;
}
