// The one drawing of the page, and what is laid over it and follows it.
import { signal } from "@preact/signals";
import type { FlatView } from "./flat_view";
import type { PlanView } from "./plan_view";

export const drawing = signal<PlanView | null>(null);
export const flat = signal<FlatView | null>(null); // where the browser has no WebGL
export const drawn = signal(0); // frames
export const loaded = signal(0); // drawings that came in

/** The pointer over the drawing, pixels. */
export const reading = signal<{ x: number; y: number } | null>(null);
