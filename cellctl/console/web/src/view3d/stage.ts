// Camera, light and ground, and drawing when something changed: a page at rest draws nothing.
import { AmbientLight, Box3, Color, DirectionalLight, GridHelper, Object3D, PerspectiveCamera, Scene, Sphere, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { colour } from "../state/theme";

const PIXELS_MAX = 1.5; // device pixels per pixel: more costs without being seen on lines
const DIRECTIONS = { fit: new Vector3(0.75, -1, 0.7), top: new Vector3(0, -0.001, 1), side: new Vector3(0, -1, 0.12) };
const MARGIN = 1.35; // around the part, for the tool

export type ViewName = keyof typeof DIRECTIONS;

export class Stage {
  readonly scene = new Scene();
  private readonly renderer: WebGLRenderer;
  private readonly camera = new PerspectiveCamera(32, 1, 0.5, 5000);
  private readonly controls: OrbitControls;
  private readonly resizer: ResizeObserver;
  private ground: GridHelper | null = null;
  private bounds = new Box3(new Vector3(-40, -40, 0), new Vector3(40, 40, 40));
  private frame = 0;

  /** Raises Error where the browser has no WebGL. */
  constructor(private readonly host: HTMLElement) {
    this.renderer = new WebGLRenderer({ antialias: true, powerPreference: "low-power" });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, PIXELS_MAX));
    this.renderer.domElement.setAttribute("aria-hidden", "true");
    host.append(this.renderer.domElement);
    this.camera.up.set(0, 0, 1);
    const sun = new DirectionalLight(0xffffff, 2.2);
    sun.position.set(0.6, -1, 1.4);
    this.scene.add(new AmbientLight(0xffffff, 1.1), sun, this.camera);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("change", this.draw);
    this.resizer = new ResizeObserver(() => this.resize());
    this.resizer.observe(host);
    this.paint();
    this.look("fit");
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

  /** along: for "top", the direction to look against instead of z. */
  look(name: ViewName, along?: number[]): void {
    const direction = DIRECTIONS[name].clone();
    if (name === "top" && along) direction.add(new Vector3(along[0], along[1], (along[2] ?? 1) - 1));
    const sphere = this.bounds.getBoundingSphere(new Sphere());
    const radius = Math.max(sphere.radius, 5) * MARGIN;
    const half = (this.camera.fov * Math.PI) / 360;
    const distance = radius / Math.sin(Math.min(half, Math.atan(Math.tan(half) * this.camera.aspect)));
    this.camera.position.copy(sphere.center).addScaledVector(direction.normalize(), distance);
    this.camera.near = distance / 100;
    this.camera.far = distance * 20;
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(sphere.center);
    this.controls.update();
    this.draw();
  }

  /** Draw at the next frame, once however often it is asked. */
  readonly draw = (): void => {
    this.frame ||= requestAnimationFrame(() => {
      this.frame = 0;
      this.renderer.render(this.scene, this.camera);
    });
  };

  private layGround(): void {
    if (this.ground) discard(this.ground);
    const size = this.bounds.getSize(new Vector3());
    const centre = this.bounds.getCenter(new Vector3());
    const step = 10; // mm
    const cells = Math.max(6, Math.ceil((Math.max(size.x, size.y) * 1.6) / step));
    const ground = new GridHelper(cells * step, cells, new Color(colour("grid-axis")), new Color(colour("grid")));
    ground.rotation.x = Math.PI / 2;
    ground.position.set(centre.x, centre.y, Math.min(0, this.bounds.min.z) - 0.02);
    this.scene.add(ground);
    this.ground = ground;
    this.draw();
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (width === 0 || height === 0) return;
    const first = this.renderer.domElement.width <= 300;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (first) this.look("fit");
    else this.renderer.render(this.scene, this.camera);
  }

  dispose(): void {
    cancelAnimationFrame(this.frame);
    this.resizer.disconnect();
    this.controls.dispose();
    if (this.ground) discard(this.ground);
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.renderer.domElement.remove();
  }
}

function discard(object: Object3D & { dispose(): void }): void {
  object.removeFromParent();
  object.dispose();
}
