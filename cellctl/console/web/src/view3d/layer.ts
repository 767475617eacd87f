// One layer in full: its passes as lines and as beads, its set-points, and where in it a place of the program is.
import { Group, type MeshMatcapMaterial } from "three";
import { BeadMesh } from "./bead_mesh";
import { FIRST, LINK, PROCESS_SHIFT, UNITS } from "./flags";
import type { Made } from "./messages";
import type { Colouring } from "./path_material";
import { Paths } from "./paths";
import { type Chunk, lastAtMost } from "./track";

export interface Operation {
  index: number;
  process: string;
  note: string;
  bead_width_mm: number;
  bead_height_mm: number;
}

/** What holds at one place of a pass. */
export interface Holding {
  operation: number;
  process: string;
  pass: number;
  isLink: boolean;
  speed: number;
  power: number;
  tilt: number;
  powder: number;
  gas: number;
  arc: number;
  time: number | null;
}

export class Layer {
  readonly group = new Group();
  readonly paths: Paths;
  readonly beads: BeadMesh | null;
  readonly bytes: number;
  readonly operations: Operation[];
  private readonly firsts: Int32Array; // first vertex of each pass
  private readonly passesOf: number[]; // first pass of each operation
  private hasTimes = false;
  private painted = ""; // as what the beads are coloured
  private paintedTo = 0; // corner to go on with, 0: all are

  constructor(
    readonly number: number,
    made: Made,
    private readonly colouring: Colouring,
    material: MeshMatcapMaterial,
  ) {
    this.paths = new Paths(made, colouring);
    this.paths.line.renderOrder = 1;
    this.operations = made.header.operations as Operation[];
    const passes = made.arrays.passes as Int32Array;
    this.firsts = Int32Array.from({ length: passes.length / 4 }, (_, k) => passes[4 * k]!);
    this.passesOf = this.operations.map(() => 0);
    for (let k = this.firsts.length - 1; k >= 0; k--) this.passesOf[passes[4 * k + 1]!] = k;
    this.beads = made.beads && made.beads.index.length ? new BeadMesh(made.beads, material) : null;
    this.group.add(this.paths.line);
    if (this.beads) this.group.add(this.beads.mesh);
    this.bytes = this.paths.bytes + (this.beads?.bytes ?? 0);
  }

  /** Vertex, with its fraction, of a place on a pass. operation: in this layer */
  vertexAt(operation: number, pass: number, arc: number): number {
    if (operation < 0) return -1;
    const number = (this.passesOf[operation] ?? 0) + Math.max(0, pass);
    const first = this.firsts[number] ?? this.paths.count;
    const end = this.firsts[number + 1] ?? this.paths.count;
    if (pass < 0) return first - 1;
    const arcs = this.paths.made.arrays.arc as Float32Array;
    const at = Math.max(first, lastAtMost(arcs, arc, first, end));
    if (at + 1 >= end) return at;
    const span = arcs[at + 1]! - arcs[at]!;
    return at + (span > 0 ? Math.min(1, Math.max(0, (arc - arcs[at]!) / span)) : 0);
  }

  /** Place of a vertex with its fraction, mm. */
  pointAt(vertex: number): [number, number, number] {
    const low = Math.max(0, Math.floor(vertex));
    const a = this.paths.point(low);
    if (low + 1 >= this.paths.count || vertex === low) return a as [number, number, number];
    const b = this.paths.point(low + 1);
    return a.map((value, d) => value + (vertex - low) * (b[d]! - value)) as [number, number, number];
  }

  passOf(vertex: number): number {
    return lastAtMost(this.firsts, vertex);
  }

  firstVertexOf(operation: number): number {
    return this.firsts[this.passesOf[operation] ?? 0] ?? 0;
  }

  /** Set-points on the piece that ends at a vertex. */
  holding(vertex: number): Holding {
    const values = this.paths.made.arrays.values as Uint16Array;
    const passes = this.paths.made.arrays.passes as Int32Array;
    const rows = this.paths.made.arrays.rows as Float32Array;
    const number = Math.max(0, this.passOf(vertex));
    const operation = passes[4 * number + 1] ?? 0;
    const at = Math.min(Math.max(0, Math.ceil(vertex)), this.paths.count - 1);
    const value = (k: 0 | 1 | 2 | 3) => values[4 * at + k]! * UNITS[k];
    return {
      operation,
      process: this.operations[operation]?.process ?? "",
      pass: number - (this.passesOf[operation] ?? 0),
      isLink: ((this.paths.made.arrays.position as Uint16Array)[4 * at + 3]! & LINK) !== 0,
      speed: value(0),
      power: value(1),
      tilt: value(2),
      powder: value(3),
      gas: rows[5 * (passes[4 * number + 3] ?? 0) + 4] ?? 0,
      arc: (this.paths.made.arrays.arc as Float32Array)[at]!,
      time: this.hasTimes ? this.paths.times[at]! : null,
    };
  }

  /** Size of the bead at a vertex and where it grows to; null on what lays none. */
  beadAt(vertex: number): { width: number; height: number; up: number[] } | null {
    const passes = this.paths.made.arrays.passes as Int32Array;
    const operation = this.operations[passes[4 * Math.max(0, this.passOf(vertex)) + 1] ?? 0];
    if (!operation || operation.bead_width_mm <= 0) return null;
    const { bottom } = this.paths.made.header.place as { bottom: number[] };
    return { width: operation.bead_width_mm, height: operation.bead_height_mm || operation.bead_width_mm, up: bottom.slice(3) };
  }

  /** Give every vertex its time, from the program's lines of this layer. first: number of its first operation over the plan */
  setTimes(lines: { made: Made; chunk: Chunk } | null, first: number): void {
    if (this.hasTimes || !lines) return;
    const { time, operation, pass, arc } = lines.made.arrays as Record<string, Float32Array>;
    const arcs = this.paths.made.arrays.arc as Float32Array;
    const { times } = this.paths;
    const { time_start_s: start } = lines.chunk;
    for (let row = 0; row < time!.length; row++) {
      if (operation![row]! < first || pass![row]! < 0) continue;
      const number = (this.passesOf[operation![row]! - first] ?? 0) + pass![row]!;
      const end = this.firsts[number + 1] ?? this.paths.count;
      const same = row > 0 && operation![row - 1] === operation![row] && pass![row - 1] === pass![row];
      const from = same ? arc![row - 1]! : 0;
      const [t0, t1] = [row > 0 ? time![row - 1]! : 0, time![row]!];
      let v = Math.max(this.firsts[number] ?? end, lastAtMost(arcs, from - 1e-6, this.firsts[number] ?? end, end) + 1);
      for (; v < end && arcs[v]! <= arc![row]! + 1e-3; v++) {
        const share = arc![row]! > from ? (arcs[v]! - from) / (arc![row]! - from) : 1;
        times[v] = start + t0 + Math.min(1, Math.max(0, share)) * (t1 - t0);
      }
    }
    this.hasTimes = true;
    this.painted = "";
    this.paths.timed();
  }

  /** Colour the beads as the lines are coloured, where that changed; false if the next frame has to go on with it. table: of the scale */
  paintBeads(table: Uint8Array, byProcess: [number, number, number][], key: string): boolean {
    if (!this.beads || (this.painted === key && this.paintedTo === 0)) return true;
    if (this.painted !== key) this.paintedTo = 0;
    this.painted = key;
    const { quantity, range } = this.colouring;
    const position = this.paths.made.arrays.position as Uint16Array;
    const values = this.paths.made.arrays.values as Uint16Array;
    const column = { speed: 0, power: 1, tilt: 2 }[quantity as string];
    const rgb = (vertex: number): [number, number, number] => {
      let v = vertex;
      if (position[4 * v + 3]! & FIRST && v + 1 < this.paths.count) v++;
      if (quantity === "process" || quantity === "deviation") return byProcess[Math.min(position[4 * v + 3]! >> PROCESS_SHIFT, 5)]!;
      const value = column === undefined ? this.paths.times[v]! : values[4 * v + column]! * UNITS[column as 0 | 1 | 2];
      const step = 4 * Math.round(255 * Math.min(1, Math.max(0, (value - range[0]) / Math.max(range[1] - range[0], 1e-6))));
      return [table[step]!, table[step + 1]!, table[step + 2]!];
    };
    this.paintedTo = this.beads.paint(rgb, this.paintedTo);
    return this.paintedTo === 0;
  }

  dispose(): void {
    this.paths.dispose();
    this.beads?.dispose();
    this.group.removeFromParent();
  }
}
