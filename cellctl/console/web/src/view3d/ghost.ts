// The finished part where the plan puts it: translucent as what it shall become, or smooth metal up to where it is milled.
import { BufferAttribute, BufferGeometry, DoubleSide, Matrix4, Mesh, MeshStandardMaterial, Plane, type Scene, Vector3 } from "three";
import { colour } from "../state/theme";
import type { Loader } from "./loader";
import type { Made } from "./messages";
import { metal } from "./metal";

export class Ghost {
  private mesh: Mesh | null = null;
  private wall: Mesh | null = null;
  private readonly material = new MeshStandardMaterial({ transparent: true, opacity: 0.13, depthWrite: false, roughness: 0.9 });
  private readonly top = new Plane(new Vector3(0, 0, -1), 0);
  private readonly milled = metal({ colour: "#dfe6ec" });
  private aborter = new AbortController();
  private isWanted = true;

  constructor(
    private readonly scene: Scene,
    private readonly loader: Loader,
    private readonly changed: () => void,
  ) {
    this.milled.clippingPlanes = [this.top];
    this.milled.side = DoubleSide;
    this.paint();
  }

  paint(): void {
    this.material.color.set(colour("part"));
  }

  show(is: boolean): void {
    this.isWanted = is;
    if (this.mesh) this.mesh.visible = is;
  }

  /** The part's own surface up to a height, mm, as metal; null: none of it. */
  showMilled(height: number | null): void {
    if (height !== null) this.top.constant = height;
    if (this.wall) this.wall.visible = height !== null;
  }

  /** Load a part; buildFromPart: (4, 4), row by row. A mesh that cannot be read is left out: the passes are the plan. */
  async load(part: string, buildFromPart: number[][]): Promise<void> {
    this.clear();
    const { signal } = this.aborter;
    try {
      const geometry = partGeometry(await this.loader.ask({ kind: "part", url: `/api/v1/parts/${part}/mesh` }, signal));
      const place = new Matrix4().fromArray(buildFromPart.flat()).transpose();
      this.mesh = new Mesh(geometry, this.material);
      this.mesh.visible = this.isWanted;
      this.mesh.renderOrder = 2;
      this.wall = new Mesh(geometry, this.milled);
      this.wall.visible = false;
      for (const mesh of [this.mesh, this.wall]) {
        mesh.matrixAutoUpdate = false;
        mesh.matrix.copy(place);
      }
      this.scene.add(this.mesh, this.wall);
      this.changed();
    } catch (error) {
      if (!signal.aborted) console.warn(error);
    }
  }

  clear(): void {
    this.aborter.abort();
    this.aborter = new AbortController();
    this.mesh?.geometry.dispose();
    this.mesh?.removeFromParent();
    this.wall?.removeFromParent();
    this.mesh = this.wall = null;
  }

  dispose(): void {
    this.clear();
    this.material.dispose();
    this.milled.dispose();
  }
}

/** The facets of a part as the worker made them. */
export function partGeometry({ arrays }: Made): BufferGeometry {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(arrays.position as Float32Array, 3));
  geometry.setAttribute("normal", new BufferAttribute(arrays.normal as Int8Array, 4, true));
  return geometry;
}
