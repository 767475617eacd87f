// The service's binary drawings: a JSON header and typed arrays that are views of the one block that came in.

export interface Header {
  kind: string;
  origin: [number, number, number];
  step_mm: number;
  [name: string]: unknown;
}

export type Numbers = Uint8Array | Int8Array | Uint16Array | Int16Array | Uint32Array | Int32Array | Float32Array;

export interface Drawing {
  header: Header;
  arrays: Record<string, Numbers>;
}

const MAGIC = 0x32564348; // "HCV2"
const TYPES = {
  u1: Uint8Array,
  i1: Int8Array,
  u2: Uint16Array,
  i2: Int16Array,
  u4: Uint32Array,
  i4: Int32Array,
  f4: Float32Array,
} as const;

type Place = [keyof typeof TYPES, number, number[]];

/** Header and arrays of a drawing. Raises RangeError for bytes that are none. */
export function unpacked(bytes: ArrayBuffer): Drawing {
  const view = new DataView(bytes);
  if (bytes.byteLength < 8 || view.getUint32(0, true) !== MAGIC) throw new RangeError("not a drawing of this version");
  const length = view.getUint32(4, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 8, length))) as Header & { arrays: Record<string, Place> };
  const arrays: Record<string, Numbers> = {};
  for (const [name, [type, offset, shape]] of Object.entries(header.arrays)) {
    arrays[name] = new TYPES[type](bytes, 8 + length + offset, shape.reduce((product, size) => product * size, 1));
  }
  return { header, arrays };
}
