// Camera, light and ground, and drawing when something changed: a page at rest, or out of sight, draws nothing.
import { AmbientLight, Box3, Color, DirectionalLight, GridHelper, type Object3D, PerspectiveCamera, Scene, Spherical, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { colour } from "../state/theme";

const PIXELS_MAX = 1.5; // device pixels per pixel: more costs without being seen on lines
const DIRECTIONS = { fit: new Vector3(0.75, -1, 0.62), top: new Vector3(0, -0.001, 1), side: new Vector3(0, -1, 0.1) };
const MARGIN = 1.18; // around the part, for the tool
const PREPARED_MS = 2000; // then a frame is drawn even if the card is not ready
const GRID_MM = 10;

export type ViewName = keyof typeof DIRECTIONS;

/** What the last frame cost. */
export interface Figures {
  frames: number;
  calls: number;
  triangles: number;
  lines: number;
  geometries: number;
  frameMs: number;
  longestMs: number;
}

export class Stage {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(32, 1, 0.5, 5000);
  readonly figures: Figures = { frames: 0, calls: 0, triangles: 0, lines: 0, geometries: 0, frameMs: 0, longestMs: 0 };
  readonly canvas: HTMLCanvasElement;
  private readonly renderer: WebGLRenderer;
  private readonly controls: OrbitControls;
  private readonly resizer: ResizeObserver;
  private readonly watcher: IntersectionObserver;
  private ground: GridHelper | null = null;
  private bounds = new Box3(new Vector3(-40, -40, 0), new Vector3(40, 40, 40));
  private frame = 0;
  private isSeen = true;
  private isDue = false;
  private readonly prepared = new Set<string>();
  private preparing = 0;

  /** before, after: called around every frame. Raises Error where the browser has no WebGL. */
  constructor(
    private readonly host: HTMLElement,
    private readonly before: () => void = () => {},
    private readonly after: () => void = () => {},
  ) {
    this.renderer = new WebGLRenderer({ antialias: true, powerPreference: "low-power" });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, PIXELS_MAX));
    this.renderer.localClippingEnabled = true;
    this.renderer.debug.checkShaderErrors = import.meta.env.DEV; // asking waits for the card
    this.canvas = this.renderer.domElement;
    this.canvas.setAttribute("aria-hidden", "true");
    host.append(this.canvas);
    this.camera.up.set(0, 0, 1);
    const sun = new DirectionalLight(0xffffff, 2.2);
    sun.position.set(0.6, -1, 1.4);
    this.scene.add(new AmbientLight(0xffffff, 1.1), sun, this.camera);
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.addEventListener("change", this.draw);
    this.resizer = new ResizeObserver(() => this.resize());
    this.resizer.observe(host);
    this.watcher = new IntersectionObserver(([entry]) => {
      this.isSeen = entry?.isIntersecting ?? true;
      if (this.isSeen && this.isDue) this.draw();
    });
    this.watcher.observe(host);
    this.paint();
    this.look("fit");
  }

  /** Whether frames are drawn by the processor. */
  get isSoftware(): boolean {
    const gl = this.renderer.getContext();
    const told = gl.getExtension("WEBGL_debug_renderer_info");
    return /swiftshader|llvmpipe|software/i.test(told ? String(gl.getParameter(told.UNMASKED_RENDERER_WEBGL)) : "");
  }

  paint(): void {
    this.scene.background = new Color(colour("stage"));
    this.layGround();
  }

  setBounds(low: number[], high: number[]): void {
    this.bounds.set(new Vector3(low[0], low[1], low[2]), new Vector3(high[0], high[1], high[2]));
    this.layGround();
    this.look("fit");
  }

  get size(): number {
    return this.bounds.getSize(new Vector3()).length();
  }

  /** along: for "top", the direction to look against instead of z. */
  look(name: ViewName, along?: number[]): void {
    const direction = DIRECTIONS[name].clone();
    if (name === "top" && along) direction.add(new Vector3(along[0], along[1], (along[2] ?? 1) - 1));
    const centre = this.bounds.getCenter(new Vector3());
    const distance = Math.max(this.distance(direction.normalize(), centre), 10);
    this.camera.position.copy(centre).addScaledVector(direction, distance);
    this.camera.near = distance / 100;
    this.camera.far = distance * 20;
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(centre);
    this.controls.update();
    this.draw();
  }

  /** From how far the whole box is seen along a direction (towards the eye). */
  private distance(direction: Vector3, centre: Vector3): number {
    const half = Math.tan((this.camera.fov * Math.PI) / 360);
    const right = new Vector3(0, 0, 1).cross(direction).normalize();
    const up = direction.clone().cross(right);
    let most = 0;
    for (let corner = 0; corner < 8; corner++) {
      const [x, y, z] = [0, 1, 2].map((d) => ((corner >> d) & 1 ? this.bounds.max : this.bounds.min).getComponent(d) - centre.getComponent(d));
      const at = new Vector3(x, y, z);
      const wide = Math.max(Math.abs(at.dot(up)), Math.abs(at.dot(right)) / this.camera.aspect) / half;
      most = Math.max(most, at.dot(direction) + MARGIN * wide);
    }
    return most;
  }

  /** Turn about the point that is looked at, rad, and go nearer by a factor. */
  orbit(right: number, up: number, nearer: number): void {
    const offset = this.camera.position.clone().sub(this.controls.target);
    const turned = new Spherical().setFromVector3(new Vector3(offset.x, offset.z, -offset.y));
    turned.theta += right;
    turned.phi = Math.min(Math.PI - 0.02, Math.max(0.02, turned.phi - up));
    turned.radius /= nearer;
    const back = new Vector3().setFromSpherical(turned);
    this.camera.position.copy(this.controls.target).add(new Vector3(back.x, -back.z, back.y));
    this.controls.update();
    this.draw();
  }

  /** Look at a place, from where the camera is. */
  target(point: number[]): void {
    const to = new Vector3(point[0], point[1], point[2]);
    this.camera.position.add(to.clone().sub(this.controls.target));
    this.controls.target.copy(to);
    this.controls.update();
    this.draw();
  }

  /** Draw at the next frame, once however often it is asked; not while nobody sees it. */
  readonly draw = (): void => {
    this.isDue = true;
    if (!this.isSeen || this.preparing) return;
    this.frame ||= requestAnimationFrame(() => this.render());
  };

  /** Let the programs of what is on the stage be made beside the page, once for each kind of thing; the next frame waits for them, not the page. */
  prepare(kind: string): void {
    if (this.prepared.has(kind)) return;
    this.prepared.add(kind);
    this.preparing++;
    const late = new Promise((end) => setTimeout(end, PREPARED_MS));
    void Promise.race([this.renderer.compileAsync(this.scene, this.camera), late]).then(() => {
      this.preparing--;
      if (this.isDue) this.draw();
    });
  }

  private render(): void {
    this.frame = 0;
    this.isDue = false;
    const started = performance.now();
    this.before();
    this.renderer.render(this.scene, this.camera);
    const { figures, renderer } = this;
    figures.frames++;
    figures.calls = renderer.info.render.calls;
    figures.triangles = renderer.info.render.triangles;
    figures.lines = renderer.info.render.lines;
    figures.geometries = renderer.info.memory.geometries;
    this.after();
    figures.frameMs = performance.now() - started;
    figures.longestMs = Math.max(figures.longestMs, figures.frameMs);
  }

  private layGround(): void {
    if (this.ground) discard(this.ground);
    const size = this.bounds.getSize(new Vector3());
    const centre = this.bounds.getCenter(new Vector3());
    const cells = Math.max(6, Math.ceil((Math.max(size.x, size.y) * 1.6) / GRID_MM));
    const ground = new GridHelper(cells * GRID_MM, cells, new Color(colour("grid-axis")), new Color(colour("grid")));
    ground.rotation.x = Math.PI / 2;
    ground.position.set(centre.x, centre.y, Math.min(0, this.bounds.min.z) + 0.03);
    this.scene.add(ground);
    this.ground = ground;
    this.draw();
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (width === 0 || height === 0) return;
    const first = this.canvas.width <= 300;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (first) this.look("fit");
    else {
      cancelAnimationFrame(this.frame);
      this.render();
    }
  }

  dispose(): void {
    cancelAnimationFrame(this.frame);
    this.resizer.disconnect();
    this.watcher.disconnect();
    this.controls.dispose();
    if (this.ground) discard(this.ground);
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.canvas.remove();
  }
}

function discard(object: Object3D & { dispose(): void }): void {
  object.removeFromParent();
  object.dispose();
}
