// Lines of passes in any colouring without being uploaded again: values go to the card once, the scale is looked up there.
import { Color, type DataTexture, GLSL3, RawShaderMaterial } from "three";
import { colour } from "../state/theme";
import { LINK, PROCESS_SHIFT } from "./flags";
import { textureOf, VIRIDIS } from "./colours";

export const QUANTITIES = ["process", "speed", "power", "tilt", "time", "deviation"] as const;
export type Quantity = (typeof QUANTITIES)[number];

const PATHS = ["path-contour", "path-fill", "path-overhang", "path-face", "path-side", "path-side"];

const VERTEX = `
precision highp float;
precision highp int;
uniform mat4 modelViewMatrix, projectionMatrix;
uniform int uQuantity;
uniform vec2 uRange;
uniform sampler2D uScale;
uniform vec3 uProcess[6];
uniform vec3 uLink;
uniform float uDone, uDim, uBright;
uniform bool uLinks;
in vec4 position;
in vec4 values;
in float time;
flat out vec4 vColour;
flat out int vSkip;
void main() {
  int flags = int(position.w);
  bool link = (flags & ${LINK}) != 0;
  float value = uQuantity == 1 ? values.x * 0.01 : uQuantity == 2 ? values.y * 0.1 : uQuantity == 3 ? values.z * 0.01 : time;
  bool plain = link || (uQuantity == 2 && value == 0.0);
  float share = clamp((value - uRange.x) / max(uRange.y - uRange.x, 1e-6), 0.0, 1.0);
  vec3 scaled = texture(uScale, vec2(share, 0.5)).rgb;
  vec3 shown = plain ? uLink : uQuantity == 0 ? uProcess[min(flags >> ${PROCESS_SHIFT}, 5)] : scaled;
  vColour = vec4(shown, float(gl_VertexID) <= uDone ? uBright : uDim);
  vSkip = (flags & 1) != 0 || (link && !uLinks) ? 1 : 0;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position.xyz, 1.0);
}`;

const FRAGMENT = `
precision highp float;
precision highp int;
flat in vec4 vColour;
flat in int vSkip;
out vec4 pixel;
void main() {
  if (vSkip != 0 || vColour.a <= 0.0) discard;
  vec3 linear = vColour.rgb;
  pixel = vec4(mix(linear * 12.92, 1.055 * pow(linear, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, linear)), vColour.a);
}`;

/** What all drawn passes share: the colouring. */
export class Colouring {
  readonly scale: DataTexture = textureOf(VIRIDIS);
  quantity: Quantity = "process";
  range: [number, number] = [0, 1];
  readonly process = PATHS.map(() => new Color());
  readonly link = new Color();

  constructor() {
    this.paint();
  }

  /** Colours of the style sheet as they are now. */
  paint(): void {
    PATHS.forEach((name, k) => this.process[k]!.set(colour(name)));
    this.link.set(colour("path-link"));
  }

  dispose(): void {
    this.scale.dispose();
  }
}

export class PathMaterial extends RawShaderMaterial {
  constructor(private readonly colouring: Colouring) {
    super({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      transparent: true,
      depthWrite: false,
      uniforms: {
        uQuantity: { value: 0 },
        uRange: { value: [0, 1] },
        uScale: { value: colouring.scale },
        uProcess: { value: colouring.process },
        uLink: { value: colouring.link },
        uDone: { value: -1 },
        uDim: { value: 1 },
        uBright: { value: 1 },
        uLinks: { value: true },
      },
    });
  }

  /** done: last vertex that is executed; opacities of what is not executed and of what is. */
  look(done: number, dim: number, bright: number, links: boolean): void {
    const { uniforms } = this;
    uniforms.uQuantity!.value = Math.min(4, QUANTITIES.indexOf(this.colouring.quantity)) % 5;
    if (this.colouring.quantity === "deviation") uniforms.uQuantity!.value = 0;
    uniforms.uRange!.value = this.colouring.range;
    uniforms.uDone!.value = done;
    uniforms.uDim!.value = dim;
    uniforms.uBright!.value = bright;
    uniforms.uLinks!.value = links;
  }
}
