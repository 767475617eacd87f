// Light needs to know which way a surface looks.

/** Normals at the corners (four numbers each) of a surface of facets, weighted by area; as bytes. */
export function normalsOf(positions: Uint16Array, facets: Uint32Array): Int8Array {
  const sums = new Float32Array((positions.length / 4) * 3);
  for (let f = 0; f < facets.length; f += 3) {
    const [i, j, k] = [facets[f]!, facets[f + 1]!, facets[f + 2]!];
    const at = (corner: number, d: number) => positions[4 * corner + d]!;
    const [ux, uy, uz] = [at(j, 0) - at(i, 0), at(j, 1) - at(i, 1), at(j, 2) - at(i, 2)];
    const [vx, vy, vz] = [at(k, 0) - at(i, 0), at(k, 1) - at(i, 1), at(k, 2) - at(i, 2)];
    const [x, y, z] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    for (const corner of [i, j, k]) {
      sums[3 * corner] = sums[3 * corner]! + x;
      sums[3 * corner + 1] = sums[3 * corner + 1]! + y;
      sums[3 * corner + 2] = sums[3 * corner + 2]! + z;
    }
  }
  const normals = new Int8Array((positions.length / 4) * 4);
  for (let k = 0; k < positions.length / 4; k++) {
    const size = 127 / (Math.hypot(sums[3 * k]!, sums[3 * k + 1]!, sums[3 * k + 2]!) || 1);
    for (let d = 0; d < 3; d++) normals[4 * k + d] = sums[3 * k + d]! * size;
  }
  return normals;
}
