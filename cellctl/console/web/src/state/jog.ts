// Jogging: a step per press, or motion for as long as something is held; what ends it, whatever happens to the page.
import { computed, effect, signal } from "@preact/signals";
import { newKey, post } from "../api/http";
import { words } from "../words";
import { isStale, snapshot } from "./cell";
import { mayCommand } from "./control";
import { told } from "./notices";
import { facts } from "./plan";

const KEEP_MS = 80; // three times within the cell's own dead-man of a jog
const ARMED_MS = 30_000; // without a key the keyboard moves nothing any more
const SUSPECT_FEED = 1000;

export const STEPS = [0.01, 0.1, 1, 10, 0] as const; // 0: as long as it is held
export const FEEDS = [100, 500, 2000, 6000] as const; // mm/min, deg/min
export const step = signal<number>(1);
export const feed = signal<number>(500);
export const held = signal(""); // "X+" while a jog is held
export const isArmed = signal(false); // whether keys on the jog buttons move the machine

export const canJog = computed(() => mayCommand.value && !isStale.value && ["IDLE", "JOGGING"].includes(snapshot.value?.state ?? ""));

let keeping = 0;
let disarming = 0;

/** Feed for an axis: not beyond what it may. */
export function feedFor(letter: string): number {
  const axis = facts.value?.axes.find((one) => one.letter === letter);
  const suspect = snapshot.value?.position ? SUSPECT_FEED : Infinity;
  return Math.min(feed.value, (axis?.max_velocity ?? Infinity) * 60, suspect);
}

/** Begin: one step, or motion until `release`. */
export async function press(letter: string, sense: 1 | -1): Promise<void> {
  if (!canJog.value || held.value) return;
  const continuous = step.value === 0;
  const body = { id: newKey("jog"), because: words.hand.jogBecause, axis: letter, distance: sense * (step.value || 1), feed: feedFor(letter), continuous };
  const name = `${letter}${sense > 0 ? "+" : "−"}`;
  if (continuous) {
    held.value = name;
    clearInterval(keeping);
    keeping = window.setInterval(() => void post("/cell/jog/keep", {}).catch(() => {}), KEEP_MS);
  }
  try {
    await post("/cell/jog", body);
    if (continuous && held.value !== name) end(); // let go before the cell had answered
  } catch (error) {
    release();
    told(error);
  }
}

function end(): void {
  void post("/cell/jog/end", {}).catch(() => {}); // unheard, the cell's dead-man ends it
}

/** Let go, for whatever reason. */
export function release(): void {
  clearInterval(keeping);
  if (!held.value) return;
  held.value = "";
  end();
}

/** Let keys move the machine, or no more. */
export function arm(on: boolean): void {
  isArmed.value = on;
  clearTimeout(disarming);
  if (on) disarming = window.setTimeout(() => arm(false), ARMED_MS);
  else release();
}

// A button that goes dead under the finger tells of no letting go.
effect(() => {
  if (!canJog.value && held.peek()) release();
});
window.addEventListener("blur", () => arm(false));
window.addEventListener("pagehide", () => arm(false));
document.addEventListener("visibilitychange", () => document.hidden && arm(false));
