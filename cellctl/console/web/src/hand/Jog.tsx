// Axes: where they are, how far they may go, and buttons that move them.
import type { TargetedKeyboardEvent, TargetedPointerEvent } from "preact";
import { useEffect } from "preact/hooks";
import { command, isStale, pending, snapshot } from "../state/cell";
import { mayCommand, whyNot } from "../state/control";
import { arm, canJog, feed, feedFor, FEEDS, held, isArmed, press, release, step, STEPS } from "../state/jog";
import { facts } from "../state/plan";
import { words } from "../words";
import { fixed } from "../words/format";

const say = words.hand;
const KEYS = new Set(["Enter", " "]);

export function Jog() {
  useEffect(() => () => arm(false), []);
  const axes = facts.value?.axes ?? [];
  const state = snapshot.value?.state ?? "";
  return (
    <section class="panel jog">
      <div class="panel-head">
        <h2>{say.jog}</h2>
        <span class="muted">{canJog.value ? say.jogFrame : whyNot.value || say.notNow(words.states[state] ?? state)}</span>
      </div>
      <Choice label={say.step} all={STEPS} value={step.value} text={(one) => (one === 0 ? say.continuous : fixed(one, one < 0.1 ? 2 : one < 1 ? 1 : 0))} choose={(one) => (step.value = one)} />
      <Choice label={say.feed} all={FEEDS} value={feed.value} text={(one) => String(one)} choose={(one) => (feed.value = one)} />
      <div class="jog-axes">
        {axes.map((axis) => (
          <AxisRow key={axis.letter} letter={axis.letter} unit={axis.kind === "rotary" ? "°" : "mm"} low={axis.min} high={axis.max} />
        ))}
      </div>
      <div class="row jog-feet">
        <button type="button" class="small arm" aria-pressed={isArmed.value} onClick={() => arm(!isArmed.value)}>
          {isArmed.value ? say.armed : say.arm}
        </button>
        <span class="grow" />
        <Rest verb="home" text={words.machine.home} because={words.machine.homeBecause} states={["IDLE", "UNHOMED"]} />
        <Rest verb="unlock" text={words.machine.unlock} because={words.machine.unlockBecause} states={["UNHOMED"]} />
      </div>
      <p class="muted small-print">{step.value === 0 ? say.holdHint : say.stepHint}</p>
    </section>
  );
}

interface ChoiceProps {
  label: string;
  all: readonly number[];
  value: number;
  text: (one: number) => string;
  choose: (one: number) => void;
}

function Choice({ label, all, value, text, choose }: ChoiceProps) {
  return (
    <div class="choice" role="group" aria-label={label}>
      <span class="muted">{label}</span>
      {all.map((one) => (
        <button type="button" key={one} class="control" aria-pressed={one === value} onClick={() => choose(one)}>
          {text(one)}
        </button>
      ))}
    </div>
  );
}

function Rest({ verb, text, because, states }: { verb: string; text: string; because: string; states: string[] }) {
  const state = snapshot.value?.state ?? "";
  if (!states.includes(state)) return null;
  const off = !mayCommand.value || isStale.value || pending.value.has(verb);
  return (
    <button type="button" class="control" title={whyNot.value} disabled={off} onClick={() => void command(verb, because)}>
      {text}
    </button>
  );
}

function AxisRow({ letter, unit, low, high }: { letter: string; unit: string; low: number; high: number }) {
  const cnc = snapshot.value?.cnc;
  const at = cnc?.machine[letter];
  const share = at === undefined ? 0 : Math.min(Math.max((at - low) / (high - low), 0), 1);
  return (
    <div class="jog-axis">
      <JogButton letter={letter} sense={-1} />
      <div class="where">
        <p>
          <b>{letter}</b>
          <span class="number">{fixed(at, 3)}</span>
          <span class="unit">{unit}</span>
        </p>
        <svg viewBox="0 0 100 6" preserveAspectRatio="none" role="img" aria-label={say.limits(letter, fixed(low, 0), fixed(high, 0), unit)}>
          <rect class="travel" x="0" y="2" width="100" height="2" />
          <rect class="place" x={share * 98.5} y="0" width="1.5" height="6" />
        </svg>
        <p class="ends">
          <span>{fixed(low, 0)}</span>
          <span>{say.work(fixed(cnc?.work[letter], 3))}</span>
          <span>{fixed(high, 0)}</span>
        </p>
      </div>
      <JogButton letter={letter} sense={1} />
    </div>
  );
}

function JogButton({ letter, sense }: { letter: string; sense: 1 | -1 }) {
  const name = `${letter}${sense > 0 ? "+" : "−"}`;
  const isHeld = step.value === 0;
  const down = (event: TargetedPointerEvent<HTMLButtonElement>) => {
    if (event.button !== 0) return;
    event.currentTarget.releasePointerCapture(event.pointerId); // a finger that slides off the button leaves it
    void press(letter, sense);
  };
  const key = (event: TargetedKeyboardEvent<HTMLButtonElement>) => {
    if (!KEYS.has(event.key)) return;
    event.preventDefault();
    if (event.repeat || !isArmed.value) return;
    arm(true);
    void press(letter, sense);
  };
  return (
    <button
      type="button"
      class={`control jog-key${held.value === name ? " is-held" : ""}`}
      aria-label={say.move(letter, sense > 0 ? "+" : "−", isHeld ? say.continuous : fixed(step.value, 2), String(feedFor(letter)))}
      disabled={!canJog.value}
      onPointerDown={down}
      onPointerUp={release}
      onPointerCancel={release}
      onPointerLeave={release}
      onContextMenu={(event) => event.preventDefault()}
      onKeyDown={key}
      onKeyUp={(event) => KEYS.has(event.key) && release()}
      onBlur={release}
    >
      {name}
    </button>
  );
}
