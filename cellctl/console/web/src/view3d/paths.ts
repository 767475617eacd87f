// One drawing of passes as lines: vertices on the card once, one draw call.
import { BufferAttribute, BufferGeometry, Line } from "three";
import type { Made } from "./messages";
import type { Colouring } from "./path_material";
import { PathMaterial } from "./path_material";

export class Paths {
  readonly line: Line<BufferGeometry, PathMaterial>;
  readonly count: number;
  readonly bytes: number;
  readonly times: Float32Array;

  constructor(
    readonly made: Made,
    colouring: Colouring,
  ) {
    const position = made.arrays.position as Uint16Array;
    const values = made.arrays.values as Uint16Array;
    this.count = position.length / 4;
    this.times = new Float32Array(this.count);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(position, 4));
    geometry.setAttribute("values", new BufferAttribute(values, 4));
    geometry.setAttribute("time", new BufferAttribute(this.times, 1));
    this.line = new Line(geometry, new PathMaterial(colouring));
    this.line.frustumCulled = false;
    this.line.position.set(...made.header.origin);
    this.line.scale.setScalar(made.header.step_mm);
    this.bytes = position.byteLength + values.byteLength + this.times.byteLength;
  }

  /** Draw the vertices from one to another (exclusive). */
  range(first: number, end: number): void {
    this.line.geometry.setDrawRange(first, Math.max(0, end - first));
    this.line.visible = end > first;
  }

  /** The times at the vertices have changed. */
  timed(): void {
    this.line.geometry.getAttribute("time").needsUpdate = true;
  }

  /** Place of a vertex, mm, build frame. */
  point(vertex: number, into: number[] = [0, 0, 0]): number[] {
    const position = this.made.arrays.position as Uint16Array;
    const { origin, step_mm } = this.made.header;
    for (let d = 0; d < 3; d++) into[d] = origin[d]! + step_mm * position[4 * vertex + d]!;
    return into;
  }

  dispose(): void {
    this.line.geometry.dispose();
    this.line.material.dispose();
    this.line.removeFromParent();
  }
}
