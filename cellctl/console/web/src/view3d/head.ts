// Tool and machine as the cell file has them, where the machine reports them or where a program has them at a moment.
import { type BufferGeometry, CylinderGeometry, DoubleSide, Group, Matrix4, Mesh, MeshBasicMaterial, MeshMatcapMaterial, MeshStandardMaterial, Quaternion, SphereGeometry, Vector3 } from "three";
import type { CellFacts, Vector } from "../api/types";
import { colour } from "../state/theme";
import { plateBodies, solidGeometry, toolBodies } from "./bodies";
import { poseOf, tableFromBuild } from "./kinematics";
import { metal } from "./metal";

/** Where the machine is. joints: machine coordinates by letter, null where nobody knows them */
export interface Stand {
  tool: number; // in the spindle, 0: not told
  isMilling: boolean;
  tip: Vector;
  axis: Vector;
  joints: Record<string, number> | null;
  isLit: boolean;
}

const UP = new Vector3(0, 0, 1);
const AGREE = 0.999; // cosine between the axis that is told and that of the chain
const SEEN = { work: 0.96, head: 0.3, machine: 0.16 };

export class Head {
  readonly group = new Group();
  readonly plate = new Group();
  private readonly tool = new Group();
  private readonly machine = new Group();
  private readonly steel: Record<"work" | "head", MeshMatcapMaterial>;
  private readonly frame = new MeshStandardMaterial({ transparent: true, opacity: SEEN.machine, depthWrite: false, roughness: 0.9 });
  private readonly slab = new MeshStandardMaterial({ roughness: 0.85, metalness: 0.1 });
  private readonly light = new MeshBasicMaterial();
  private readonly glow = new MeshBasicMaterial({ transparent: true, opacity: 0.5, depthWrite: false, side: DoubleSide });
  private readonly spot = new Mesh(new SphereGeometry(0.55, 20, 14), this.light);
  private beam: Mesh | null = null;
  private facts: CellFacts | null = null;
  private mounted = 0;
  withMachine = false;

  constructor() {
    this.steel = { work: metal(), head: metal() };
    for (const [kind, material] of Object.entries(this.steel)) {
      const opacity = SEEN[kind as "work" | "head"];
      Object.assign(material, { transparent: true, opacity, depthWrite: kind === "work" });
    }
    this.group.add(this.tool, this.spot);
    this.group.visible = this.machine.visible = false;
    this.paint();
  }

  get objects(): Group[] {
    return [this.group, this.plate, this.machine];
  }

  paint(): void {
    this.steel.work.color.set(colour("tool"));
    this.steel.head.color.set(colour("tool"));
    this.frame.color.set(colour("part"));
    this.slab.color.set(colour("plate"));
    this.light.color.set(colour("laser"));
    this.glow.color.set(colour("laser"));
  }

  setFacts(facts: CellFacts | null): void {
    if (facts === this.facts) return;
    this.facts = facts;
    this.mounted = 0;
    empty(this.plate);
    empty(this.machine);
    if (!facts) return;
    const buildFromTable = tableFromBuild(facts).invert();
    for (const { geometry, name } of plateBodies(facts)) {
      const mesh = new Mesh(geometry.applyMatrix4(buildFromTable), this.slab);
      mesh.name = name;
      mesh.visible = name === "plate";
      this.plate.add(mesh);
    }
    this.mount({ tool: 0, isMilling: false }); // so that its programs are made before it is to be seen
    for (const solid of facts.machine?.solids ?? []) {
      const geometry = solidGeometry(solid);
      if (!geometry) continue;
      const mesh = new Mesh(geometry, this.frame);
      mesh.name = solid.carrier;
      mesh.matrixAutoUpdate = false;
      this.machine.add(mesh);
    }
  }

  /** Show the tool where it stands, or hide it. */
  place(stand: Stand | null): void {
    this.group.visible = stand !== null;
    for (const body of this.plate.children) body.visible = this.withMachine || body.name === "plate";
    this.machine.visible = this.withMachine && Boolean(stand?.joints);
    if (!stand) return;
    this.mount(stand);
    const rotation = this.rotation(stand);
    this.group.position.set(...stand.tip);
    this.group.quaternion.copy(rotation);
    this.spot.visible = stand.isLit;
    if (this.beam) this.beam.visible = stand.isLit;
  }

  private rotation(stand: Stand): Quaternion {
    const axis = new Vector3(...stand.axis).normalize();
    if (this.facts && stand.joints) {
      const pose = poseOf(this.facts, stand.joints, stand.isMilling ? 0 : 1);
      for (const mesh of this.machine.children) mesh.matrix.copy(pose.of(mesh.name));
      const turned = new Quaternion().setFromRotationMatrix(new Matrix4().extractRotation(pose.of("spindle")));
      if (UP.clone().applyQuaternion(turned).dot(axis) > AGREE) return turned;
    }
    return new Quaternion().setFromUnitVectors(UP, axis);
  }

  private mount({ tool, isMilling }: Pick<Stand, "tool" | "isMilling">): void {
    const tools = this.facts?.tools ?? [];
    const fits = (one: { kind: string }) => (one.kind === "deposition") !== isMilling;
    const facts = tools.find((one) => one.number === tool && fits(one)) ?? tools.find(fits);
    if (!facts || facts.number === this.mounted) return;
    this.mounted = facts.number;
    empty(this.tool);
    for (const body of toolBodies(facts)) {
      const mesh = new Mesh(body.geometry, this.steel[body.kind === "head" ? "head" : "work"]);
      mesh.name = body.name;
      mesh.renderOrder = body.kind === "head" ? 4 : 3;
      this.tool.add(mesh);
    }
    this.beam = null;
    if (facts.kind === "deposition") {
      const off = facts.nozzle.standoff_mm;
      const cone: BufferGeometry = new CylinderGeometry(facts.nozzle.end_diameter_mm * 0.28, facts.diameter_mm / 2, off, 24, 1, true);
      this.beam = new Mesh(cone.rotateX(Math.PI / 2).translate(0, 0, off / 2), this.glow);
      this.tool.add(this.beam);
    }
  }

  get toolName(): string {
    return this.facts?.tools.find((tool) => tool.number === this.mounted)?.name ?? "";
  }

  dispose(): void {
    for (const group of [this.tool, this.plate, this.machine]) empty(group);
    this.spot.geometry.dispose();
    for (const material of [this.steel.work, this.steel.head, this.frame, this.slab, this.light, this.glow]) material.dispose();
    for (const group of this.objects) group.removeFromParent();
  }
}

function empty(group: Group): void {
  for (const child of [...group.children]) {
    if (child instanceof Mesh) (child.geometry as BufferGeometry).dispose();
    group.remove(child);
  }
}
