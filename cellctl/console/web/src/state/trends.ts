// What the trends show: the last minutes as they come in, and any past time as the service keeps it.
import type { Snapshot } from "../api/types";

export const LIVE_S = 630; // kept of what comes in; older times are asked for
const GAP_S = 1.0; // a longer silence is drawn as a gap

export const CHANNELS = [
  "laser_setpoint_w",
  "laser_readback_w",
  "powder_setpoint_g_min",
  "powder_readback_g_min",
  "carrier_gas_setpoint_l_min",
  "carrier_gas_readback_l_min",
  "shield_gas_setpoint_l_min",
  "shield_gas_readback_l_min",
  "tip_speed_mm_s",
  "planner_fill_percent",
  "rx_fill_percent",
  "tick_jitter_ms",
  "spindle_rpm",
  "feed_override_percent",
  "laser_override_percent",
  "powder_override_percent",
] as const;
export type Channel = (typeof CHANNELS)[number];
export type Series = (number | null)[];
export type Columns = Record<Channel, Series>;

function empty(): Columns {
  return Object.fromEntries(CHANNELS.map((name) => [name, []])) as unknown as Columns;
}

/** Rows in order of time. at : Unix s on the cell's clock; a gap is a row of nulls. */
export const live: { at: number[]; columns: Columns } = { at: [], columns: empty() };

let newestAt = 0;
let receivedAt = 0; // ms on the page's own clock: two machines' clocks may differ

/** Now on the clock of the cell (Unix s), as far as the page knows; 0 before anything came in. */
export function trendNow(): number {
  return newestAt && newestAt + (performance.now() - receivedAt) / 1000;
}

function valuesOf({ laser, feeder, cnc, tick, overrides, job, tip_speed_mm_s }: Snapshot): Record<Channel, number | null> {
  const light = (value: number) => (laser.connected ? value : null);
  const fed = (value: number) => (feeder.connected ? value : null);
  const told = (value: number | null) => (cnc.connected ? value : null);
  const runs = job !== null && job.outcome === "";
  return {
    laser_setpoint_w: light(laser.power_setpoint_w),
    laser_readback_w: light(laser.power_readback_w),
    powder_setpoint_g_min: fed(feeder.rate_setpoint_g_min),
    powder_readback_g_min: fed(feeder.rate_readback_g_min),
    carrier_gas_setpoint_l_min: fed(feeder.carrier_gas_setpoint_l_min),
    carrier_gas_readback_l_min: fed(feeder.carrier_gas_readback_l_min),
    shield_gas_setpoint_l_min: fed(feeder.shield_gas_setpoint_l_min),
    shield_gas_readback_l_min: fed(feeder.shield_gas_readback_l_min),
    tip_speed_mm_s: told(tip_speed_mm_s),
    planner_fill_percent: told(cnc.planner_fill_percent),
    rx_fill_percent: told(cnc.rx_fill_percent),
    tick_jitter_ms: tick.worst_ms,
    spindle_rpm: told(cnc.spindle_rpm),
    feed_override_percent: told(cnc.feed_override),
    laser_override_percent: runs ? overrides.laser_percent : null,
    powder_override_percent: runs ? overrides.powder_percent : null,
  };
}

function add(at: number, row: Record<Channel, number | null> | null): void {
  live.at.push(at);
  for (const name of CHANNELS) live.columns[name].push(row?.[name] ?? null);
}

function cut(from: number, count: number): void {
  live.at.splice(from, count);
  for (const name of CHANNELS) live.columns[name].splice(from, count);
}

/** Keep one snapshot's values; a read-back that nobody has is left open. What is too old goes, a hundred rows at a time. */
export function record(snapshot: Snapshot): void {
  receivedAt = performance.now();
  newestAt = snapshot.at;
  const last = live.at.at(-1);
  if (last !== undefined && snapshot.at <= last) {
    if (snapshot.at > last - GAP_S) return;
    cut(0, live.at.length); // the cell's clock was set back
  } else if (last !== undefined && snapshot.at - last > GAP_S) add(last + GAP_S / 2, null);
  add(snapshot.at, valuesOf(snapshot));
  const old = live.at.findIndex((at) => at > snapshot.at - LIVE_S);
  if (old > 100) cut(0, old);
}
