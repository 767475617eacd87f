// Points that were touched and not adopted yet: a page that is loaded again goes on with them.
import type { Kind } from "./Pictures";

export interface Point {
  joints: Record<string, number>;
  tool: number;
}

/** at: Unix time of the last point, s; cell: on whose axes they were touched */
export interface Touched {
  cell: string;
  at: number;
  kind: Kind;
  axis: string;
  tool: number;
  block: number;
  points: Point[];
}

const KEPT = "cellctl.touched";
const OLDEST_S = 4 * 3600; // a machine that stood as long is no longer as warm as it was

/** Keep what was touched; without points, nothing. */
export function keep(touched: Touched): void {
  try {
    if (touched.points.length === 0) sessionStorage.removeItem(KEPT);
    else sessionStorage.setItem(KEPT, JSON.stringify(touched));
  } catch {
    return; // storage is switched off: the points last as long as the page
  }
}

/** What was touched on this cell and is not too old. now: Unix time, s */
export function kept(cell: string, now: number): Touched | null {
  try {
    const found = JSON.parse(sessionStorage.getItem(KEPT) ?? "null") as Touched | null;
    const isGood = found && found.cell === cell && now - found.at < OLDEST_S;
    if (found && !isGood) sessionStorage.removeItem(KEPT);
    return isGood ? found : null;
  } catch {
    return null;
  }
}
