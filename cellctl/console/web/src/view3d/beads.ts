// Passes as bodies: each piece on which metal is laid becomes a stretch of bead, half an ellipse over the layer that carries it.
import { CONTOUR, DEPOSITS, FIRST, LINK, PROCESS_SHIFT } from "./flags";

export interface Beads {
  origin: [number, number, number];
  step: number;
  positions: Uint16Array; // (n, 4), steps from the origin
  normals: Int8Array; // (n, 4)
  index: Uint32Array;
  cut: Uint32Array; // (vertices of the path + 1,): how much of the index belongs to the path up to each vertex
  vertexOf: Uint32Array; // (n,) vertex of the path that each corner belongs to
  bytes: number;
}

export interface BeadSource {
  origin: [number, number, number];
  step: number;
  positions: Uint16Array;
  values: Uint16Array;
  /** Width and height, mm, and the direction in which the layer grows, at a vertex of the path. */
  at(vertex: number): { width: number; height: number; up: [number, number, number] };
  /** Whether a vertex is left out because the beads of another layer stand for its own too. */
  isLeftOut?(vertex: number): boolean;
}

export type Which = "contours" | "inside" | "all";

function isLaid(source: BeadSource, vertex: number, which: Which): boolean {
  const flags = source.positions[4 * vertex + 3]!;
  const process = flags >> PROCESS_SHIFT;
  if (flags & (FIRST | LINK) || process >= DEPOSITS || source.values[4 * vertex + 1]! === 0) return false;
  if (source.isLeftOut?.(vertex)) return false;
  return which === "all" || (which === "contours") === (process === CONTOUR);
}

/** Vertices of the path that carry a ring, and how many pieces there are. */
function counted(source: BeadSource, which: Which): { rings: number; pieces: number } {
  const n = source.positions.length / 4;
  let rings = 0;
  let pieces = 0;
  let before = false;
  for (let v = 1; v < n; v++) {
    const laid = isLaid(source, v, which);
    if (laid) {
      pieces++;
      rings += before ? 1 : 2;
    }
    before = laid;
  }
  return { rings, pieces };
}

/** The beads of a path; `corners` of the half ellipse: 3 from afar, 5 from near. */
export function beadsOf(source: BeadSource, which: Which, corners: 3 | 5): Beads {
  const { rings, pieces } = counted(source, which);
  const n = source.positions.length / 4;
  const { margin, origin, step } = frameOf(source);
  const made: Beads = {
    origin,
    step,
    positions: new Uint16Array(rings * corners * 4),
    normals: new Int8Array(rings * corners * 4),
    index: new Uint32Array(pieces * (corners - 1) * 6),
    cut: new Uint32Array(n + 1),
    vertexOf: new Uint32Array(rings * corners),
    bytes: 0,
  };
  const ring = ringMaker(source, made, corners, margin);
  let at = 0; // rings made
  let indices = 0;
  let before = false;
  for (let v = 1; v < n; v++) {
    made.cut[v] = indices;
    const laid = isLaid(source, v, which);
    if (laid) {
      if (!before) ring(v - 1, at++, v - 1, v);
      const next = v + 1 < n && isLaid(source, v + 1, which) ? v + 1 : v;
      ring(v, at++, v - 1, next);
      indices = stitch(made.index, indices, (at - 2) * corners, corners);
    }
    before = laid;
    made.cut[v] = indices;
  }
  made.cut[n] = indices;
  made.bytes = made.positions.byteLength + made.normals.byteLength + made.index.byteLength;
  return made;
}

function stitch(index: Uint32Array, at: number, first: number, corners: number): number {
  for (let k = 0; k + 1 < corners; k++) {
    const a = first + k;
    const b = a + corners;
    index[at++] = a;
    index[at++] = a + 1;
    index[at++] = b;
    index[at++] = a + 1;
    index[at++] = b + 1;
    index[at++] = b;
  }
  return at;
}

/** Quantised positions of the beads reach out of the path's own box by their size. */
function frameOf(source: BeadSource): { margin: number; origin: [number, number, number]; step: number } {
  const { width, height } = source.at(0);
  const margin = Math.max(width, height, 1) * 2;
  const [x, y, z] = source.origin;
  return { margin, origin: [x - margin, y - margin, z - margin], step: source.step + (2 * margin) / 65535 };
}

type RingMaker = (vertex: number, ring: number, from: number, to: number) => void;

function ringMaker(source: BeadSource, made: Beads, corners: number, margin: number): RingMaker {
  const p = source.positions;
  const turns = Array.from({ length: corners }, (_, k) => (Math.PI * k) / (corners - 1));
  return (vertex, ring, from, to) => {
    const { width, height, up } = source.at(vertex);
    let tx = p[4 * to]! - p[4 * from]!;
    let ty = p[4 * to + 1]! - p[4 * from + 1]!;
    let tz = p[4 * to + 2]! - p[4 * from + 2]!;
    const length = Math.hypot(tx, ty, tz) || 1;
    tx /= length;
    ty /= length;
    tz /= length;
    let sx = up[1] * tz - up[2] * ty;
    let sy = up[2] * tx - up[0] * tz;
    let sz = up[0] * ty - up[1] * tx;
    const side = Math.hypot(sx, sy, sz) || 1;
    sx /= side;
    sy /= side;
    sz /= side;
    for (let k = 0; k < turns.length; k++) {
      const across = Math.cos(turns[k]!);
      const high = Math.sin(turns[k]!);
      const o = 4 * (ring * corners + k);
      const w = (0.5 * width * across) as number;
      const h = height * high;
      made.vertexOf[ring * corners + k] = vertex;
      made.positions[o] = (p[4 * vertex]! * source.step + margin + w * sx + h * up[0]) / made.step;
      made.positions[o + 1] = (p[4 * vertex + 1]! * source.step + margin + w * sy + h * up[1]) / made.step;
      made.positions[o + 2] = (p[4 * vertex + 2]! * source.step + margin + w * sz + h * up[2]) / made.step;
      const nw = across / Math.max(width, 1e-6);
      const nh = (0.5 * high) / Math.max(height, 1e-6);
      const size = 127 / (Math.hypot(nw, nh) || 1);
      made.normals[o] = (nw * sx + nh * up[0]) * size;
      made.normals[o + 1] = (nw * sy + nh * up[1]) * size;
      made.normals[o + 2] = (nw * sz + nh * up[2]) * size;
    }
  };
}
