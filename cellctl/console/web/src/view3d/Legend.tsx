// What the colours mean: processes by name, everything else as a scale with its range and unit.
import { words } from "../words";
import { decimal, duration } from "../words/format";
import { DEVIATION, gradient, VIRIDIS } from "./colours";
import { drawing, flat, loaded } from "./drawing";
import type { Quantity } from "./path_material";
import { quantity, shownMode, withMetal } from "./state";

const say = words.view;

/** A value of a quantity with its unit. */
export function valueText(name: Quantity, value: number): string {
  switch (name) {
    case "speed":
      return `${decimal(value, 1)} mm/s`;
    case "power":
      return `${decimal(value, 0)} W`;
    case "tilt":
      return `${decimal(value, 1)}°`;
    case "time":
      return duration(value);
    default:
      return `${value > 0 ? "+" : ""}${decimal(value, 2)} mm`;
  }
}

export function Legend() {
  void loaded.value;
  const name = quantity.value;
  const surface = drawing.value?.surface.state ?? "none";
  if (name === "process") return <Processes />;
  if (name === "deviation" && surface !== "here") {
    return <div class="legend">{surface === "absent" ? say.noSurface : say.loading}</div>;
  }
  const [low, high] = drawing.value?.range(name) ?? [0, 1];
  const middle = (low + high) / 2;
  return (
    <div class="legend" role="img" aria-label={say.scaleAria(say.quantities[name], valueText(name, low), valueText(name, high))}>
      <b>{say.quantities[name]}</b>
      <div class="scale" style={{ background: gradient(name === "deviation" ? DEVIATION : VIRIDIS) }} />
      <div class="scale-ends">
        <span>{valueText(name, low)}</span>
        <span>{name === "deviation" ? "0" : valueText(name, middle)}</span>
        <span>{valueText(name, high)}</span>
      </div>
      <small>{say.scaleNotes[name]}</small>
    </div>
  );
}

function Processes() {
  return (
    <ul class="legend" aria-label={say.legend}>
      {Object.entries(say.processes).map(([name, label]) => (
        <li key={name}>
          <i class={`swatch ${name}`} />
          {label}
        </li>
      ))}
      {!flat.value && <li class="muted">{withMetal.value ? (shownMode.value === "layer" ? say.metalPlanned : say.metalExecuted) : say.done}</li>}
    </ul>
  );
}
