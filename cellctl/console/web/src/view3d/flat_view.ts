// A layer drawn flat, seen against the direction in which it grows, where the browser has no WebGL.
import { api } from "../api/base";
import type { Vector } from "../api/types";
import type { PlanOfJob } from "../state/plan";
import { colour } from "../state/theme";
import { table, VIRIDIS } from "./colours";
import { FIRST, LINK, PROCESS_SHIFT, UNITS } from "./flags";
import { Loader } from "./loader";
import type { Made } from "./messages";
import type { Quantity } from "./path_material";

const PATHS = ["path-contour", "path-fill", "path-overhang", "path-face", "path-side", "path-side"];
const MARGIN_PX = 46;
const BUCKETS = 32; // colours of a scale: one stroke each

export class FlatView {
  private readonly canvas = document.createElement("canvas");
  private readonly loader = new Loader();
  private readonly resizer: ResizeObserver;
  private aborter = new AbortController();
  private shown: PlanOfJob | null = null;
  private made: Made | null = null;
  private number = -1;
  private quantity: Quantity = "process";
  private tip: Vector | null = null;

  constructor(private readonly host: HTMLElement) {
    host.append(this.canvas);
    this.resizer = new ResizeObserver(() => this.paint());
    this.resizer.observe(host);
  }

  setPlan(shown: PlanOfJob | null): void {
    this.shown = shown;
    this.made = null;
    this.number = -1;
    this.paint();
  }

  show(layer: number, quantity: Quantity, tip: Vector | null): void {
    this.quantity = quantity;
    this.tip = tip;
    if (this.shown && layer !== this.number) void this.load(this.shown, layer);
    this.paint();
  }

  private async load(shown: PlanOfJob, layer: number): Promise<void> {
    this.number = layer;
    this.aborter.abort();
    this.aborter = new AbortController();
    try {
      const url = `${api}/jobs/${shown.job}/plan/layers/${layer}/geometry?of=${shown.sha256}`;
      this.made = await this.loader.ask({ kind: "layer", url }, this.aborter.signal);
      this.paint();
    } catch {
      return; // another layer is wanted, or this one cannot be had: the drawing stays as it is
    }
  }

  /** Two directions in the layer's plane. */
  private plane(): [number[], number[]] {
    const [, , , nx = 0, ny = 0, nz = 1] = this.shown?.plan.layers[this.number]?.bottom ?? [];
    const a = Math.abs(nx) < 0.9 ? [1 - nx * nx, -nx * ny, -nx * nz] : [-ny * nx, 1 - ny * ny, -ny * nz];
    const size = Math.hypot(...a);
    const u = a.map((value) => value / size) as [number, number, number];
    return [u, [ny * u[2] - nz * u[1], nz * u[0] - nx * u[2], nx * u[1] - ny * u[0]]];
  }

  private paint(): void {
    const { clientWidth: width, clientHeight: height } = this.host;
    this.canvas.width = width;
    this.canvas.height = height;
    const pen = this.canvas.getContext("2d");
    const made = this.made;
    if (!pen || !made || !this.shown) return;
    const [u, v] = this.plane();
    const to = (p: ArrayLike<number>) => [p[0]! * u[0]! + p[1]! * u[1]! + p[2]! * u[2]!, p[0]! * v[0]! + p[1]! * v[1]! + p[2]! * v[2]!] as const;
    const positions = made.arrays.position as Uint16Array;
    const count = positions.length / 4;
    const { origin, step_mm } = made.header;
    const flat = new Float32Array(2 * count);
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    for (let k = 0; k < count; k++) {
      const [x, y] = to([0, 1, 2].map((d) => origin[d]! + step_mm * positions[4 * k + d]!));
      flat.set([x, y], 2 * k);
      box[0] = Math.min(box[0]!, x);
      box[1] = Math.min(box[1]!, y);
      box[2] = Math.max(box[2]!, x);
      box[3] = Math.max(box[3]!, y);
    }
    const scale = Math.min((width - 2 * MARGIN_PX) / (box[2]! - box[0]! || 1), (height - 2 * MARGIN_PX) / (box[3]! - box[1]! || 1));
    const place = (x: number, y: number) => [width / 2 + (x - (box[0]! + box[2]!) / 2) * scale, height / 2 - (y - (box[1]! + box[3]!) / 2) * scale] as const;
    for (const [shade, path] of this.strokes(flat, place)) {
      pen.strokeStyle = shade;
      pen.stroke(path);
    }
    if (!this.tip) return;
    pen.fillStyle = colour("laser");
    pen.beginPath();
    pen.arc(...place(...to(this.tip)), 6, 0, 2 * Math.PI);
    pen.fill();
  }

  /** One path for each colour. */
  private strokes(flat: Float32Array, place: (x: number, y: number) => readonly [number, number]): Map<string, Path2D> {
    const positions = this.made!.arrays.position as Uint16Array;
    const strokes = new Map<string, Path2D>();
    const shadeOf = this.shades();
    for (let k = 1; k < flat.length / 2; k++) {
      const flags = positions[4 * k + 3]!;
      if (flags & FIRST) continue;
      const shade = flags & LINK ? colour("path-link") : shadeOf(k, flags);
      let path = strokes.get(shade);
      if (!path) strokes.set(shade, (path = new Path2D()));
      path.moveTo(...place(flat[2 * k - 2]!, flat[2 * k - 1]!));
      path.lineTo(...place(flat[2 * k]!, flat[2 * k + 1]!));
    }
    return strokes;
  }

  private shades(): (vertex: number, flags: number) => string {
    const column = { speed: 0, power: 1, tilt: 2 }[this.quantity as string] as 0 | 1 | 2 | undefined;
    const processes = PATHS.map(colour);
    if (column === undefined) return (_, flags) => processes[Math.min(flags >> PROCESS_SHIFT, 5)]!;
    const values = this.made!.arrays.values as Uint16Array;
    let high = 1;
    for (let k = 0; k < values.length / 4; k++) high = Math.max(high, values[4 * k + column]! * UNITS[column]);
    const scale = table(VIRIDIS);
    return (vertex) => {
      const bucket = Math.round(((values[4 * vertex + column]! * UNITS[column]) / high) * BUCKETS);
      const row = 4 * Math.round((bucket / BUCKETS) * 255);
      return `rgb(${scale[row]}, ${scale[row + 1]}, ${scale[row + 2]})`;
    };
  }

  dispose(): void {
    this.aborter.abort();
    this.loader.dispose();
    this.resizer.disconnect();
    this.canvas.remove();
  }
}
