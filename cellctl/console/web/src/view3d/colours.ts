// Scales of colour that people with any eyes can read: lightness goes one way along them.
import { DataTexture, RGBAFormat, SRGBColorSpace } from "three";

/** Nine stops of viridis (S. van der Walt and N. Smith, CC0), from low to high. */
export const VIRIDIS = ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"];
/** Missing metal, the part's surface, too much metal: blue and orange differ for every eye, and both are darker than the middle. */
export const DEVIATION = ["#08306b", "#2171b5", "#6baed6", "#bdd7e7", "#e8e6e1", "#fdbe85", "#f08a3c", "#c4500f", "#6b2403"];

const STEPS = 256;

function channels(colour: string): [number, number, number] {
  const value = Number.parseInt(colour.slice(1), 16);
  return [value >> 16, (value >> 8) & 255, value & 255];
}

/** STEPS colours between the stops, RGBA. */
export function table(stops: string[]): Uint8Array<ArrayBuffer> {
  const found = new Uint8Array(STEPS * 4);
  for (let k = 0; k < STEPS; k++) {
    const at = (k / (STEPS - 1)) * (stops.length - 1);
    const low = Math.min(Math.floor(at), stops.length - 2);
    const [a, b] = [channels(stops[low]!), channels(stops[low + 1]!)];
    for (let d = 0; d < 3; d++) found[4 * k + d] = Math.round(a[d]! + (at - low) * (b[d]! - a[d]!));
    found[4 * k + 3] = 255;
  }
  return found;
}

export function textureOf(stops: string[]): DataTexture {
  const texture = new DataTexture(table(stops), STEPS, 1, RGBAFormat);
  texture.colorSpace = SRGBColorSpace;
  texture.needsUpdate = true;
  return texture;
}

/** The stops as a CSS gradient, low on the left. */
export function gradient(stops: string[]): string {
  return `linear-gradient(to right, ${stops.join(", ")})`;
}

/** Row of a table for a value. */
export function stepOf(value: number, low: number, high: number): number {
  const share = high > low ? (value - low) / (high - low) : 0.5;
  return Math.round(Math.min(1, Math.max(0, share)) * (STEPS - 1));
}
