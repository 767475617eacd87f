// One layer's passes as straight segments in the order in which they are executed.
import { Color } from "three";
import type { LayerView, Vector } from "../api/types";
import { colour } from "../state/theme";

const COLOURS: Record<string, string> = {
  deposit_contour: "path-contour",
  deposit_fill: "path-fill",
  deposit_overhang: "path-overhang",
  mill_face: "path-face",
  mill_side: "path-side",
  mill_scallop: "path-side",
};
const LOOK_AHEAD = 400; // segments: the tip is sought from where it was, forward
const NEAR_MM = 0.6; // a tip further away from every segment is on none of them

export interface Segments {
  count: number;
  ends: Float32Array; // (count, 6): both ends, mm, build frame
  colours: Float32Array; // (count, 6): the colour at both ends
  starts: number[]; // first segment of each operation, and the count at the end
  overhang: Float32Array; // both ends of each piece of an outline of what rests on nothing, mm
}

/** Colours of the processes and of links as the style sheet has them now. */
function palette(): (process: string, link: boolean) => Color {
  const made = new Map<string, Color>();
  return (process, link) => {
    const name = link ? "path-link" : (COLOURS[process] ?? "path-fill");
    let found = made.get(name);
    if (!found) made.set(name, (found = new Color(colour(name))));
    return found;
  };
}

export function segmentsOf(layer: LayerView): Segments {
  let count = 0;
  for (const operation of layer.operations) {
    for (const pass of operation.passes) count += Math.max(0, pass.points.length / 3 - 1);
  }
  const ends = new Float32Array(count * 6);
  const colours = new Float32Array(count * 6);
  const starts: number[] = [];
  const pick = palette();
  let at = 0;
  for (const operation of layer.operations) {
    starts.push(at);
    for (const { link, points } of operation.passes) {
      const { r, g, b } = pick(operation.process, link);
      for (let k = 0; k + 5 < points.length; k += 3, at++) {
        for (let j = 0; j < 6; j++) ends[at * 6 + j] = points[k + j] ?? 0;
        colours.set([r, g, b, r, g, b], at * 6);
      }
    }
  }
  starts.push(count);
  return { count, ends, colours, starts, overhang: pieces(layer.overhang ?? []) };
}

/** Polylines as the ends of their pieces. */
function pieces(lines: number[][]): Float32Array {
  const ends: number[] = [];
  for (const line of lines) for (let k = 0; k + 5 < line.length; k += 3) ends.push(...line.slice(k, k + 6));
  return new Float32Array(ends);
}

function squaredDistance(ends: Float32Array, segment: number, [x, y, z]: Vector): number {
  const o = segment * 6;
  const [ax, ay, az] = [ends[o] ?? 0, ends[o + 1] ?? 0, ends[o + 2] ?? 0];
  const [dx, dy, dz] = [(ends[o + 3] ?? 0) - ax, (ends[o + 4] ?? 0) - ay, (ends[o + 5] ?? 0) - az];
  const length = dx * dx + dy * dy + dz * dz;
  const along = length > 0 ? ((x - ax) * dx + (y - ay) * dy + (z - az) * dz) / length : 0;
  const t = Math.min(1, Math.max(0, along));
  return (ax + t * dx - x) ** 2 + (ay + t * dy - y) ** 2 + (az + t * dz - z) ** 2;
}

/** How many segments are executed: those before the operation, and within it those up to where the tip is, never back. */
export function executedSegments(segments: Segments, operation: number, tip: Vector, before: number): number {
  const first = segments.starts[operation] ?? 0;
  const end = segments.starts[operation + 1] ?? segments.count;
  const from = Math.min(Math.max(before, first), end);
  let nearest = NEAR_MM ** 2;
  let found = from;
  for (let segment = from; segment < Math.min(end, from + LOOK_AHEAD); segment++) {
    const distance = squaredDistance(segments.ends, segment, tip);
    if (distance < nearest) {
      nearest = distance;
      found = segment;
    }
  }
  return found;
}
