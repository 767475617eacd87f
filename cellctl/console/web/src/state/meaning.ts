// What each state of the cell means for the person before it: a tone, a sign, and what comes next.
import { computed } from "@preact/signals";
import { words } from "../words";
import { snapshot } from "./cell";
import { waiting } from "./jobs";
import { operations, plan } from "./plan";
import { alarmWords } from "./told";

export type Tone = "run" | "wait" | "hold" | "fault" | "rest" | "off";

/** Tone of each state; the sign goes with the tone, so that nothing is told by colour alone. */
const TONES: Record<string, Tone> = {
  OFFLINE: "off",
  UNHOMED: "hold",
  IDLE: "rest",
  HOMING: "wait",
  JOGGING: "wait",
  PURGING: "wait",
  PREPARING: "wait",
  RUNNING: "run",
  HOLDING: "hold",
  HELD: "hold",
  RESUMING: "wait",
  ABORTING: "fault",
  FAULT: "fault",
  STOPPED: "fault",
  RESETTING: "wait",
};

/** The tone of a state's name; "off" for one that is not known. */
export const toneOf = (state: string): Tone => TONES[state] ?? "off";

export const tone = computed<Tone>(() => toneOf(snapshot.value?.state ?? ""));
export const isLatched = computed(() => ["FAULT", "STOPPED"].includes(snapshot.value?.state ?? ""));

/** Why the cell is in this state: the first alarm, what it waits for, or who said so. */
export const cause = computed(() => {
  const now = snapshot.value;
  if (!now) return words.noDataWhy;
  const first = now.alarms[0];
  return first ? alarmWords(first).cause : words.cell.said(now.waiting || now.because);
});

/** What comes next, in words. */
export const next = computed(() => {
  const now = snapshot.value;
  const say = words.next;
  if (!now) return "";
  if (now.state === "IDLE") {
    const { table, approval } = waiting.value;
    return table ? (table.continues_job ? say.idleContinues(table.name) : say.idleQueued(table.name)) : approval ? say.idleWaiting(approval.name) : say.IDLE;
  }
  if (now.state === "RUNNING" || now.state === "PREPARING") return nextOperation();
  const fixed = (say as Record<string, unknown>)[now.state];
  return typeof fixed === "string" ? fixed : "";
});

function nextOperation(): string {
  const job = snapshot.value?.job;
  const all = operations.value;
  if (!job || job.id !== plan.value?.job || all.length === 0) return words.next.goesOn;
  const following = all[job.operation + 1];
  return following ? words.next.RUNNING(words.operation(following.process), following.layer + 1) : words.next.lastOperation;
}
