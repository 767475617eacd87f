// Extents and amounts as text.
import { words } from "../words";
import { decimal, fixed } from "../words/format";
import type { Box } from "./measured";

export const MM_PER_INCH = 25.4;

function brief(value: number): string {
  return fixed(value, value < 10 ? 2 : value < 1000 ? 1 : 0);
}

/** Of numbers in a unit of so many mm: in mm and in inches, so that a wrong unit is seen. */
export function sizeText(box: Box, unitMm: number): string {
  const mm = box.map((value) => brief(value * unitMm)).join(" × ");
  const inches = box.map((value) => fixed((value * unitMm) / MM_PER_INCH, 2)).join(" × ");
  return `${mm} mm (${inches} in)`;
}

export function FileSize({ bytes }: { bytes: number }) {
  return <span class="muted">{bytes < 1e6 ? `${decimal(bytes / 1e3, 0)} kB` : `${decimal(bytes / 1e6, 1)} MB`}</span>;
}

const SHORT_S = 600; // below it seconds count

/** 1 h 32 min, 12 min, 3 min 20 s, 40 s. */
export function spanText(seconds: number): string {
  if (!Number.isFinite(seconds)) return words.dash;
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole} s`;
  if (whole < SHORT_S) return `${Math.floor(whole / 60)} min ${String(whole % 60).padStart(2, "0")} s`;
  const minutes = Math.round(seconds / 60);
  return minutes < 60 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, "0")} min`;
}

export function grams(value: number): string {
  return value < 1000 ? `${fixed(value, value < 10 ? 2 : 0)} g` : `${fixed(value / 1000, 2)} kg`;
}

