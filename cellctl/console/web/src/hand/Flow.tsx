// Powder, gas and aiming beam by hand, and places to send the machine to.
import { useState } from "preact/hooks";
import { newKey, post } from "../api/http";
import { isStale, snapshot } from "../state/cell";
import { mayCommand, whyNot } from "../state/control";
import { told } from "../state/notices";
import { words } from "../words";
import { fixed } from "../words/format";

const say = words.hand;
const PURGE_G_MIN = 10;
const SECONDS = [3, 10, 30] as const;

function tell(path: string, body: object): void {
  post(`/cell/${path}`, { id: newKey(path.replace("/", "_")), ...body }).catch(told);
}

export function Flow() {
  const [seconds, setSeconds] = useState<number>(10);
  const now = snapshot.value;
  if (!now) return null;
  const { hand, feeder, state } = now;
  const off = !mayCommand.value || isStale.value;
  const idle = !off && state === "IDLE";
  const isPurging = state === "PURGING";
  return (
    <section class="panel flow">
      <h2>{say.flow}</h2>
      <div class="choice" role="group" aria-label={say.seconds}>
        <span class="muted">{isPurging ? say.left(fixed(hand.flow_left_s, 0)) : say.seconds}</span>
        {SECONDS.map((one) => (
          <button type="button" key={one} class="control" aria-pressed={one === seconds} onClick={() => setSeconds(one)}>
            {one} s
          </button>
        ))}
      </div>
      <div class="keys three">
        <button type="button" class="control" title={whyNot.value} disabled={!idle} onClick={() => tell("purge", { seconds, powder_g_min: PURGE_G_MIN, because: say.purgeBecause })}>
          {say.purge}
        </button>
        <button type="button" class="control" title={whyNot.value} disabled={!idle} onClick={() => tell("purge", { seconds, because: say.gasBecause })}>
          {say.gas}
        </button>
        <button type="button" class="control" title={whyNot.value} disabled={off || !isPurging} onClick={() => tell("purge/end", { because: say.shutBecause })}>
          {say.shut}
        </button>
      </div>
      <p class="muted small-print">{say.flowing(fixed(feeder.rate_readback_g_min, 1), fixed(feeder.carrier_gas_readback_l_min, 1), fixed(feeder.shield_gas_readback_l_min, 1))}</p>
      {hand.has_pilot && (
        <div class="choice">
          <span>
            {say.pilot} <b class={hand.pilot ? "badge pilot-on" : "badge"}>{hand.pilot ? say.pilotOn(fixed(hand.pilot_left_s, 0)) : say.pilotOff}</b>
          </span>
          <button type="button" class="control" title={whyNot.value} disabled={off || hand.pilot || !["IDLE", "UNHOMED", "JOGGING"].includes(state)} onClick={() => tell("pilot", { on: true, because: say.pilotBecause })}>
            {say.turnOn}
          </button>
          <button type="button" class="control" title={whyNot.value} disabled={off || !hand.pilot} onClick={() => tell("pilot", { on: false, because: say.pilotBecause })}>
            {say.turnOff}
          </button>
        </div>
      )}
      {hand.places.length > 0 && (
        <div class="choice" role="group" aria-label={say.places}>
          <span class="muted">{say.places}</span>
          {hand.places.map((place) => (
            <button type="button" key={place} class="control" title={whyNot.value} disabled={!idle} onClick={() => tell("go_to", { place, because: say.goBecause })}>
              {say.place[place] ?? place}
            </button>
          ))}
        </div>
      )}
    </section>
  );
}
