// The slider through the layers.
import type { PlanLayer } from "../api/types";
import { plan } from "../state/plan";
import { words } from "../words";
import { LineSteps } from "./LineSteps";
import { layer, layerCount, showLayer } from "./state";

const say = words.view;

/** Height of a level layer; tilt and thickness of another one; the piece where there are several. */
function placeOf(facts: PlanLayer): string {
  const pieces = plan.value?.plan.subcomponents ?? [];
  const name = pieces.length > 1 ? pieces[facts.subcomponent]?.name : undefined;
  const [least = 0, greatest = 0] = facts.thickness_mm ?? [];
  const where = facts.tilt_deg > 0 ? say.tilted(facts.tilt_deg, least, greatest) : say.height(facts.z_top);
  return [where, name && say.piece(name), facts.overhang_mm2 > 0 && say.overhang(facts.overhang_mm2)].filter(Boolean).join(" · ");
}

export function LayerBar() {
  if (layerCount.value === 0) return null;
  const facts = plan.value?.plan.layers[layer.value];
  return (
    <div class="layer-bar">
      <label for="layer">{say.layer}</label>
      <input
        id="layer"
        type="range"
        min={0}
        max={layerCount.value - 1}
        step={1}
        value={layer.value}
        onInput={(event) => showLayer(Number(event.currentTarget.value))}
      />
      <output for="layer">{say.layerOf(layer.value + 1, layerCount.value, facts ? placeOf(facts) : "")}</output>
      <LineSteps />
    </div>
  );
}
