// What the fourth number of a drawn position says of its vertex, and the units of the values beside it.

export const FIRST = 1; // of its pass: the piece that ends here is none
export const LINK = 2;
export const PROCESS_SHIFT = 4;
export const PROCESSES = ["deposit_contour", "deposit_fill", "deposit_overhang", "mill_face", "mill_side", "mill_scallop"] as const;
export const CONTOUR = 0;
export const DEPOSITS = 3; // processes below this number add metal
export const UNITS = [0.01, 0.1, 0.01, 0.01] as const; // of the values: mm/s, W, deg, g/min
