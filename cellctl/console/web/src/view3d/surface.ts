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
        geometry.setAttribute("normal", new BufferAttribute(arrays.normal as Int8Array, 4, true));
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
