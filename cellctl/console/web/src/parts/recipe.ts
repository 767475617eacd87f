// The recipe as it is being chosen: bounds from the schema and the material, presets kept in this browser, what differs from the defaults.
import { words } from "../words";
import { fixed } from "../words/format";
import type { Field, MaterialFacts, Schema, Window } from "./documents";

export type Recipe = Record<string, unknown>;

const KEY = "recipes";
/** Of the tolerance: the cusp height where nobody chose another; as the schema's own defaults stand to each other. */
export const CUSP_SHARE = 0.4;
/** What the form asks in words of its own; every other field stands under "more". */
export const ASKED = ["material", "process", "build_direction", "tolerance_mm", "layer_height_mm", "stock_allowance_mm", "small_cutter_diameter_mm"];
const LEFT_OUT = ["schema_version", "stock"];
const WINDOWS = ["layer_height_mm", "speed_mm_s", "laser_w", "powder_g_min"];

/** The kind of a field's values without null. */
export function kindOf(field: Field): Field {
  return field.anyOf?.find((one) => one.type !== "null") ?? field;
}

export function isChoice(field: Field): boolean {
  return kindOf(field).enum !== undefined;
}

export function isNumber(field: Field): boolean {
  return ["number", "integer"].includes(kindOf(field).type ?? "");
}

/** Fields under "more", in the schema's order. */
export function otherFields(schema: Schema): [string, Field][] {
  return Object.entries(schema.properties).filter(([name]) => !ASKED.includes(name) && !LEFT_OUT.includes(name));
}

/** A field's name in words and its unit: "interpass_s" is interpass, s. */
export function nameOf(name: string): { label: string; unit: string } {
  const own = words.parts.fields[name];
  const [, stem = name, unit = ""] = /^(.*?)(?:_(mm|s|k|w|deg|mm_s|g_min))?$/.exec(name) ?? [];
  const units: Record<string, string> = { k: "K", w: "W", deg: "°", mm_s: "mm/s", g_min: "g/min" };
  return { label: own ?? stem.replaceAll("_", " "), unit: units[unit] ?? unit };
}

export interface Bounds {
  least: number | null;
  isAbove: boolean; // the least itself is not allowed
  most: number | null;
}

/** From the schema; where the material has a window, from that. */
export function boundsOf(name: string, field: Field, material: MaterialFacts | null): Bounds {
  const { minimum, exclusiveMinimum, maximum } = kindOf(field);
  const window = WINDOWS.includes(name) ? (material?.deposition[name] as Window | undefined) : undefined;
  if (window) return { least: window.min, isAbove: false, most: window.max };
  return { least: minimum ?? exclusiveMinimum ?? null, isAbove: minimum === undefined && exclusiveMinimum !== undefined, most: maximum ?? null };
}

/** What is wrong with a value: field, value, bound and unit; empty if nothing is. */
export function faultOf(name: string, value: unknown, field: Field | undefined, material: MaterialFacts | null): string {
  if (!field || value === undefined || value === null || !isNumber(field)) return "";
  const { label, unit } = nameOf(name);
  const number = Number(value);
  const { least, isAbove, most } = boundsOf(name, field, material);
  if (!Number.isFinite(number)) return words.parts.noNumber(label);
  const text = (bound: number) => `${fixed(bound, bound % 1 ? 2 : 0)} ${unit}`.trim();
  const asked = `${String(value)} ${unit}`.trim();
  if (least !== null && (isAbove ? number <= least : number < least)) return words.parts.tooSmall(label, asked, text(least), isAbove);
  if (most !== null && number > most) return words.parts.tooLarge(label, asked, text(most));
  return "";
}

/** What is sent: only what somebody chose; the cusp height follows the tolerance. */
export function sent(recipe: Recipe): Recipe {
  const chosen = Object.fromEntries(Object.entries(recipe).filter(([, value]) => value !== undefined && value !== null && value !== ""));
  const tolerance = Number(chosen.tolerance_mm);
  if (chosen.cusp_mm === undefined && tolerance > 0) chosen.cusp_mm = Number((CUSP_SHARE * tolerance).toPrecision(3));
  return chosen;
}

/** Recipes that were kept in this browser, by name. */
export function presets(): Record<string, Recipe> {
  try {
    return JSON.parse(localStorage.getItem(KEY) ?? "{}") as Record<string, Recipe>;
  } catch {
    return {}; // storage is switched off, or holds something else
  }
}

/** Keep or (null) forget a recipe. False if the browser keeps nothing. */
export function keepPreset(name: string, recipe: Recipe | null): boolean {
  const all = presets();
  if (recipe) all[name] = recipe;
  else delete all[name];
  try {
    localStorage.setItem(KEY, JSON.stringify(all));
    return true;
  } catch {
    return false;
  }
}
