// Going through the program by its lines: to one by its number, and on or back by lines, passes or layers.
import { signal } from "@preact/signals";
import { words } from "../words";
import { drawing } from "./drawing";
import { moment, scrubToLine, shownMode, track } from "./state";
import { STEPS, type Step } from "./track";

const say = words.view;
const step = signal<Step>("line");
const typed = signal<string | null>(null); // a number that is being written: what runs meanwhile does not write over it

/** One step on (1) or back (-1) from where the program is shown; from its first line where it is not. */
export function go(by: Step, way: 1 | -1): void {
  const lines = drawing.peek()?.track;
  if (!lines) return;
  const at = shownMode.peek() === "layer" ? null : moment.peek();
  scrubToLine(at ? lines.stepFrom(at.line, by, way) : 0);
}

/** Keys of the drawing: comma and full stop by lines, page keys by passes, with shift by layers. Whether it was one of them. */
export function stepByKey({ key, shiftKey }: KeyboardEvent): boolean {
  const way = { ",": -1, ".": 1, PageUp: -1, PageDown: 1 }[key] as 1 | -1 | undefined;
  if (!way || !drawing.peek()?.track) return false;
  go(key.startsWith("Page") ? (shiftKey ? "layer" : "pass") : "line", way);
  return true;
}

export function LineSteps() {
  const index = track.value;
  if (!index) return null;
  const line = moment.value && shownMode.value !== "layer" ? moment.value.line + 1 : "";
  return (
    <div class="line-steps" role="group" aria-label={say.lines}>
      <label for="line">N</label>
      <input
        id="line"
        type="number"
        inputMode="numeric"
        aria-label={say.lineNumber(index.lines)}
        min={1}
        max={index.lines}
        step={1}
        value={typed.value ?? line}
        onInput={(event) => (typed.value = event.currentTarget.value)}
        onBlur={() => (typed.value = null)}
        onChange={(event) => {
          const wanted = event.currentTarget.valueAsNumber;
          typed.value = null;
          if (Number.isFinite(wanted)) scrubToLine(Math.round(wanted) - 1);
        }}
      />
      <button type="button" class="view-button" aria-label={say.back(say.steps[step.value])} onClick={() => go(step.value, -1)}>
        ‹
      </button>
      <select aria-label={say.stepBy} value={step.value} onChange={(event) => (step.value = event.currentTarget.value as Step)}>
        {STEPS.map((name) => (
          <option key={name} value={name}>
            {say.steps[name]}
          </option>
        ))}
      </select>
      <button type="button" class="view-button" aria-label={say.on(say.steps[step.value])} onClick={() => go(step.value, 1)}>
        ›
      </button>
    </div>
  );
}
