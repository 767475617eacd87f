// How large a chosen STL is in its own numbers, before it is sent: what a wrong unit makes of it strikes the eye.

const HEADER = 84; // bytes of a binary STL before its facets
const FACET = 50;
const READ_MAX = 400e6; // bytes; larger ones are measured by the service

export type Box = [number, number, number]; // extent along x, y, z in the file's numbers

/** Null for what is no STL, or too large to be read here. */
export async function measured(file: File): Promise<Box | null> {
  if (!/\.stl$/i.test(file.name) || file.size > READ_MAX || file.size < HEADER) return null;
  const bytes = await file.arrayBuffer();
  const count = new DataView(bytes).getUint32(80, true);
  return bytes.byteLength === HEADER + count * FACET ? ofBinary(new DataView(bytes), count) : ofText(new TextDecoder().decode(bytes));
}

function extent(): { take(k: number, value: number): void; size(): Box | null } {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  return {
    take(k, value) {
      if (value < (low[k] ?? 0)) low[k] = value;
      if (value > (high[k] ?? 0)) high[k] = value;
    },
    size() {
      const size = [0, 1, 2].map((k) => (high[k] ?? Number.NaN) - (low[k] ?? 0)) as Box;
      return size.every(Number.isFinite) ? size : null;
    },
  };
}

function ofBinary(view: DataView, count: number): Box | null {
  const box = extent();
  for (let facet = 0; facet < count; facet++) {
    for (let k = 0; k < 9; k++) box.take(k % 3, view.getFloat32(HEADER + facet * FACET + 12 + 4 * k, true));
  }
  return box.size();
}

function ofText(text: string): Box | null {
  const box = extent();
  for (const [, ...point] of text.matchAll(/vertex\s+(\S+)\s+(\S+)\s+(\S+)/g)) point.forEach((value, k) => box.take(k, Number(value)));
  return box.size();
}
