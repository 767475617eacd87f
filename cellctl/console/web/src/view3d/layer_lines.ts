// One layer drawn twice: all of it dim, and what is executed of it bright on top.
import { BufferAttribute, BufferGeometry, Group, LineBasicMaterial, LineSegments } from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";
import type { Vector } from "../api/types";
import { colour } from "../state/theme";
import { executedSegments, type Segments } from "./segments";

const DONE_PX = 2.6; // width of what is executed

export class LayerLines {
  readonly group = new Group();
  private readonly all: LineSegments<BufferGeometry, LineBasicMaterial>;
  private readonly hanging: LineSegments<BufferGeometry, LineBasicMaterial>;
  private done: LineSegments2 | null = null; // made when the first segment is executed
  private isBelow = false;
  private executed = 0;

  constructor(private readonly segments: Segments) {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(segments.ends, 3));
    geometry.setAttribute("color", new BufferAttribute(segments.colours, 3));
    this.all = new LineSegments(geometry, new LineBasicMaterial({ vertexColors: true, depthWrite: false }));
    this.all.frustumCulled = false;
    const outlines = new BufferGeometry();
    outlines.setAttribute("position", new BufferAttribute(segments.overhang, 3));
    this.hanging = new LineSegments(outlines, new LineBasicMaterial({ color: colour("path-overhang"), depthWrite: false }));
    this.hanging.frustumCulled = false;
    this.group.add(this.all, this.hanging);
  }

  get count(): number {
    return this.segments.count;
  }

  /** Above or at the layer that is looked at: plain. Below it: faint, as what carries it. */
  setLook(look: "plain" | "below" | "waiting"): void {
    this.all.material.opacity = { plain: 1, below: 0.16, waiting: 0.36 }[look];
    this.all.material.transparent = look !== "plain";
    this.isBelow = look === "below";
    this.hanging.visible = !this.isBelow && this.segments.overhang.length > 0;
    if (this.done) this.done.visible = !this.isBelow && this.executed > 0;
  }

  /** Highlight what is executed. True if that changed. */
  follow(operation: number, tip: Vector | null): boolean {
    const first = this.segments.starts[operation] ?? this.count;
    const next = tip ? executedSegments(this.segments, operation, tip, this.executed) : first;
    return this.highlight(next);
  }

  /** All of it, or nothing, is executed. True if that changed. */
  highlightAll(is: boolean): boolean {
    return this.highlight(is ? this.count : 0);
  }

  private highlight(executed: number): boolean {
    const changed = executed !== this.executed;
    this.executed = executed;
    if (executed > 0) this.done ??= this.makeDone();
    if (this.done) {
      this.done.geometry.instanceCount = executed;
      this.done.visible = !this.isBelow && executed > 0;
    }
    return changed;
  }

  private makeDone(): LineSegments2 {
    const geometry = new LineSegmentsGeometry();
    geometry.setPositions(this.segments.ends);
    geometry.setColors(this.segments.colours);
    const done = new LineSegments2(geometry, new LineMaterial({ vertexColors: true, linewidth: DONE_PX, depthWrite: false }));
    done.frustumCulled = false;
    done.renderOrder = 1;
    this.group.add(done);
    return done;
  }

  dispose(): void {
    this.all.geometry.dispose();
    this.all.material.dispose();
    this.hanging.geometry.dispose();
    this.hanging.material.dispose();
    this.done?.geometry.dispose();
    this.done?.material.dispose();
    this.group.removeFromParent();
  }
}
