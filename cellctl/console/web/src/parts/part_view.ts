// One part on a stage of its own, with a mark where something was found.
import { BufferGeometry, Mesh, MeshBasicMaterial, MeshStandardMaterial, SphereGeometry } from "three";
import { colour } from "../state/theme";
import { partGeometry } from "../view3d/ghost";
import { Loader } from "../view3d/loader";
import { Stage, type ViewName } from "../view3d/stage";

const MARK_SHARE = 0.02; // of the part's size

export class PartView {
  private readonly stage: Stage;
  private readonly material = new MeshStandardMaterial({ roughness: 0.75, metalness: 0.15 });
  private readonly markMaterial = new MeshBasicMaterial({ depthTest: false, transparent: true, opacity: 0.9 });
  private readonly mark = new Mesh(new SphereGeometry(1, 24, 16), this.markMaterial);
  private part: Mesh<BufferGeometry, MeshStandardMaterial> | null = null;
  private readonly aborter = new AbortController();
  private readonly loader = new Loader();

  /** Raises Error where the browser has no WebGL. */
  constructor(host: HTMLElement) {
    this.stage = new Stage(host);
    this.mark.visible = false;
    this.mark.renderOrder = 3;
    this.stage.scene.add(this.mark);
    this.paint();
  }

  paint(): void {
    this.material.color.set(colour("part"));
    this.markMaterial.color.set(colour("fault"));
    this.stage.paint();
    this.stage.draw();
  }

  /** Raises RequestError. */
  async load(id: string, bounds: number[][]): Promise<void> {
    const [low = [0, 0, 0], high = [1, 1, 1]] = bounds;
    this.stage.setBounds(low, high);
    this.mark.scale.setScalar(MARK_SHARE * Math.hypot(...high.map((value, k) => value - (low[k] ?? 0))));
    const geometry = partGeometry(await this.loader.ask({ kind: "part", url: `/api/v1/parts/${id}/mesh` }, this.aborter.signal));
    this.part = new Mesh(geometry, this.material);
    this.stage.scene.add(this.part);
    this.stage.draw();
  }

  /** Mark a place, mm, or none. */
  point(place: number[] | null): void {
    this.mark.visible = place !== null;
    if (place) this.mark.position.set(place[0] ?? 0, place[1] ?? 0, place[2] ?? 0);
    this.material.transparent = place !== null;
    this.material.opacity = place ? 0.55 : 1;
    this.material.needsUpdate = true;
    this.stage.draw();
  }

  look(name: ViewName): void {
    this.stage.look(name);
  }

  dispose(): void {
    this.aborter.abort();
    this.loader.dispose();
    this.part?.geometry.dispose();
    this.mark.geometry.dispose();
    this.material.dispose();
    this.markMaterial.dispose();
    this.stage.dispose();
  }
}
