// Alarms by incident: the latched one, and the history by filter and page. Read again when something of it changes.
import { computed, effect, signal } from "@preact/signals";
import { get, post } from "../api/http";
import type { Incident, Page } from "../api/types";
import { events } from "./cell";
import { told } from "./notices";

const LIMIT = 20;
const KINDS = new Set(["alarm", "acknowledge", "reset"]);
const DAY_S = 86_400;
export const PERIODS = { all: 0, day: DAY_S, week: 7 * DAY_S, month: 30 * DAY_S } as const;
export type Period = keyof typeof PERIODS;

export interface Filter {
  code: string;
  job: string;
  period: Period;
}

export const filter = signal<Filter>({ code: "", job: "", period: "all" });
export const incidents = signal<readonly Incident[]>([]);
export const latched = signal<Incident | null>(null);
export const hasMore = computed(() => next.value !== null);
export const isReading = signal(false);
const next = signal<string | null>(null);

/** The number of the newest event that alarms are made of; what was read before it is out of date. */
const newest = computed(() => events.value.find(({ kind }) => KINDS.has(kind))?.seq ?? 0);

function query(cursor: string | null): string {
  const { code, job, period } = filter.peek();
  const asked = new URLSearchParams({ limit: String(LIMIT) });
  if (code) asked.set("code", code);
  if (job) asked.set("job", job);
  if (PERIODS[period]) asked.set("from", String(Date.now() / 1000 - PERIODS[period]));
  if (cursor) asked.set("cursor", cursor);
  return `/cell/alarms?${asked}`;
}

async function read(cursor: string | null): Promise<void> {
  isReading.value = true;
  try {
    const found = await get<Page<Incident>>(query(cursor));
    incidents.value = cursor ? [...incidents.peek(), ...found.items] : found.items;
    next.value = found.next;
    const first = (await get<Page<Incident>>("/cell/alarms?limit=1")).items[0];
    latched.value = first && first.ended_at === null ? first : null;
  } catch (error) {
    told(error);
  } finally {
    isReading.value = false;
  }
}

export function readOlder(): void {
  if (next.peek()) void read(next.peek());
}

/** Say that it was seen. */
export async function acknowledge(ident: number): Promise<void> {
  try {
    await post<Incident>(`/cell/alarms/${ident}/acknowledge`, {});
    await read(null);
  } catch (error) {
    told(error);
  }
}

/** Read, and again whenever the filter or the alarms change. Returns what ends it. */
export function followAlarms(): () => void {
  return effect(() => {
    void [newest.value, filter.value];
    void read(null);
  });
}
