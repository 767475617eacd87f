// What page and worker say to each other.
import type { Beads } from "./beads";
import type { Drawing } from "./container";

export type Asked =
  | { kind: "layer"; url: string }
  | { kind: "whole"; url: string; normals: Float32Array; beadPieces: number }
  | { kind: "lines" | "surface" | "part"; url: string };

export interface Made extends Drawing {
  bytes: number;
  beads?: Beads; // of a layer
  contours?: Beads; // of the whole
  inside?: Beads;
}

export type ToWorker = { id: number; ask: Asked; headers: Record<string, string> } | { id: number; abort: true };
export type FromWorker = { id: number; made: Made } | { id: number; status: number; error: string };
