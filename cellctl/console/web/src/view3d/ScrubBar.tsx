// Going through the program by time: a slider, playing at three speeds, what holds at that moment, and back to live.
import { effect } from "@preact/signals";
import { plan } from "../state/plan";
import { words } from "../words";
import { decimal, duration } from "../words/format";
import { drawing, loaded } from "./drawing";
import { goLive, isPlaying, moment, onCell, rate, RATES, scrubLine, scrubTime, scrubTo, shownMode, track } from "./state";

const say = words.view;
const STEPS_PER_PROGRAM = 2000;

effect(() => {
  if (!isPlaying.value) return undefined;
  let last = performance.now();
  let frame = requestAnimationFrame(function step(now) {
    const end = track.peek()?.duration_s ?? 0;
    scrubTo(scrubTime.peek() + ((now - last) / 1000) * rate.peek());
    last = now;
    if (scrubTime.peek() >= end) isPlaying.value = false;
    else frame = requestAnimationFrame(step);
  });
  return () => cancelAnimationFrame(frame);
});

function play(): void {
  if (shownMode.peek() !== "scrub" || scrubLine.peek() >= 0) scrubTo(moment.peek()?.time ?? scrubTime.peek());
  if (scrubTime.peek() >= (track.peek()?.duration_s ?? 0)) scrubTime.value = 0;
  isPlaying.value = !isPlaying.peek();
}

export function ScrubBar() {
  const index = track.value;
  if (!index) return null;
  const isAtTime = shownMode.value === "scrub" && scrubLine.value < 0;
  const time = isAtTime ? scrubTime.value : shownMode.value === "layer" ? 0 : (moment.value?.time ?? 0);
  const move = (event: { currentTarget: HTMLInputElement }) => {
    isPlaying.value = false;
    scrubTo(Number(event.currentTarget.value));
  };
  return (
    <div class={shownMode.value === "scrub" ? "scrub-bar is-scrubbing" : "scrub-bar"}>
      <button type="button" class="view-button" aria-label={isPlaying.value ? say.pause : say.play} aria-pressed={isPlaying.value} onClick={play}>
        {isPlaying.value ? "❚❚" : "▶"}
      </button>
      <select
        class="view-rate"
        aria-label={say.rate}
        value={String(rate.value)}
        onChange={(event) => (rate.value = Number(event.currentTarget.value))}
      >
        {RATES.map((times) => (
          <option key={times} value={String(times)}>
            {times}×
          </option>
        ))}
      </select>
      <input
        type="range"
        aria-label={say.time}
        aria-valuetext={duration(time)}
        min={0}
        max={index.duration_s}
        step={index.duration_s / STEPS_PER_PROGRAM}
        value={time}
        onInput={move}
      />
      <output>{say.timeOf(duration(time), duration(index.duration_s))}</output>
      <button type="button" class="view-button" aria-label={say.liveAria} aria-pressed={shownMode.value === "live"} disabled={!onCell.value} onClick={goLive}>
        {say.live}
      </button>
    </div>
  );
}

/** What holds at the scrubbed moment; and that it is not now. */
export function ScrubCard() {
  void loaded.value;
  if (shownMode.value !== "scrub") return null;
  const at = moment.value;
  const view = drawing.value;
  const holding = at && view ? view.holdingAt(at) : null;
  return (
    <div class="scrub-card" role="status">
      <b class="not-live">{onCell.value ? say.notLive : say.scrubbing}</b>
      {at && (
        <p>
          {say.atLine(at.line + 1, at.layer + 1, plan.value?.plan.layers.length ?? 0)}
          {holding && <br />}
          {holding && (holding.isLink ? say.onLink : `${words.operation(holding.process)}, ${say.pass(holding.pass + 1)}`)}
        </p>
      )}
      {holding && (
        <dl class="pairs">
          <dt>{say.quantities.speed}</dt>
          <dd>{decimal(holding.speed, 1)} mm/s</dd>
          <dt>{say.quantities.power}</dt>
          <dd>{decimal(holding.power, 0)} W</dd>
          <dt>{say.powder}</dt>
          <dd>{decimal(holding.powder, 1)} g/min</dd>
          <dt>{say.gas}</dt>
          <dd>{decimal(holding.gas, 1)} L/min</dd>
          <dt>{say.quantities.tilt}</dt>
          <dd>{decimal(holding.tilt, 1)}°</dd>
        </dl>
      )}
      {view && <small>{view.toolName}</small>}
    </div>
  );
}
