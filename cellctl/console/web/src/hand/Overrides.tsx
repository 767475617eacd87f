// Overrides: feed, laser and powder in percent, with the window that the material leaves.
import { isStale, snapshot } from "../state/cell";
import { mayCommand, whyNot } from "../state/control";
import { newKey, post } from "../api/http";
import { told } from "../state/notices";
import { words } from "../words";
import { fixed } from "../words/format";

const say = words.hand;
const DELTAS = [-10, -1, 1, 10] as const;

interface RowProps {
  name: string;
  field: "feed_percent" | "laser_percent" | "powder_percent";
  percent: number;
  least: number;
  most: number;
  set: string;
  window: string;
}

export function Overrides() {
  const now = snapshot.value;
  if (!now) return null;
  const { overrides: o, laser, feeder, tip_speed_mm_s: speed } = now;
  const window = ([low, high]: [number, number], unit: string) => (high > 0 ? say.window(fixed(low, 0), fixed(high, 0), unit) : say.noWindow);
  return (
    <section class="panel overrides">
      <h2>{say.overrides}</h2>
      <Row name={say.feedOverride} field="feed_percent" percent={o.feed_percent} least={o.feed_min} most={o.feed_max} set={`${fixed(speed, 1)} mm/s`} window={say.anyTime} />
      <Row name={say.laser} field="laser_percent" percent={o.laser_percent} least={o.laser_min} most={o.laser_max} set={`${fixed(laser.power_setpoint_w, 0)} W`} window={window(o.laser_window_w, "W")} />
      <Row name={say.powder} field="powder_percent" percent={o.powder_percent} least={o.powder_min} most={o.powder_max} set={`${fixed(feeder.rate_setpoint_g_min, 1)} g/min`} window={window(o.powder_window_g_min, "g/min")} />
    </section>
  );
}

function Row({ name, field, percent, least, most, set, window }: RowProps) {
  const off = !mayCommand.value || isStale.value || least === most;
  const ask = (next: number) => {
    const body = { id: newKey("override"), because: say.overrideBecause, [field]: Math.min(Math.max(next, least), most) };
    post("/cell/override", body).catch(told);
  };
  const button = (delta: number) => (
    <button type="button" key={delta} class="control" title={whyNot.value} aria-label={say.change(name, delta)} disabled={off || (delta < 0 ? percent <= least : percent >= most)} onClick={() => ask(percent + delta)}>
      {delta > 0 ? `+${delta}` : `−${-delta}`}
    </button>
  );
  return (
    <div class="override" role="group" aria-label={name}>
      <p class="name">
        <b>{name}</b>
        <span class={percent === 100 ? "percent" : "percent changed"}>{percent} %</span>
        <span class="muted">{set}</span>
      </p>
      <div class="keys">
        {DELTAS.slice(0, 2).map(button)}
        <button type="button" class="control" title={whyNot.value} aria-label={say.asProgrammed(name)} disabled={off || percent === 100} onClick={() => ask(100)}>
          100 %
        </button>
        {DELTAS.slice(2).map(button)}
      </div>
      <p class="muted window">{least === most ? window : `${say.bounds(least, most)} · ${window}`}</p>
    </div>
  );
}
