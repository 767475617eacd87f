// Name of what is shown, its colouring, the camera's places, and what else is drawn.
import { signal } from "@preact/signals";
import { api } from "../api/base";
import { shown } from "../state/jobs";
import { plan } from "../state/plan";
import { words } from "../words";
import { drawing } from "./drawing";
import { QUANTITIES, type Quantity } from "./path_material";
import { findings, layer, quantity, track, withBelow, withFindings, withMachine, withMetal, withPart } from "./state";

const say = words.view;
const isOpen = signal(false);

function choose(event: Event): void {
  quantity.value = (event.currentTarget as HTMLSelectElement).value as Quantity;
  const job = shown.peek();
  if (quantity.value === "deviation" && job?.proof_sha256) {
    drawing.peek()?.surface.load(`${api}/jobs/${job.id}/proof/surface?of=${job.proof_sha256}`);
  }
}

export function ViewHead() {
  const along = plan.value?.plan.layers[layer.value]?.bottom.slice(3);
  const hasNo = (name: Quantity) => (name === "time" && !track.value) || (name === "deviation" && !shown.value?.proof_sha256);
  return (
    <div class="view-head">
      <strong class="view-name">{shown.value?.name ?? ""}</strong>
      <div class="view-tools" role="group" aria-label={say.tools}>
        <select class="view-colouring" aria-label={say.colouring} value={quantity.value} onChange={choose}>
          {QUANTITIES.map((name) => (
            <option key={name} value={name} disabled={hasNo(name)}>
              {say.quantities[name]}
            </option>
          ))}
        </select>
        {drawing.value &&
          (["fit", "top", "side"] as const).map((name) => (
            <button type="button" class="view-button" key={name} onClick={() => drawing.peek()?.look(name, along)}>
              {say[name]}
            </button>
          ))}
        {drawing.value && (
          <button type="button" class="view-button" aria-expanded={isOpen.value} aria-controls="view-show" onClick={() => (isOpen.value = !isOpen.value)}>
            {say.show}
          </button>
        )}
        {findings.value.length > 0 && (
          <button type="button" class="view-button" aria-pressed={withFindings.value} onClick={() => (withFindings.value = !withFindings.value)}>
            {say.findings(findings.value.length)}
          </button>
        )}
      </div>
      {isOpen.value && (
        <div class="view-show" id="view-show" role="group" aria-label={say.showAria}>
          <Check on={withPart} label={say.part} />
          <Check on={withBelow} label={say.below} />
          <Check on={withMetal} label={say.metal} />
          <Check on={withMachine} label={say.machine} />
        </div>
      )}
    </div>
  );
}

function Check({ on, label }: { on: { value: boolean }; label: string }) {
  return (
    <label class="check">
      <input type="checkbox" checked={on.value} onChange={() => (on.value = !on.value)} />
      {label}
    </label>
  );
}
