// Beads on the graphics card: drawn up to where the path is executed.
import { BufferAttribute, BufferGeometry, Mesh, type MeshMatcapMaterial } from "three";
import type { Beads } from "./beads";

const PAINTED_AT_ONCE = 60_000; // corners: some milliseconds

export class BeadMesh {
  readonly mesh: Mesh<BufferGeometry, MeshMatcapMaterial>;
  readonly bytes: number;

  constructor(
    private readonly beads: Beads,
    material: MeshMatcapMaterial,
  ) {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(beads.positions, 4));
    geometry.setAttribute("normal", new BufferAttribute(beads.normals, 4, true));
    if (material.vertexColors) geometry.setAttribute("color", new BufferAttribute(new Uint8Array(4 * beads.vertexOf.length).fill(255), 4, true));
    geometry.setIndex(new BufferAttribute(beads.index, 1));
    geometry.setDrawRange(0, 0);
    this.mesh = new Mesh(geometry, material);
    this.mesh.frustumCulled = false;
    this.mesh.position.set(...beads.origin);
    this.mesh.scale.setScalar(beads.step);
    this.bytes = beads.bytes + (material.vertexColors ? 4 * beads.vertexOf.length : 0);
  }

  /** Draw the beads of the path's vertices from one to another (inclusive). */
  show(first: number, last: number): void {
    const { cut } = this.beads;
    const end = last < 0 ? 0 : (cut[Math.min(Math.floor(last), cut.length - 1)] ?? 0);
    const start = first <= 0 ? 0 : (cut[Math.min(first, cut.length - 1)] ?? 0);
    this.mesh.geometry.setDrawRange(start, Math.max(0, end - start));
    this.mesh.visible = end > start;
  }

  /** Colour the corners by the vertex of the path that each belongs to, from the corner `first` on, as many as a frame has time for; channels
   * 0 to 255. Returns the corner to go on with, 0 when all are coloured. Only with a material that has colours at its corners. */
  paint(rgb: (vertex: number) => [number, number, number], first: number): number {
    const { vertexOf } = this.beads;
    const known = this.mesh.geometry.getAttribute("color") as BufferAttribute;
    const colours = known.array as Uint8Array;
    const end = Math.min(first + PAINTED_AT_ONCE, vertexOf.length);
    let before = -1;
    let shown: [number, number, number] = [255, 255, 255];
    for (let k = first; k < end; k++) {
      const vertex = vertexOf[k]!;
      if (vertex !== before) {
        before = vertex;
        shown = rgb(vertex);
      }
      colours[4 * k] = shown[0];
      colours[4 * k + 1] = shown[1];
      colours[4 * k + 2] = shown[2];
    }
    known.addUpdateRange(4 * first, 4 * (end - first));
    known.needsUpdate = true;
    return end < vertexOf.length ? end : 0;
  }

  dispose(): void {
    this.mesh.geometry.dispose();
    this.mesh.removeFromParent();
  }
}
