// Layers in full as they are needed: the one that is looked at and its neighbours, within a budget; the farthest are let go.
import { Group } from "three";
import { Asking } from "./asking";
import { table, VIRIDIS } from "./colours";
import { Layer } from "./layer";
import type { Loader } from "./loader";
import type { Made } from "./messages";
import { metal } from "./metal";
import type { Colouring } from "./path_material";
import type { Track } from "./track";

export const BYTES_MAX = 48e6; // of layers in full, on the graphics card
const AHEAD = 2; // layers fetched before they are asked for

export class LayerStore {
  readonly group = new Group();
  private readonly layers = new Map<number, Layer>();
  private readonly asking: Asking;
  private readonly material = metal({ byCorner: true });
  private readonly scale = table(VIRIDIS);
  private focus = 0;
  private root = "";
  private of = "";
  private count = 0;
  private firsts: number[] = [];

  /** changed: when a layer came or failed */
  constructor(
    loader: Loader,
    private readonly colouring: Colouring,
    private readonly changed: () => void,
  ) {
    const drawing = (n: number) => ({ kind: "layer", url: `${this.root}/layers/${n}/geometry?of=${this.of}` }) as const;
    this.asking = new Asking(loader, drawing, (n, made) => this.came(n, made), changed);
  }

  /** Show another plan, or none. firsts: number over the plan of each layer's first operation */
  setPlan(root: string, of: string, firsts: number[]): void {
    this.clear();
    this.root = root;
    this.of = of;
    this.firsts = firsts;
    this.count = firsts.length;
  }

  /** The layer, if it is here; it is asked for, and then its neighbours. */
  look(n: number): Layer | undefined {
    this.focus = n;
    if (!this.root) return undefined;
    const here = this.layers.get(n);
    if (!here) this.ask(n);
    else for (let d = 1; d <= AHEAD; d++) for (const near of [n + d, n - d]) if (this.asking.count === 0) this.ask(near);
    for (const [other, layer] of this.layers) layer.group.visible = other === n;
    return here;
  }

  /** Colours and times of a layer as they are now; false if the next frame has to go on with it. */
  dress(layer: Layer, track: Track | null): boolean {
    if (track && this.colouring.quantity === "time") layer.setTimes(track.linesOf(layer.number), this.firsts[layer.number] ?? 0);
    const { quantity, range, process } = this.colouring;
    const shown = process.map((one) => {
      const { r, g, b } = one.clone().convertLinearToSRGB();
      return [r * 255, g * 255, b * 255] as [number, number, number];
    });
    return layer.paintBeads(this.scale, shown, `${quantity} ${range} ${process[0]!.getHexString()}`);
  }

  get bytes(): number {
    let bytes = 0;
    for (const layer of this.layers.values()) bytes += layer.bytes;
    return bytes;
  }

  get resident(): number {
    return this.layers.size;
  }

  /** Whether the layer that is looked at could not be had; it is asked for again by itself. */
  get isMissing(): boolean {
    return this.asking.hasFailed(this.focus);
  }

  private ask(n: number): void {
    if (n >= 0 && n < this.count && !this.layers.has(n)) this.asking.want(n);
  }

  private came(n: number, made: Made): void {
    const layer = new Layer(n, made, this.colouring, this.material);
    layer.group.visible = false;
    this.layers.set(n, layer);
    this.group.add(layer.group);
    this.evict();
    this.changed();
  }

  private evict(): void {
    let { bytes } = this;
    const farthest = [...this.layers.keys()].sort((a, b) => Math.abs(b - this.focus) - Math.abs(a - this.focus));
    for (const n of farthest) {
      if (bytes <= BYTES_MAX || n === this.focus) return;
      bytes -= this.layers.get(n)?.bytes ?? 0;
      this.layers.get(n)?.dispose();
      this.layers.delete(n);
    }
  }

  clear(): void {
    this.asking.clear();
    for (const layer of this.layers.values()) layer.dispose();
    this.layers.clear();
    this.root = "";
  }

  dispose(): void {
    this.clear();
    this.material.dispose();
  }
}
