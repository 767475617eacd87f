// The part as the twin built it: triangles of its surface, coloured by how far they are off the part.
import { BufferAttribute, BufferGeometry, Mesh, type Scene } from "three";
import { DEVIATION, stepOf, table } from "./colours";
import type { Loader } from "./loader";
import { metal } from "./metal";

export class Surface {
  private mesh: Mesh | null = null;
  private readonly material = metal({ byCorner: true });
  private aborter = new AbortController();
  private deviation = new Int16Array(0);
  private step = 0.001;
  tolerance = 0;
  state: "none" | "loading" | "here" | "absent" = "none";

  constructor(
    private readonly scene: Scene,
    private readonly loader: Loader,
    private readonly changed: () => void,
  ) {}

  get bytes(): number {
    if (!this.mesh) return 0;
    const { geometry } = this.mesh;
    return ["position", "normal", "color"].reduce((sum, name) => sum + geometry.getAttribute(name).array.byteLength, geometry.index?.array.byteLength ?? 0);
  }

  get object(): Mesh | null {
    return this.mesh;
  }

  /** Range of the colours, mm: twice the tolerance either way, as in the proof's picture. */
  get range(): [number, number] {
    const most = 2 * (this.tolerance || 0.1);
    return [-most, most];
  }

  show(is: boolean): void {
    if (this.mesh) this.mesh.visible = is;
  }

  load(url: string): void {
    if (this.state !== "none") return;
    this.state = "loading";
    this.loader.ask({ kind: "surface", url }, this.aborter.signal).then(
      ({ header, arrays }) => {
        this.tolerance = header.tolerance_mm as number;
        this.step = header.deviation_step_mm as number;
        this.deviation = arrays.deviation as Int16Array<ArrayBuffer>;
        const geometry = new BufferGeometry();
        const positions = arrays.position as Uint16Array;
        geometry.setAttribute("position", new BufferAttribute(positions, 4));
        geometry.setAttribute("color", new BufferAttribute(this.colours(), 4, true));
        geometry.setIndex(new BufferAttribute(arrays.facets as Uint32Array, 1));
        geometry.setAttribute("normal", new BufferAttribute(normalsOf(positions, arrays.facets as Uint32Array), 4, true));
        this.mesh = new Mesh(geometry, this.material);
        this.mesh.frustumCulled = false;
        this.mesh.position.set(...header.origin);
        this.mesh.scale.setScalar(header.step_mm);
        this.scene.add(this.mesh);
        this.state = "here";
        this.changed();
      },
      () => {
        if (!this.aborter.signal.aborted) this.state = "absent";
        this.changed();
      },
    );
  }

  /** Deviation at a corner, mm. */
  at(corner: number): number {
    return (this.deviation[corner] ?? 0) * this.step;
  }

  private colours(): Uint8Array {
    const scale = table(DEVIATION);
    const [low, high] = this.range;
    const found = new Uint8Array(4 * this.deviation.length);
    for (let k = 0; k < this.deviation.length; k++) {
      const row = 4 * stepOf(this.at(k), low, high);
      for (let d = 0; d < 4; d++) found[4 * k + d] = scale[row + d]!;
    }
    return found;
  }

  clear(): void {
    this.aborter.abort();
    this.aborter = new AbortController();
    this.mesh?.geometry.dispose();
    this.mesh?.removeFromParent();
    this.mesh = null;
    this.state = "none";
  }

  dispose(): void {
    this.clear();
    this.material.dispose();
  }
}

/** Normals at the corners, weighted by area; as bytes. */
function normalsOf(positions: Uint16Array, facets: Uint32Array): Int8Array {
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
