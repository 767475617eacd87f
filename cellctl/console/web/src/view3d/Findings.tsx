// What the proof found: pins at their places in the drawing, and the same as a list; choosing in one shows it in the other.
import { Vector3 } from "three";
import type { ProofFinding } from "../api/types";
import { words } from "../words";
import { drawing } from "./drawing";
import type { PlanView } from "./plan_view";
import { chosenFinding, findings, showLayer, withFindings } from "./state";

const say = words.view;
const PINS_MAX = 120;
const SIGNS: Record<string, string> = { error: "✕", warning: "!" };

function choose(number: number): void {
  chosenFinding.value = chosenFinding.peek() === number ? -1 : number;
  const found = findings.peek()[chosenFinding.peek()];
  if (!found) return;
  withFindings.value = true;
  if (found.layer >= 0) showLayer(found.layer);
  if (found.at_mm) drawing.peek()?.stage.target(found.at_mm);
}

/** Put every pin where its place is on the screen; after a frame. */
export function placePins(view: PlanView): void {
  const { canvas, camera } = view.stage;
  for (const pin of canvas.parentElement?.parentElement?.querySelectorAll<HTMLElement>(".pin") ?? []) {
    const at = findings.peek()[Number(pin.dataset.number)]?.at_mm;
    if (!at) continue;
    const place = new Vector3(...at).project(camera);
    const isSeen = Math.abs(place.x) < 1 && Math.abs(place.y) < 1 && place.z < 1;
    pin.style.visibility = isSeen ? "visible" : "hidden";
    pin.style.transform = `translate(${((place.x + 1) / 2) * canvas.clientWidth}px, ${((1 - place.y) / 2) * canvas.clientHeight}px)`;
  }
}

export function Pins() {
  if (!withFindings.value || !drawing.value) return null;
  drawing.value.stage.draw();
  return (
    <div class="pins">
      {findings.value.slice(0, PINS_MAX).map((found, number) =>
        found.at_mm ? (
          <button
            type="button"
            key={number}
            class={`pin ${found.severity}`}
            data-number={number}
            aria-pressed={chosenFinding.value === number}
            aria-label={`${say.severities[found.severity]}: ${found.text}`}
            onClick={() => choose(number)}
          >
            <i aria-hidden="true">
              <span>{SIGNS[found.severity]}</span>
            </i>
          </button>
        ) : null,
      )}
    </div>
  );
}

export function FindingsList() {
  if (!withFindings.value || findings.value.length === 0) return null;
  return (
    <div class="findings" role="region" aria-label={say.findingsAria}>
      <ol>
        {findings.value.map((found, number) => (
          <li key={number}>
            <button type="button" class={`finding ${found.severity}`} aria-expanded={chosenFinding.value === number} onClick={() => choose(number)}>
              <i aria-hidden="true">{SIGNS[found.severity]}</i>
              <span>
                <b>{say.kind(found.kind)}</b>
                {chosenFinding.value !== number && <span class="muted"> {whereOf(found)}</span>}
              </span>
            </button>
            {chosenFinding.value === number && <Told found={found} />}
          </li>
        ))}
      </ol>
    </div>
  );
}

function whereOf(found: ProofFinding): string {
  return found.line > 0 ? say.findingAt(found.line, found.layer + 1) : "";
}

function Told({ found }: { found: ProofFinding }) {
  return (
    <div class="finding-told">
      <p>{found.text}</p>
      <p class="muted">{[whereOf(found), found.at_mm ? "" : say.noPlace].filter(Boolean).join(" · ")}</p>
      {found.help && <p class="muted">{found.help}</p>}
    </div>
  );
}
