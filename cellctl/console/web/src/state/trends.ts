// The last two minutes of set-points and read-backs.
import type { Snapshot } from "../api/types";

export const SPAN_S = 120;
const GAP_S = 1.0; // a longer silence is drawn as a gap

export type Series = (number | null)[];

export interface Trends {
  time: number[];
  laserSet: Series;
  laserRead: Series;
  powderSet: Series;
  powderRead: Series;
}

export const trends: Trends = { time: [], laserSet: [], laserRead: [], powderSet: [], powderRead: [] };

const columns = (): (number | null)[][] => [trends.time, trends.laserSet, trends.laserRead, trends.powderSet, trends.powderRead];

function add(row: (number | null)[]): void {
  columns().forEach((column, i) => column.push(row[i] ?? null));
}

/** Seconds on the clock of the trends. */
export function trendNow(): number {
  return performance.now() / 1000;
}

/** Keep one snapshot's values; a read-back that nobody has is left open. */
export function record(snapshot: Snapshot): void {
  const at = trendNow();
  const { laser, feeder } = snapshot;
  const last = trends.time.at(-1);
  if (last !== undefined && at - last > GAP_S) add([last + GAP_S / 2, null, null, null, null]);
  add([
    at,
    laser.connected ? laser.power_setpoint_w : null,
    laser.connected ? laser.power_readback_w : null,
    feeder.connected ? feeder.rate_setpoint_g_min : null,
    feeder.connected ? feeder.rate_readback_g_min : null,
  ]);
  const old = trends.time.findIndex((time) => time > at - SPAN_S - 5);
  if (old > 50) for (const column of columns()) column.splice(0, old);
}
