// Fetches drawings and makes bodies of their beads, beside the page: it never waits for this.
import { beadsOf, type Beads, type BeadSource, type Which } from "./beads";
import { unpacked, type Drawing } from "./container";
import type { Asked, FromWorker, Made, ToWorker } from "./messages";
import { normalsOf } from "./normals";
import { facetsOf } from "./stl";

const aborters = new Map<number, AbortController>();

interface Scope {
  onmessage: ((message: MessageEvent<ToWorker>) => void) | null;
  postMessage(message: FromWorker, transfer: Transferable[]): void;
}
const scope = self as unknown as Scope;

scope.onmessage = ({ data }) => {
  if ("abort" in data) {
    aborters.get(data.id)?.abort();
    return;
  }
  const aborter = new AbortController();
  aborters.set(data.id, aborter);
  void answer(data.id, data.ask, data.headers, aborter.signal).finally(() => aborters.delete(data.id));
};

async function answer(id: number, ask: Asked, headers: Record<string, string>, signal: AbortSignal): Promise<void> {
  let status = 0;
  try {
    const got = await fetch(ask.url, { credentials: "same-origin", headers, signal });
    ({ status } = got);
    if (!got.ok) throw new Error(got.statusText);
    const bytes = await got.arrayBuffer();
    const made = withBodies(ask, ask.kind === "part" ? facetsOf(bytes) : unpacked(bytes), bytes.byteLength);
    if (signal.aborted) return;
    scope.postMessage({ id, made }, buffersOf(made, bytes));
  } catch (error) {
    if (!signal.aborted) scope.postMessage({ id, status, error: error instanceof Error ? error.message : String(error) }, []);
  }
}

function buffersOf(made: Made, bytes: ArrayBuffer): Transferable[] {
  const found = new Set<Transferable>([bytes]);
  for (const array of Object.values(made.arrays)) found.add(array.buffer as ArrayBuffer);
  for (const beads of [made.beads, made.contours, made.inside]) {
    if (!beads) continue;
    for (const array of [beads.positions, beads.normals, beads.index, beads.cut, beads.vertexOf]) found.add(array.buffer as ArrayBuffer);
  }
  return [...found];
}

function withBodies(ask: Asked, drawing: Drawing, bytes: number): Made {
  const made: Made = { ...drawing, bytes };
  if (ask.kind === "surface") made.arrays.normal = normalsOf(drawing.arrays.position as Uint16Array, drawing.arrays.facets as Uint32Array);
  if (ask.kind === "layer") made.beads = beadsOf(layerSource(drawing), "all", 5);
  if (ask.kind === "whole") {
    const pieces = drawing.arrays.position!.length / 4;
    const source = wholeSource(drawing, ask.normals, Math.ceil(pieces / ask.beadPieces));
    made.contours = some(source, "contours", ask.beadPieces);
    if (pieces <= ask.beadPieces) made.inside = some(source, "inside", ask.beadPieces);
  }
  return made;
}

function some(source: BeadSource, which: Which, most: number): Beads {
  return beadsOf(source, which, source.positions.length / 4 > most ? 3 : 5);
}

interface Described {
  passes: number;
  bead_width_mm: number;
  bead_height_mm: number;
}

function common({ header, arrays }: Drawing): Omit<BeadSource, "at"> {
  return { origin: header.origin, step: header.step_mm, positions: arrays.position as Uint16Array, values: arrays.values as Uint16Array };
}

/** The beads of a layer: their size is its operation's, they grow along its bottom plane's normal. */
function layerSource(drawing: Drawing): BeadSource {
  const place = drawing.header.place as { bottom: number[] };
  const up = place.bottom.slice(3) as [number, number, number];
  const passes = drawing.arrays.passes as Int32Array;
  const operations = drawing.header.operations as Described[];
  let pass = 0;
  let found = { width: 0, height: 0, up };
  let end = -1;
  return {
    ...common(drawing),
    at(vertex) {
      if (vertex < end && vertex >= (passes[4 * pass] ?? 0)) return found;
      if (vertex < (passes[4 * pass] ?? 0)) pass = 0;
      while (4 * (pass + 1) < passes.length && passes[4 * (pass + 1)]! <= vertex) pass++;
      end = passes[4 * (pass + 1)] ?? Number.MAX_SAFE_INTEGER;
      const operation = operations[passes[4 * pass + 1] ?? 0];
      found = { width: operation?.bead_width_mm || 1, height: operation?.bead_height_mm || operation?.bead_width_mm || 1, up };
      return found;
    },
  };
}

/** every: of so many layers one is drawn, as high as all of them. */
function wholeSource(drawing: Drawing, normals: Float32Array, every: number): BeadSource {
  const layers = drawing.arrays.layers as Int32Array;
  const beads = drawing.arrays.beads as Float32Array;
  let layer = 0;
  const read = (n: number) => ({
    width: beads[2 * n] || 1,
    height: every * (beads[2 * n + 1] || beads[2 * n] || 1),
    up: [normals[3 * n] ?? 0, normals[3 * n + 1] ?? 0, normals[3 * n + 2] ?? 1] as [number, number, number],
  });
  let found = read(0);
  const at = (vertex: number) => {
    const before = layer;
    while (layer > 0 && vertex < layers[layer]!) layer--;
    while (layer + 2 < layers.length && vertex >= layers[layer + 1]!) layer++;
    if (layer !== before) found = read(layer);
    return found;
  };
  const isLeftOut = (vertex: number) => {
    at(vertex);
    return layer % every !== 0;
  };
  return every > 1 ? { ...common(drawing), at, isLeftOut } : { ...common(drawing), at };
}
