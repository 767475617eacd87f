// The newest snapshot, how old it is, and what the cell is told.
import { computed, signal } from "@preact/signals";
import { newKey, post } from "../api/http";
import type { CellEvent, Snapshot } from "../api/types";
import { told } from "./notices";

export const STALE_S = 1.0; // ten snapshots missed
const CLOCK_MS = 200; // how often ages are drawn anew
const EVENTS_MAX = 400; // kept in the log

export const snapshot = signal<Snapshot | null>(null);
export const events = signal<CellEvent[]>([]); // newest first
export const isConnected = signal(false);

let receivedAt = Number.NEGATIVE_INFINITY; // ms on the page's own clock: two machines' clocks may differ
const now = signal(performance.now());
setInterval(() => (now.value = performance.now()), CLOCK_MS);

/** Seconds since the last snapshot came in. */
export const dataAge = computed(() => {
  void snapshot.value;
  return Math.max(0, (now.value - receivedAt) / 1000);
});
export const isStale = computed(() => dataAge.value > STALE_S);

/** A new snapshot; an older one than shown is left out. */
export function take(next: Snapshot): void {
  receivedAt = performance.now();
  snapshot.value = next;
}

/** Events in any order; doubles are left out. */
export function takeEvents(more: CellEvent[]): void {
  const known = new Set(events.peek().map((event) => event.seq));
  const fresh = more.filter((event) => !known.has(event.seq));
  if (fresh.length === 0) return;
  events.value = [...fresh, ...events.peek()].sort((a, b) => b.seq - a.seq).slice(0, EVENTS_MAX);
}

/** The number of the newest event that is known; null if none. */
export function lastSeq(): number | null {
  return events.peek()[0]?.seq ?? null;
}

export const pending = signal<ReadonlySet<string>>(new Set());

/** Tell the cell; a refusal is shown. True if it was carried out. */
export async function command(verb: string, because: string): Promise<boolean> {
  pending.value = new Set([...pending.peek(), verb]);
  try {
    await post(`/cell/${verb}`, { id: newKey(verb), because });
    return true;
  } catch (error) {
    told(error);
    return false;
  } finally {
    pending.value = new Set([...pending.peek()].filter((other) => other !== verb));
  }
}
