// The few choices that people make, in words with units; all others under "more", as the schema has them.
import { useState } from "preact/hooks";
import { words } from "../words";
import { fixed } from "../words/format";
import type { Field, MaterialFacts, Schema } from "./documents";
import { MoreFields } from "./MoreFields";
import { boundsOf, CUSP_SHARE, faultOf, keepPreset, nameOf, presets, type Recipe } from "./recipe";

const say = words.parts;
const FINEST_MM = 0.02;
const COARSEST_MM = 1;
const STEPS = 100; // of the slider, evenly on a scale of ratios

export interface FormProps {
  schema: Schema;
  materials: MaterialFacts[];
  material: MaterialFacts | null;
  recipe: Recipe;
  change: (recipe: Recipe) => void;
}

export function RecipeForm({ schema, materials, material, recipe, change }: FormProps) {
  const set = (name: string, value: unknown) => change({ ...recipe, [name]: value });
  const select = (name: string, options: [string, string][]) => (
    <label>
      {nameOf(name).label}
      <select value={JSON.stringify(recipe[name] ?? schema.properties[name]?.default)} onChange={(event) => set(name, JSON.parse(event.currentTarget.value))}>
        {options.map(([value, text]) => (
          <option key={value} value={value}>
            {text}
          </option>
        ))}
      </select>
    </label>
  );
  const processes = Object.entries(words.submit.processes).map(([value, text]) => [JSON.stringify(value), text] as [string, string]);
  return (
    <section class="panel recipe" aria-label={say.recipe}>
      <Presets recipe={recipe} change={change} />
      <div class="form-grid">
        {select("material", materials.map(({ name }) => [JSON.stringify(name), name]))}
        {select("process", processes)}
        {select("build_direction", directions(recipe.build_direction))}
      </div>
      <Tolerance field={schema.properties.tolerance_mm} recipe={recipe} change={change} />
      <div class="form-grid">
        {["layer_height_mm", "stock_allowance_mm", "small_cutter_diameter_mm"].map((name) => (
          <NumberField key={name} name={name} field={schema.properties[name]} value={recipe[name]} material={material} set={(value) => set(name, value)} />
        ))}
      </div>
      <MoreFields schema={schema} material={material} recipe={recipe} set={set} />
    </section>
  );
}

/** The six axes and automatic; a direction that came otherwise stays choosable. */
function directions(now: unknown): [string, string][] {
  const usual = Object.entries(words.submit.directions).map(([value, text]): [string, string] => [value === "auto" ? '"auto"' : JSON.stringify(value.split(",").map(Number)), text]);
  const own = now === undefined ? '"auto"' : JSON.stringify(now);
  return usual.some(([value]) => value === own) ? usual : [...usual, [own, String(now)]];
}

function Tolerance({ field, recipe, change }: { field: Field | undefined; recipe: Recipe; change: (recipe: Recipe) => void }) {
  const value = Number(recipe.tolerance_mm ?? field?.default);
  const fault = faultOf("tolerance_mm", recipe.tolerance_mm, field, null);
  const span = Math.log(COARSEST_MM / FINEST_MM);
  const place = Math.round((STEPS * Math.log(Math.max(value, FINEST_MM) / FINEST_MM)) / span);
  const set = (next: number) => change({ ...recipe, tolerance_mm: next });
  const slide = (at: number) => set(Number((FINEST_MM * Math.exp((span * at) / STEPS)).toPrecision(2)));
  const cusp = Number(recipe.cusp_mm ?? CUSP_SHARE * value);
  return (
    <div class="tolerance">
      <label class="grow">
        {nameOf("tolerance_mm").label} (±), mm
        <input type="range" min={0} max={STEPS} value={place} aria-valuetext={`${fixed(value, 3)} mm`} onInput={(event) => slide(Number(event.currentTarget.value))} />
      </label>
      <label class="number">
        <span class="hidden-word">{say.toleranceNumber}</span>
        <input type="number" step="any" value={String(recipe.tolerance_mm ?? value)} aria-invalid={fault !== ""} onInput={(event) => set(event.currentTarget.valueAsNumber)} />
      </label>
      <small class={fault ? "tone-fault" : "muted"}>{fault ? `▲ ${fault}` : say.cuspFollows(fixed(cusp, 3), recipe.cusp_mm !== undefined)}</small>
    </div>
  );
}

export interface NumberProps {
  name: string;
  field: Field | undefined;
  value: unknown;
  material: MaterialFacts | null;
  set: (value: unknown) => void;
}

export function NumberField({ name, field, value, material, set }: NumberProps) {
  if (!field) return null;
  const { label, unit } = nameOf(name);
  const { least, isAbove, most } = boundsOf(name, field, material);
  const fault = faultOf(name, value, field, material);
  const given = material?.deposition[name];
  const usual = typeof given === "number" ? given : typeof field.default === "number" ? field.default : null;
  const range = least !== null && most !== null ? say.between(`${isAbove ? ">" : ""}${String(least)}`, String(most)) : most !== null ? say.atMost(String(most)) : "";
  return (
    <label>
      {[label, unit].filter(Boolean).join(", ")}
      <input
        type="number"
        step="any"
        name={name}
        value={value === undefined || value === null ? "" : String(value)}
        placeholder={usual === null ? say.ofMaterial : String(usual)}
        aria-invalid={fault !== ""}
        onInput={(event) => set(event.currentTarget.value === "" ? undefined : event.currentTarget.valueAsNumber)}
      />
      <small class={fault ? "tone-fault" : "muted"}>{fault ? `▲ ${fault}` : range}</small>
    </label>
  );
}

function Presets({ recipe, change }: { recipe: Recipe; change: (recipe: Recipe) => void }) {
  const [known, setKnown] = useState(presets());
  const [name, setName] = useState("");
  const keep = (value: Recipe | null) => {
    if (keepPreset(name.trim(), value)) setKnown(presets());
  };
  const names = Object.keys(known);
  return (
    <details class="presets">
      <summary>{say.presets(names.length)}</summary>
      <div class="row">
        {names.map((one) => (
          <button
            type="button"
            class="small"
            key={one}
            onClick={() => {
              setName(one);
              change({ ...known[one] });
            }}
          >
            {one}
          </button>
        ))}
      </div>
      <div class="row">
        <label class="grow">
          {say.presetName}
          <input value={name} maxLength={60} onInput={(event) => setName(event.currentTarget.value)} />
        </label>
        <button type="button" class="control" disabled={!name.trim()} onClick={() => keep(recipe)}>
          {say.keepPreset}
        </button>
        <button type="button" class="control" disabled={!(name.trim() in known)} onClick={() => keep(null)}>
          {say.forgetPreset}
        </button>
      </div>
    </details>
  );
}
