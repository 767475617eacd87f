// All layers in one drawing: what is under the layer that is looked at, in three draw calls.
import { Group, type MeshMatcapMaterial } from "three";
import { BeadMesh } from "./bead_mesh";
import type { Made } from "./messages";
import type { Colouring } from "./path_material";
import { Paths } from "./paths";
import type { TrackIndex } from "./track";
import { UNITS } from "./flags";

export class Whole {
  readonly group = new Group();
  readonly paths: Paths;
  readonly bytes: number;
  private readonly contours: BeadMesh | null;
  private readonly inside: BeadMesh | null;
  private readonly layers: Int32Array;
  private ranges: Record<"speed" | "power" | "tilt", [number, number]> | null = null;

  constructor(made: Made, colouring: Colouring, material: MeshMatcapMaterial) {
    this.paths = new Paths(made, colouring);
    this.layers = made.arrays.layers as Int32Array;
    this.contours = made.contours?.index.length ? new BeadMesh(made.contours, material) : null;
    this.inside = made.inside?.index.length ? new BeadMesh(made.inside, material) : null;
    this.group.add(this.paths.line);
    for (const beads of [this.contours, this.inside]) if (beads) this.group.add(beads.mesh);
    this.bytes = this.paths.bytes + (this.contours?.bytes ?? 0) + (this.inside?.bytes ?? 0);
  }

  /** Layers before `end`: as lines, or as metal; contours from `milled` on only, since what was milled shows a smooth wall. */
  show(end: number, asMetal: boolean, milled: number, lines: boolean): void {
    const vertex = this.layers[Math.min(Math.max(0, end), this.layers.length - 1)] ?? 0;
    this.paths.range(0, lines ? vertex : 0);
    this.contours?.show(this.layers[Math.min(milled, this.layers.length - 1)] ?? 0, asMetal ? vertex - 1 : -1);
    this.inside?.show(0, asMetal ? vertex - 1 : -1);
  }

  /** Times of whole layers, spread over their vertices. */
  setTimes(track: TrackIndex): void {
    for (const chunk of track.chunks) {
      const first = this.layers[chunk.layer] ?? 0;
      const end = this.layers[chunk.layer + 1] ?? first;
      for (let v = first; v < end; v++) {
        this.paths.times[v] = chunk.time_start_s + ((v - first) / Math.max(1, end - first)) * (chunk.time_end_s - chunk.time_start_s);
      }
    }
    this.paths.timed();
  }

  /** Least and greatest value of a quantity over the plan, without links. */
  rangeOf(quantity: "speed" | "power" | "tilt"): [number, number] {
    this.ranges ??= { speed: this.found(0), power: this.found(1), tilt: this.found(2) };
    return this.ranges[quantity];
  }

  private found(column: 0 | 1 | 2): [number, number] {
    const values = this.paths.made.arrays.values as Uint16Array;
    const position = this.paths.made.arrays.position as Uint16Array;
    let low = 65535;
    let high = 0;
    for (let v = 0; v < this.paths.count; v++) {
      const value = values[4 * v + column]!;
      if (position[4 * v + 3]! & 3 || (column === 1 && value === 0)) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
    return low > high ? [0, 1] : [low * UNITS[column], high * UNITS[column]];
  }

  dispose(): void {
    this.paths.dispose();
    this.contours?.dispose();
    this.inside?.dispose();
    this.group.removeFromParent();
  }
}
