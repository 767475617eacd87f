// The live tool: laser head or cutter, its tip and axis where the machine reports them.
import { CylinderGeometry, Group, Mesh, MeshBasicMaterial, MeshStandardMaterial, Quaternion, SphereGeometry, Vector3 } from "three";
import type { Snapshot, Tool as ToolFacts, Vector } from "../api/types";
import { colour } from "../state/theme";

const UP = new Vector3(0, 0, 1);
const STAND_OFF_MM = 12; // of the nozzle from the spot
const NOZZLE_MM = 7; // its mouth
const HEAD_MM = 60;
const FULL_SIZE_MM = 40; // beside smaller parts the head is drawn smaller, so that both are seen
const SMALLEST = 0.3;

export class LiveTool {
  readonly group = new Group();
  private readonly steel = new MeshStandardMaterial({ metalness: 0.35, roughness: 0.5, transparent: true, opacity: 0.85 });
  private readonly light = new MeshBasicMaterial();
  private readonly glow = new MeshBasicMaterial({ transparent: true, opacity: 0.45, depthWrite: false });
  private readonly spot = new Mesh(new SphereGeometry(0.8, 20, 14), this.light);
  private readonly beam = new Mesh(new CylinderGeometry(2.2, 0.6, STAND_OFF_MM, 20, 1, true), this.glow);
  private readonly shape = new Group();
  private number = -1;
  private headScale = 1;

  constructor() {
    upright(this.beam, STAND_OFF_MM / 2);
    this.group.add(this.shape, this.spot, this.beam);
    this.group.visible = false;
    this.paint();
  }

  paint(): void {
    this.steel.color.set(colour("tool"));
    this.light.color.set(colour("laser"));
    this.glow.color.set(colour("laser"));
  }

  /** Follow a snapshot. Hidden while no job is on the cell: then there is no tip in the part's frame. */
  follow(snapshot: Snapshot | null, tools: ToolFacts[]): void {
    const job = snapshot?.job;
    this.group.visible = Boolean(job && !job.outcome);
    if (!snapshot || !this.group.visible) return;
    const kind = job?.operation_kind === "mill" ? "end_mill" : "deposition";
    const facts = tools.find((tool) => tool.number === snapshot.cnc.tool) ?? tools.find((tool) => tool.kind === kind);
    this.build(facts, kind);
    this.place(snapshot.tip, snapshot.tool_axis);
    this.spot.visible = this.beam.visible = snapshot.laser.emitting;
  }

  /** Beside a part of this size, mm. The cutter keeps its true size: it is what touches. */
  setScale(partMm: number): void {
    this.headScale = Math.min(1, Math.max(SMALLEST, partMm / FULL_SIZE_MM));
    this.number = -1;
  }

  private place(tip: Vector, axis: Vector): void {
    this.group.position.set(...tip);
    this.group.quaternion.copy(new Quaternion().setFromUnitVectors(UP, new Vector3(...axis).normalize()));
  }

  private build(facts: ToolFacts | undefined, kind: string): void {
    const number = facts?.number ?? (kind === "end_mill" ? 1000 : 1001);
    if (number === this.number) return;
    this.number = number;
    this.empty();
    const isCutter = (facts?.kind ?? kind) === "end_mill";
    this.group.scale.setScalar(isCutter ? 1 : this.headScale);
    if (isCutter) this.cutter(facts);
    else this.head(facts);
  }

  private head(facts: ToolFacts | undefined): void {
    const radius = Math.min((facts?.holder_diameter_mm ?? 40) / 2, 14);
    this.add(new CylinderGeometry(radius, NOZZLE_MM / 2, HEAD_MM * 0.5, 40), STAND_OFF_MM + HEAD_MM * 0.25);
    this.add(new CylinderGeometry(radius, radius, HEAD_MM * 0.5, 32), STAND_OFF_MM + HEAD_MM * 0.75);
  }

  private cutter(facts: ToolFacts | undefined): void {
    const radius = (facts?.diameter_mm ?? 8) / 2;
    const flute = facts?.flute_length_mm ?? 24;
    const holder = Math.min((facts?.holder_diameter_mm ?? 28) / 2, 16);
    this.add(new CylinderGeometry(radius, radius, flute, 28), flute / 2);
    this.add(new CylinderGeometry(holder, holder * 0.8, HEAD_MM * 0.5, 32), flute + HEAD_MM * 0.25);
  }

  private add(geometry: CylinderGeometry, height: number): void {
    const mesh = new Mesh(geometry, this.steel);
    upright(mesh, height);
    this.shape.add(mesh);
  }

  private empty(): void {
    for (const child of [...this.shape.children]) {
      if (child instanceof Mesh) child.geometry.dispose();
      this.shape.remove(child);
    }
  }

  dispose(): void {
    this.empty();
    this.spot.geometry.dispose();
    this.beam.geometry.dispose();
    this.steel.dispose();
    this.light.dispose();
    this.glow.dispose();
    this.group.removeFromParent();
  }
}

/** Cylinders of three.js stand along y; tools stand along z. */
function upright(mesh: Mesh, height: number): void {
  mesh.rotation.x = Math.PI / 2;
  mesh.position.z = height;
}
