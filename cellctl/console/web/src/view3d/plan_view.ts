// The drawn plan: stage, layers, metal, part, tool and as-built surface together, as they are told to be.
import { api } from "../api/base";
import type { CellFacts } from "../api/types";
import { told } from "../state/notices";
import type { PlanOfJob } from "../state/plan";
import { Asking } from "./asking";
import { FIRST, LINK } from "./flags";
import { Ghost } from "./ghost";
import { Head, type Stand } from "./head";
import type { Holding, Layer } from "./layer";
import { LayerStore } from "./layer_store";
import { LiveBead } from "./live_bead";
import { Loader } from "./loader";
import type { Asked, Made } from "./messages";
import { metal } from "./metal";
import { milledLayers } from "./milled";
import { Colouring, type Quantity } from "./path_material";
import { nearest } from "./pick";
import { type Figures, Stage, type ViewName } from "./stage";
import { Surface } from "./surface";
import { Track, type Moment } from "./track";
import { Whole } from "./whole";

/** What is to be seen. moment: up to where the program is executed, null: layers are shown whole */
export interface Wanted {
  layer: number;
  moment: Moment | null;
  isExecuted: boolean; // all of the layer, whatever the moment says
  stand: Stand | null;
  quantity: Quantity;
  below: boolean;
  part: boolean;
  metal: boolean;
  machine: boolean;
}

export interface Costs extends Figures {
  bytes: number;
  layers: number;
  isReady: boolean;
}

const BEADS_HARDWARE = 220_000; // vertices of the whole up to which all its beads are drawn, beyond only contours
const BEADS_SOFTWARE = 40_000;
const DIM = { waiting: 0.3, plain: 1 };

export class PlanView {
  readonly stage: Stage;
  readonly colouring = new Colouring();
  readonly surface: Surface;
  track: Track | null = null;
  private readonly loader = new Loader();
  private readonly layers: LayerStore;
  private readonly ghost: Ghost;
  private readonly head = new Head();
  private readonly bead = new LiveBead();
  private readonly steel = metal({ colour: "#b9c2cb" });
  private readonly wholes: Asking;
  private whole: Whole | null = null;
  private shown: PlanOfJob | null = null;
  private firsts: number[] = [];
  private aborter = new AbortController();
  private wanted: Wanted | null = null;

  /** drawn: after every frame; loaded: when something came in that may change what is to be seen. Raises Error without WebGL. */
  constructor(
    host: HTMLElement,
    drawn: () => void,
    private readonly loaded: () => void,
  ) {
    this.stage = new Stage(host, () => this.arrange(), drawn);
    const draw = this.stage.draw;
    const changed = () => {
      draw();
      loaded();
    };
    this.layers = new LayerStore(this.loader, this.colouring, () => this.came("layer"));
    this.wholes = new Asking(this.loader, () => this.wholeDrawing(), (_, made) => this.wholeCame(made), changed);
    this.ghost = new Ghost(this.stage.scene, this.loader, () => this.came("part"));
    this.surface = new Surface(this.stage.scene, this.loader, () => this.came("surface"));
    this.stage.scene.add(this.layers.group, this.bead.mesh, ...this.head.objects);
  }

  setFacts(facts: CellFacts | null): void {
    this.head.setFacts(facts);
    if (facts) this.stage.prepare("machine");
    this.stage.draw();
  }

  /** Something of a kind is on the stage. */
  private came(kind: string): void {
    this.stage.prepare(kind);
    this.stage.draw();
    this.loaded();
  }

  /** Show a plan, or none. */
  setPlan(shown: PlanOfJob | null): void {
    this.aborter.abort();
    this.aborter = new AbortController();
    this.shown = shown;
    this.wholes.clear();
    this.whole?.dispose();
    this.whole = null;
    this.ghost.clear();
    this.surface.clear();
    this.setProgram("");
    let count = 0;
    this.firsts = (shown?.plan.layers ?? []).map((layer) => (count += layer.operations.length) - layer.operations.length);
    const root = shown ? `${api}/jobs/${shown.job}/plan` : "";
    this.layers.setPlan(root, shown?.sha256 ?? "", this.firsts);
    if (!shown) return this.stage.draw();
    const [low, high] = shown.plan.bounds;
    if (low && high) this.stage.setBounds(low, high);
    void this.ghost.load(shown.part, shown.plan.build_from_part);
    this.stage.draw();
  }

  private wholeDrawing(): Asked {
    const { job, sha256, plan } = this.shown!;
    const normals = Float32Array.from(plan.layers.flatMap((layer) => layer.bottom.slice(3)));
    const beadPieces = this.stage.isSoftware ? BEADS_SOFTWARE : BEADS_HARDWARE;
    return { kind: "whole", url: `${api}/jobs/${job}/plan/geometry?of=${sha256}`, normals, beadPieces };
  }

  private wholeCame(made: Made): void {
    this.whole = new Whole(made, this.colouring, this.steel);
    if (this.track) this.whole.setTimes(this.track.index);
    this.stage.scene.add(this.whole.group);
    this.came("whole");
  }

  /** Whether something that is to be seen could not be had yet. */
  get isMissing(): boolean {
    return this.shown !== null && (this.wholes.hasFailed(0) || this.layers.isMissing || (this.track?.isMissing ?? false));
  }

  /** Follow a program of the plan that is shown, or none. */
  setProgram(sha256: string): void {
    this.track?.dispose();
    this.track = null;
    const { signal } = this.aborter;
    if (!sha256 || !this.shown) return;
    const changed = () => {
      this.loaded();
      this.stage.draw();
    };
    Track.of(this.shown.job, sha256, this.loader, changed).then(
      (track) => {
        if (signal.aborted) return track.dispose();
        this.track = track;
        this.whole?.setTimes(track.index);
        changed();
      },
      (error: unknown) => signal.aborted || told(error),
    );
  }

  show(wanted: Wanted): void {
    this.wanted = wanted;
    this.colouring.quantity = wanted.quantity;
    this.colouring.range = this.range(wanted.quantity);
    this.stage.draw();
  }

  /** Range of a quantity over the plan, in its unit. */
  range(quantity: Quantity): [number, number] {
    if (quantity === "time") return [0, this.track?.index.duration_s ?? 1];
    if (quantity === "deviation") return this.surface.range;
    return quantity === "process" ? [0, 1] : (this.whole?.rangeOf(quantity) ?? [0, 1]);
  }

  /** Put everything as it is wanted; just before a frame. */
  private arrange(): void {
    const { wanted, whole } = this;
    if (!wanted || !this.shown) return this.head.place(null);
    const isMeasured = wanted.quantity === "deviation" && this.surface.state === "here";
    this.surface.show(isMeasured);
    this.layers.group.visible = !isMeasured;
    if (whole) whole.group.visible = !isMeasured && (wanted.below || wanted.layer === 0);
    this.ghost.show(wanted.part && !isMeasured);
    this.head.withMachine = wanted.machine;
    this.head.place(wanted.stand);
    if (!whole) this.wholes.want(0);
    const layer = this.layers.look(wanted.layer);
    const milled = isMeasured || !wanted.metal || !wanted.below ? 0 : this.milled(wanted);
    this.ghost.showMilled(milled > 0 ? (this.shown.plan.layers[milled - 1]?.z_top ?? 0) : null);
    const reached = wanted.moment && !wanted.isExecuted ? wanted.moment.layer : Number.POSITIVE_INFINITY;
    whole?.paths.line.material.look(Number.MAX_SAFE_INTEGER, 0.3, 0.3, false);
    whole?.show(Math.min(wanted.layer, reached) + (layer ? 0 : 1), wanted.metal, milled, !wanted.metal);
    if (layer) this.arrangeLayer(layer, wanted);
    else this.bead.hide();
  }

  private milled({ layer, moment }: Wanted): number {
    const before = moment ? Math.min(layer, moment.layer) : layer;
    return milledLayers(this.shown?.plan.layers ?? [], before);
  }

  private arrangeLayer(layer: Layer, wanted: Wanted): void {
    if (!this.layers.dress(layer, this.track)) this.stage.draw();
    const done = this.executed(layer, wanted);
    const isWhole = done >= layer.paths.count;
    const dim = wanted.moment && !isWhole ? DIM.waiting : DIM.plain;
    layer.paths.line.material.look(done, dim, wanted.metal && wanted.moment && !isWhole ? 0.9 : 1, true);
    layer.paths.range(0, layer.paths.count);
    layer.beads?.show(0, wanted.metal ? done : -1);
    if (!wanted.moment || !wanted.metal || isWhole || done < 0) return this.bead.hide();
    const holding = layer.holding(done);
    const next = Math.floor(done) + 1;
    const beads = layer.beadAt(next);
    if (!beads || holding.power === 0 || holding.isLink) return this.bead.hide();
    this.bead.lay(layer.pointAt(Math.floor(done)), layer.pointAt(done), beads.up, beads.width, beads.height);
  }

  /** Last vertex of a layer that is executed, with its fraction; -1: nothing is. */
  private executed(layer: Layer, { moment, isExecuted }: Wanted): number {
    if (isExecuted || !moment || moment.layer > layer.number) return layer.paths.count;
    if (moment.layer < layer.number) return -1;
    return layer.vertexAt(moment.operation - (this.firsts[layer.number] ?? 0), moment.pass, moment.arc);
  }

  /** Where the tip is at a moment: on the pass itself where its layer is here. */
  tipAt(moment: Moment): [number, number, number] {
    const layer = moment.pass >= 0 ? this.layers.look(moment.layer) : undefined;
    if (!layer) return moment.tip;
    return layer.pointAt(layer.vertexAt(moment.operation - (this.firsts[moment.layer] ?? 0), moment.pass, moment.arc));
  }

  /** Set-points at a moment; null while its layer is not here, or on a line that belongs to no pass. */
  holdingAt(moment: Moment): Holding | null {
    if (moment.pass < 0 || moment.operation < 0) return null;
    const layer = this.layers.look(moment.layer);
    return layer?.holding(layer.vertexAt(moment.operation - (this.firsts[moment.layer] ?? 0), moment.pass, moment.arc)) ?? null;
  }

  /** What is under the pointer (pixels of the canvas): a place on a pass, or how far the as-built surface is off. */
  under(x: number, y: number): { holding: Holding } | { deviation: number } | null {
    const { canvas, camera } = this.stage;
    const size = { width: canvas.clientWidth, height: canvas.clientHeight };
    const surface = this.surface.object;
    if (surface?.visible) {
      const positions = surface.geometry.getAttribute("position").array as Uint16Array;
      const options = { first: 0, end: positions.length / 4, skip: 0, asPieces: false };
      const corner = nearest(positions, surface, camera, size, { x, y }, options);
      return corner < 0 ? null : { deviation: this.surface.at(corner) };
    }
    const layer = this.wanted && this.layers.look(this.wanted.layer);
    if (!layer) return null;
    if (this.track) layer.setTimes(this.track.linesOf(layer.number), this.firsts[layer.number] ?? 0);
    const positions = layer.paths.made.arrays.position as Uint16Array;
    const options = { first: 0, end: layer.paths.count, skip: FIRST, asPieces: true };
    const vertex = nearest(positions, layer.paths.line, camera, size, { x, y }, options);
    return vertex < 0 || positions[4 * vertex + 3]! & LINK ? null : { holding: layer.holding(vertex) };
  }

  get toolName(): string {
    return this.head.toolName;
  }

  /** Where the drawn tool stands, mm, build frame; "" where none is drawn. */
  get tip(): string {
    return this.wanted?.stand ? this.wanted.stand.tip.map((value) => value.toFixed(3)).join(" ") : "";
  }

  get costs(): Costs {
    const bytes = this.layers.bytes + (this.whole?.bytes ?? 0) + this.surface.bytes;
    return { ...this.stage.figures, bytes, layers: this.layers.resident, isReady: this.whole !== null };
  }

  look(name: ViewName, along?: number[]): void {
    this.stage.look(name, along);
  }

  paint(): void {
    this.colouring.paint();
    this.stage.paint();
    this.ghost.paint();
    this.head.paint();
  }

  dispose(): void {
    this.setPlan(null);
    this.layers.dispose();
    this.ghost.dispose();
    this.surface.dispose();
    this.head.dispose();
    this.bead.dispose();
    this.steel.dispose();
    this.colouring.dispose();
    this.loader.dispose();
    this.stage.dispose();
  }
}
