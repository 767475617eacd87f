// The finished part, translucent, where the plan puts it.
import { Matrix4, Mesh, MeshStandardMaterial, Scene } from "three";
import { getBytes } from "../api/http";
import { colour } from "../state/theme";
import { geometryOf } from "./stl";

export class Ghost {
  private mesh: Mesh | null = null;
  private readonly material = new MeshStandardMaterial({ transparent: true, opacity: 0.16, depthWrite: false, roughness: 0.9 });
  private aborter = new AbortController();
  private isWanted = true;

  constructor(
    private readonly scene: Scene,
    private readonly changed: () => void,
  ) {
    this.paint();
  }

  paint(): void {
    this.material.color.set(colour("part"));
  }

  show(is: boolean): void {
    this.isWanted = is;
    if (this.mesh) this.mesh.visible = is;
    this.changed();
  }

  /** Load a part; buildFromPart: (4, 4), row by row. A mesh that cannot be read is left out: the passes are the plan. */
  async load(part: string, buildFromPart: number[][]): Promise<void> {
    this.clear();
    const { signal } = this.aborter;
    try {
      const geometry = geometryOf(await getBytes(`/parts/${part}/mesh`, signal));
      if (signal.aborted) return geometry.dispose();
      const mesh = new Mesh(geometry, this.material);
      mesh.applyMatrix4(new Matrix4().fromArray(buildFromPart.flat()).transpose());
      mesh.visible = this.isWanted;
      mesh.renderOrder = 2;
      this.mesh = mesh;
      this.scene.add(mesh);
      this.changed();
    } catch (error) {
      if (!signal.aborted) console.warn(error);
    }
  }

  clear(): void {
    this.aborter.abort();
    this.aborter = new AbortController();
    this.mesh?.removeFromParent();
    this.mesh?.geometry.dispose();
    this.mesh = null;
  }

  dispose(): void {
    this.clear();
    this.material.dispose();
  }
}
