// One layer drawn twice: all of it dim, and what is executed of it bright on top.
import { BufferAttribute, BufferGeometry, Group, LineBasicMaterial, LineSegments } from "three";
import type { Vector } from "../api/types";
import { executedSegments, type Segments } from "./segments";

export class LayerLines {
  readonly group = new Group();
  private readonly all: LineSegments<BufferGeometry, LineBasicMaterial>;
  private readonly done: LineSegments<BufferGeometry, LineBasicMaterial>;
  private executed = 0;

  constructor(private readonly segments: Segments) {
    const position = new BufferAttribute(segments.ends, 3);
    const colour = new BufferAttribute(segments.colours, 3);
    this.all = lines(position, colour, 1);
    this.done = lines(position, colour, 1);
    this.done.geometry.setDrawRange(0, 0);
    this.group.add(this.all, this.done);
  }

  get count(): number {
    return this.segments.count;
  }

  /** Above or at the layer that is looked at: plain. Below it: faint, as what carries it. */
  setLook(look: "plain" | "below" | "waiting"): void {
    this.all.material.opacity = { plain: 1, below: 0.16, waiting: 0.34 }[look];
    this.all.material.transparent = look !== "plain";
    this.done.visible = look !== "below";
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
    this.done.geometry.setDrawRange(0, executed * 2);
    return changed;
  }

  dispose(): void {
    for (const drawn of [this.all, this.done]) {
      drawn.geometry.dispose();
      drawn.material.dispose();
    }
    this.group.removeFromParent();
  }
}

function lines(position: BufferAttribute, colour: BufferAttribute, opacity: number): LineSegments<BufferGeometry, LineBasicMaterial> {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", position);
  geometry.setAttribute("color", colour);
  const material = new LineBasicMaterial({ vertexColors: true, opacity, transparent: opacity < 1, depthWrite: false });
  const drawn = new LineSegments(geometry, material);
  drawn.frustumCulled = false;
  return drawn;
}
