// Every other field of a recipe, made from its schema: choices, numbers with bounds, and the rest as JSON.
import { useState } from "preact/hooks";
import { words } from "../words";
import type { Field, MaterialFacts, Schema } from "./documents";
import { isChoice, isNumber, kindOf, nameOf, otherFields, type Recipe } from "./recipe";
import { NumberField } from "./RecipeForm";

const say = words.parts;

interface MoreProps {
  schema: Schema;
  material: MaterialFacts | null;
  recipe: Recipe;
  set: (name: string, value: unknown) => void;
}

export function MoreFields({ schema, material, recipe, set }: MoreProps) {
  const fields = otherFields(schema);
  const changed = fields.filter(([name]) => recipe[name] !== undefined).length;
  return (
    <details class="more">
      <summary>{say.moreFields(fields.length, changed)}</summary>
      <div class="form-grid">
        {fields.map(([name, field]) => (
          <div key={name} title={field.description ?? ""}>
            <One name={name} field={field} value={recipe[name]} material={material} set={(value) => set(name, value)} />
          </div>
        ))}
      </div>
    </details>
  );
}

function One(props: { name: string; field: Field; value: unknown; material: MaterialFacts | null; set: (value: unknown) => void }) {
  const { name, field, value, set } = props;
  if (isNumber(field)) return <NumberField {...props} />;
  if (!isChoice(field)) return <Written {...props} />;
  return (
    <label>
      {nameOf(name).label}
      <select value={value === undefined ? "" : String(value)} onChange={(event) => set(event.currentTarget.value || undefined)}>
        <option value="">{say.usual(String(field.default))}</option>
        {kindOf(field).enum?.map((one) => (
          <option key={one}>{one}</option>
        ))}
      </select>
    </label>
  );
}

/** Lists and tables as JSON; what is none is told and not taken. */
function Written({ name, field, value, set }: { name: string; field: Field; value: unknown; set: (value: unknown) => void }) {
  const [text, setText] = useState(value === undefined ? "" : JSON.stringify(value));
  const [isBad, setBad] = useState(false);
  const take = (given: string) => {
    setText(given);
    try {
      set(given.trim() ? JSON.parse(given) : undefined);
      setBad(false);
    } catch {
      setBad(true);
    }
  };
  const { label, unit } = nameOf(name);
  return (
    <label>
      {[label, unit].filter(Boolean).join(", ")}
      <input value={text} placeholder={JSON.stringify(field.default)} spellcheck={false} aria-invalid={isBad} onInput={(event) => take(event.currentTarget.value)} />
      <small class={isBad ? "tone-fault" : "muted"}>{isBad ? `▲ ${say.noJson}` : say.asJson}</small>
    </label>
  );
}
