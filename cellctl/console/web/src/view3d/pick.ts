// What is under the pointer: the drawn vertex whose place on the screen is nearest to it.
import { type Camera, Matrix4, type Object3D } from "three";

const REACH_PX = 12;

/** x, y: pointer in pixels of the canvas; first, end: vertices that are drawn; skip: flags that are no piece of a path.
 *  asPieces: the distance is to the piece that ends at a vertex, else to the vertex, and of near ones the foremost is taken. */
export function nearest(
  positions: Uint16Array,
  object: Object3D,
  camera: Camera,
  size: { width: number; height: number },
  pointer: { x: number; y: number },
  options: { first: number; end: number; skip: number; asPieces: boolean },
): number {
  const m = new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse).multiply(object.matrixWorld).elements;
  let found = -1;
  let least = REACH_PX ** 2;
  let depth = Number.POSITIVE_INFINITY;
  let px = 0;
  let py = 0;
  for (let v = options.first; v < options.end; v++) {
    const [x, y, z] = [positions[4 * v]!, positions[4 * v + 1]!, positions[4 * v + 2]!];
    const w = m[3]! * x + m[7]! * y + m[11]! * z + m[15]!;
    const sx = ((m[0]! * x + m[4]! * y + m[8]! * z + m[12]!) / w + 1) * 0.5 * size.width;
    const sy = (1 - (m[1]! * x + m[5]! * y + m[9]! * z + m[13]!) / w) * 0.5 * size.height;
    const is = w > 0 && (!options.asPieces || (v > options.first && (positions[4 * v + 3]! & options.skip) === 0));
    if (is) {
      const square = options.asPieces ? toPiece(pointer.x, pointer.y, px, py, sx, sy) : (pointer.x - sx) ** 2 + (pointer.y - sy) ** 2;
      if (options.asPieces ? square < least : square < REACH_PX ** 2 && w < depth) {
        least = square;
        depth = w;
        found = v;
      }
    }
    px = sx;
    py = sy;
  }
  return found;
}

function toPiece(x: number, y: number, ax: number, ay: number, bx: number, by: number): number {
  const [dx, dy] = [bx - ax, by - ay];
  const length = dx * dx + dy * dy;
  const t = length > 0 ? Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / length)) : 0;
  return (ax + t * dx - x) ** 2 + (ay + t * dy - y) ** 2;
}
