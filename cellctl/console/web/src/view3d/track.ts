// A program by time and by line: which layer, which pass, how far along it, and where everything is then.
import { api } from "../api/base";
import { get } from "../api/http";
import type { Vector } from "../api/types";
import { Asking } from "./asking";
import type { Loader } from "./loader";
import type { Made } from "./messages";

/** By what one goes through a program. */
export const STEPS = ["line", "pass", "layer"] as const;
export type Step = (typeof STEPS)[number];

export interface Chunk {
  layer: number;
  first_line: number;
  lines: number;
  time_start_s: number;
  time_end_s: number;
  path_start_mm: number;
}

export interface TrackIndex {
  lines: number;
  duration_s: number;
  axes: string[];
  chunks: Chunk[];
}

/** Where a program is. operation: over the whole plan, -1: none; line: index; fraction: of the line */
export interface Moment {
  line: number;
  fraction: number;
  time: number;
  layer: number;
  operation: number;
  pass: number;
  arc: number;
  kind: number;
  tip: Vector;
  axis: Vector;
  joints: number[];
}

const KEPT_BYTES = 24e6;

/** Last place of a sorted array whose value is at most v. */
export function lastAtMost(values: ArrayLike<number>, v: number, from = 0, to = values.length): number {
  let low = from;
  let high = to;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle]! <= v) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

export class Track {
  private readonly chunks = new Map<number, Made>();
  private readonly asking: Asking;
  private looked = 0; // chunk that was looked for last
  private readonly ends: Float64Array;
  private readonly firsts: Float64Array;

  private constructor(
    readonly index: TrackIndex,
    root: string,
    of: string,
    loader: Loader,
    changed: () => void,
  ) {
    const lines = (n: number) => ({ kind: "lines", url: `${root}/${n}?of=${of}` }) as const;
    const came = (n: number, made: Made) => {
      this.keep(n, made);
      changed();
    };
    this.asking = new Asking(loader, lines, came, changed);
    this.ends = Float64Array.from(index.chunks, (chunk) => chunk.time_end_s);
    this.firsts = Float64Array.from(index.chunks, (chunk) => chunk.first_line);
  }

  /** Raises RequestError. */
  static async of(job: string, sha256: string, loader: Loader, changed: () => void): Promise<Track> {
    const index = await get<TrackIndex>(`/jobs/${job}/program/track?of=${sha256}`);
    return new Track(index, `${api}/jobs/${job}/program/track`, sha256, loader, changed);
  }

  /** Where the program is at a time; null until its layer's lines are here (they are asked for). */
  atTime(time: number): Moment | null {
    const count = this.index.chunks.length;
    const n = Math.min(lastAtMost(this.ends, time) + 1, count - 1);
    const made = this.need((this.looked = n));
    if (!made) return null;
    void this.need(Math.min(n + 1, count - 1));
    const chunk = this.index.chunks[n]!;
    const times = made.arrays.time as Float32Array;
    const local = Math.max(0, time - chunk.time_start_s);
    const row = Math.min(lastAtMost(times, local) + 1, chunk.lines - 1);
    const begin = row > 0 ? times[row - 1]! : 0;
    const span = times[row]! - begin;
    return this.moment(n, made, row, span > 0 ? Math.min(1, (local - begin) / span) : 1);
  }

  /** Where the program is on a line, by where the tip is reported; null until its lines are here. */
  atLine(line: number, tip: Vector): Moment | null {
    const n = this.chunkOf(line);
    const made = this.need((this.looked = n));
    if (!made) return null;
    const row = Math.min(Math.max(0, line - this.index.chunks[n]!.first_line), this.index.chunks[n]!.lines - 1);
    return this.moment(n, made, row, this.along(made, row, tip));
  }

  /** Where the program is at the end of a line, from 0; null until its lines are here. */
  atEnd(line: number): Moment | null {
    const n = this.chunkOf(line);
    const made = this.need((this.looked = n));
    if (!made) return null;
    void this.need(Math.min(n + 1, this.index.chunks.length - 1));
    return this.moment(n, made, Math.min(line - this.index.chunks[n]!.first_line, this.index.chunks[n]!.lines - 1), 1);
  }

  /** The line to which a step leads: the one beside it, the first of the pass or of the layer that follows, or of the one it is in or after. */
  stepFrom(line: number, by: Step, way: 1 | -1): number {
    const n = this.chunkOf(line);
    const { first_line: first, lines } = this.index.chunks[n]!;
    const after = Math.min(first + lines, this.index.lines - 1);
    if (by === "line") return Math.min(Math.max(0, line + way), this.index.lines - 1);
    if (by === "layer") return way > 0 ? after : line > first ? first : (this.index.chunks[n - 1]?.first_line ?? 0);
    const arrays = this.chunks.get(n)?.arrays as Record<"operation" | "pass", Int32Array> | undefined;
    if (!arrays) return line;
    const isFirst = (row: number) => row === 0 || arrays.pass[row] !== arrays.pass[row - 1] || arrays.operation[row] !== arrays.operation[row - 1];
    let row = line - first + way;
    while (row >= 0 && row < lines && !isFirst(row)) row += way;
    return row < lines ? Math.max(0, first + row) : after;
  }

  private chunkOf(line: number): number {
    return Math.max(0, lastAtMost(this.firsts, line));
  }

  /** Lines of a layer, where they are here: for its colours by time. */
  linesOf(layer: number): { made: Made; chunk: Chunk } | null {
    const n = this.index.chunks.findIndex((chunk) => chunk.layer === layer);
    const made = n < 0 ? undefined : this.need(n);
    return made ? { made, chunk: this.index.chunks[n]! } : null;
  }

  /** Whether the lines that were looked for could not be had; they are asked for again by themselves. */
  get isMissing(): boolean {
    return this.asking.hasFailed(this.looked);
  }

  private along(made: Made, row: number, tip: Vector): number {
    const start = this.vector(made, "tip", row - 1);
    const end = this.vector(made, "tip", row);
    let square = 0;
    let done = 0;
    for (let d = 0; d < 3; d++) {
      square += (end[d]! - start[d]!) ** 2;
      done += (end[d]! - start[d]!) * (tip[d]! - start[d]!);
    }
    return square > 1e-9 ? Math.min(1, Math.max(0, done / square)) : 1;
  }

  private vector(made: Made, name: "tip" | "axis", row: number): Vector {
    const before = made.header.before as Record<string, number[]>;
    if (row < 0) return before[name] as Vector;
    const values = made.arrays[name] as Float32Array;
    return [values[3 * row]!, values[3 * row + 1]!, values[3 * row + 2]!];
  }

  private moment(n: number, made: Made, row: number, fraction: number): Moment {
    const chunk = this.index.chunks[n]!;
    const { time, arc, operation, pass, kind, joints } = made.arrays as Record<string, Float32Array>;
    const mix = (a: number, b: number) => a + fraction * (b - a);
    const [t0, t1] = [this.vector(made, "tip", row - 1), this.vector(made, "tip", row)];
    const [a0, a1] = [this.vector(made, "axis", row - 1), this.vector(made, "axis", row)];
    const axes = this.index.axes.length;
    const before = (made.header.before as Record<string, number[]>).joints!;
    const same = row > 0 && operation![row] === operation![row - 1] && pass![row] === pass![row - 1];
    return {
      line: chunk.first_line + row,
      fraction,
      time: chunk.time_start_s + mix(row > 0 ? time![row - 1]! : 0, time![row]!),
      layer: Math.max(0, chunk.layer),
      operation: operation![row]!,
      pass: pass![row]!,
      arc: mix(same ? arc![row - 1]! : 0, arc![row]!),
      kind: kind![row]!,
      tip: t0.map((value, d) => mix(value, t1[d]!)) as Vector,
      axis: a0.map((value, d) => mix(value, a1[d]!)) as Vector,
      joints: Array.from({ length: axes }, (_, d) => mix(row > 0 ? joints![axes * (row - 1) + d]! : before[d]!, joints![axes * row + d]!)),
    };
  }

  private need(n: number): Made | undefined {
    const here = this.chunks.get(n);
    if (here) {
      this.chunks.delete(n); // the newest use stands last
      this.chunks.set(n, here);
      return here;
    }
    this.asking.want(n);
    return undefined;
  }

  private keep(n: number, made: Made): void {
    this.chunks.set(n, made);
    let bytes = 0;
    for (const chunk of this.chunks.values()) bytes += chunk.bytes;
    for (const [old, chunk] of this.chunks) {
      if (bytes <= KEPT_BYTES || old === n) break;
      bytes -= chunk.bytes;
      this.chunks.delete(old);
    }
  }

  dispose(): void {
    this.asking.clear();
    this.chunks.clear();
  }
}
