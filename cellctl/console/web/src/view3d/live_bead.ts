// The bead that is being laid: from the last vertex that is passed to where the tip is.
import { BufferAttribute, BufferGeometry, Matrix4, Mesh, type MeshMatcapMaterial, Vector3 } from "three";
import { metal } from "./metal";

const CORNERS = 9;

/** A bead of length, width and height 1 along x, upwards z. */
function unit(): BufferGeometry {
  const positions: number[] = [];
  const index: number[] = [];
  for (const x of [0, 1]) {
    for (let k = 0; k < CORNERS; k++) {
      const turn = (Math.PI * k) / (CORNERS - 1);
      positions.push(x, -0.5 * Math.cos(turn), Math.sin(turn));
    }
  }
  for (let k = 0; k + 1 < CORNERS; k++) index.push(k, k + CORNERS, k + 1, k + 1, k + CORNERS, k + CORNERS + 1);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(positions), 3));
  geometry.setIndex(index);
  geometry.computeVertexNormals();
  return geometry;
}

export class LiveBead {
  readonly mesh: Mesh<BufferGeometry, MeshMatcapMaterial>;

  constructor() {
    this.mesh = new Mesh(unit(), metal({ colour: "#ffd9a8" }));
    this.mesh.matrixAutoUpdate = false;
    this.mesh.frustumCulled = false;
    this.mesh.visible = false;
  }

  hide(): void {
    this.mesh.visible = false;
  }

  /** from, to: mm; up: the layer's normal; width, height: mm */
  lay(from: number[], to: number[], up: number[], width: number, height: number): void {
    const start = new Vector3(from[0], from[1], from[2]);
    const along = new Vector3(to[0], to[1], to[2]).sub(start);
    const length = along.length();
    this.mesh.visible = length > 0.01;
    if (!this.mesh.visible) return;
    const high = new Vector3(up[0], up[1], up[2]);
    const side = high.clone().cross(along.clone().divideScalar(length)).normalize();
    this.mesh.matrix.copy(new Matrix4().makeBasis(along, side.multiplyScalar(width), high.multiplyScalar(height)).setPosition(start));
  }

  dispose(): void {
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
    this.mesh.removeFromParent();
  }
}
