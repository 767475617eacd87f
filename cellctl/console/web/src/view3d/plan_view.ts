// The drawn plan: stage, layers, part and tool together, following what it is told.
import type { Snapshot, Tool } from "../api/types";
import type { OperationPlace, PlanOfJob } from "../state/plan";
import { Ghost } from "./ghost";
import { LayerStore } from "./layer_store";
import { Stage, type ViewName } from "./stage";
import { LiveTool } from "./tool";

export class PlanView {
  private readonly stage: Stage;
  private readonly layers: LayerStore;
  private readonly ghost: Ghost;
  private readonly tool = new LiveTool();
  private job = "";
  private focus = 0;

  /** Raises Error where the browser has no WebGL. */
  constructor(host: HTMLElement) {
    this.stage = new Stage(host);
    this.layers = new LayerStore(this.stage.draw);
    this.ghost = new Ghost(this.stage.scene, this.stage.draw);
    this.stage.scene.add(this.layers.group, this.tool.group);
  }

  setPlan(shown: PlanOfJob | null): void {
    this.job = shown?.job ?? "";
    this.layers.setJob(this.job);
    this.ghost.clear();
    if (!shown) return this.stage.draw();
    const [low, high] = shown.plan.bounds;
    if (low && high) {
      this.stage.setBounds(low, high);
      this.tool.setScale(Math.max(...high.map((value, k) => value - (low[k] ?? 0))));
    }
    void this.ghost.load(shown.part, shown.plan.build_from_part);
  }

  setLayer(layer: number, withBelow: boolean): void {
    this.focus = layer;
    if (this.job) this.layers.look(layer, withBelow);
  }

  showPart(is: boolean): void {
    this.ghost.show(is);
  }

  look(name: ViewName, along?: number[]): void {
    this.stage.look(name, along);
  }

  paint(): void {
    this.stage.paint();
    this.ghost.paint();
    this.tool.paint();
    this.layers.reload();
  }

  /** Tool and executed part from a snapshot. place: the operation that is worked on. */
  follow(snapshot: Snapshot | null, place: OperationPlace | undefined, tools: Tool[]): void {
    const isOurs = Boolean(snapshot?.job && snapshot.job.id === this.job);
    this.tool.follow(isOurs ? snapshot : null, tools);
    this.highlight(isOurs ? snapshot : null, place);
    this.stage.draw();
  }

  private highlight(snapshot: Snapshot | null, place: OperationPlace | undefined): void {
    const lines = this.layers.at(this.focus);
    if (!lines) return;
    const job = snapshot?.job;
    if (!snapshot || !job) {
      lines.setLook("plain");
      lines.highlightAll(false);
      return;
    }
    lines.setLook("waiting");
    const live = place?.layer ?? job.layer;
    if (job.outcome === "completed" || this.focus < live) lines.highlightAll(true);
    else if (this.focus > live || !place) lines.highlightAll(false);
    else lines.follow(place.index, snapshot.lines.executing >= 0 ? snapshot.tip : null);
  }

  dispose(): void {
    this.layers.clear();
    this.ghost.dispose();
    this.tool.dispose();
    this.stage.dispose();
  }
}
