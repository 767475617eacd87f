// Layers as they are needed: the one that is looked at first, then those below it, within a budget; the rest is let go.
import { Group } from "three";
import { get } from "../api/http";
import type { LayerView } from "../api/types";
import { LayerLines } from "./layer_lines";
import { segmentsOf } from "./segments";

const SEGMENTS_MAX = 600_000; // about 30 MB on the graphics card
const BELOW_MAX = 120; // layers shown under the one that is looked at

export class LayerStore {
  readonly group = new Group();
  private readonly layers = new Map<number, LayerLines>();
  private aborter = new AbortController();
  private job = "";
  private focus = 0;
  private withBelow = true;

  constructor(private readonly changed: () => void) {}

  /** Show another plan, or none. */
  setJob(job: string): void {
    this.clear();
    this.job = job;
  }

  /** Look at a layer: load it and, if wanted, those below. */
  look(layer: number, withBelow: boolean): void {
    this.focus = layer;
    this.withBelow = withBelow;
    this.aborter.abort();
    this.aborter = new AbortController();
    this.arrange();
    if (this.job) void this.load(this.aborter.signal);
  }

  at(layer: number): LayerLines | undefined {
    return this.layers.get(layer);
  }

  /** Draw everything anew, for instance in other colours. */
  reload(): void {
    const job = this.job;
    this.clear();
    this.job = job;
    this.look(this.focus, this.withBelow);
  }

  get segmentCount(): number {
    let count = 0;
    for (const layer of this.layers.values()) count += layer.count;
    return count;
  }

  clear(): void {
    this.aborter.abort();
    for (const layer of this.layers.values()) layer.dispose();
    this.layers.clear();
    this.job = "";
    this.changed();
  }

  private *wanted(): Generator<number> {
    yield this.focus;
    if (!this.withBelow) return;
    for (let n = this.focus - 1; n >= Math.max(0, this.focus - BELOW_MAX); n--) yield n;
  }

  private async load(signal: AbortSignal): Promise<void> {
    for (const n of this.wanted()) {
      if (this.layers.has(n)) continue;
      if (n !== this.focus && this.segmentCount > SEGMENTS_MAX) return;
      let view: LayerView;
      try {
        view = await get<LayerView>(`/jobs/${this.job}/plan/layers/${n}`, signal);
      } catch {
        if (signal.aborted) return;
        continue; // a layer that cannot be read is left out; looking at it again asks again
      }
      if (signal.aborted) return;
      const lines = new LayerLines(segmentsOf(view));
      this.layers.set(n, lines);
      this.group.add(lines.group);
      this.arrange();
    }
  }

  /** Show what belongs to the view; let go of the farthest while the budget is exceeded. */
  private arrange(): void {
    for (const [n, lines] of this.layers) {
      lines.group.visible = n === this.focus || (this.withBelow && n < this.focus && n >= this.focus - BELOW_MAX);
      lines.setLook(n === this.focus ? "plain" : "below");
    }
    const farthest = [...this.layers.keys()].sort((a, b) => Math.abs(b - this.focus) - Math.abs(a - this.focus));
    for (const n of farthest) {
      if (this.segmentCount <= SEGMENTS_MAX || n === this.focus) break;
      this.layers.get(n)?.dispose();
      this.layers.delete(n);
    }
    this.changed();
  }
}
