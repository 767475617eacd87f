// Which time the trends page shows, and what the service says of it.
import { computed, signal } from "@preact/signals";
import { get } from "../api/http";
import type { TrendMark, TrendMarks, TrendsDocument } from "../api/types";
import { told } from "./notices";
import { open } from "./pages";
import { CHANNELS, live, trendNow, type Channel, type Columns, type Series } from "./trends";

const POINTS = 900; // on a chart half as wide as a screen more is not seen
const MARGIN = 0.5; // of the time shown, asked for to either side, so that a move shows something at once
const SETTLE_MS = 180; // a hand that moves the time is let finish
const AGAIN_S = 30; // between two questions while the newest time is followed
const SPAN_MIN_S = 5;
const SPAN_MAX_S = 400 * 86_400;
const AROUND_S = 120; // shown around a moment that somebody jumps to

export const SPANS = [120, 600, 3600, 8 * 3600] as const;

/** until : right edge (Unix s), null: it follows the newest */
export const window_ = signal<{ span: number; until: number | null }>({ span: SPANS[0], until: null });
export const isFollowing = computed(() => window_.value.until === null);
export const marks = signal<readonly TrendMark[]>([]);
export const isLoading = signal(false);
/** The moment that somebody jumped to (Unix s), drawn as a line; null if none. */
export const pointed = signal<number | null>(null);

export interface Band {
  least: Columns;
  greatest: Columns;
}

interface Loaded extends Band {
  from: number;
  to: number;
  at: number[];
  mean: Columns;
}

let loaded: Loaded | null = null;
export const loadedCount = signal(0);

export function edges(): [number, number] {
  const { span, until } = window_.peek();
  const to = until ?? trendNow();
  return [to - span, to];
}

const limited = (span: number) => Math.min(Math.max(span, SPAN_MIN_S), SPAN_MAX_S);

/** Show `span` seconds up to `until`; a right edge beyond now follows the newest. */
export function show(span: number, until: number | null): void {
  const follows = until === null || until >= trendNow();
  window_.value = { span: limited(span), until: follows ? null : until };
  later();
}

/** Move by a part of the time shown; to the left: negative. */
export function pan(part: number): void {
  const [, to] = edges();
  show(window_.peek().span, to + part * window_.peek().span);
}

/** Shorten (below 1) or lengthen the time shown; `where` of it (0 left, 1 right) stays in place. */
export function zoom(factor: number, where = 0.5): void {
  const { span, until } = window_.peek();
  const next = limited(span * factor);
  const [from, to] = edges();
  show(next, until === null && where >= 0.5 ? null : from + (to - from) * where + next * (1 - where));
}

/** Open the trends page at a moment. */
export function showMoment(at: number, span = AROUND_S): void {
  pointed.value = at;
  show(span, at + span / 2);
  open("log");
}

let timer: ReturnType<typeof setTimeout> | undefined;
let running: AbortController | null = null;

function later(): void {
  clearTimeout(timer);
  timer = setTimeout(() => void load(), SETTLE_MS);
}

/** Whether what is shown needs a question: it is not all in what was loaded and what came in since. */
function isMissing(): boolean {
  const [from, to] = edges();
  if (!trendNow()) return false;
  const liveFrom = live.at[0] ?? Number.POSITIVE_INFINITY;
  if (isFollowing.peek() && liveFrom <= from) return false;
  if (!loaded || loaded.from > from) return true;
  if (!isFollowing.peek()) return loaded.to < to && loaded.to < trendNow() - 1;
  return loaded.to < liveFrom || (window_.peek().span > SPANS[1] && trendNow() - loaded.to > AGAIN_S);
}

/** Ask again where that is needed; called now and then while the page is open. */
export function keepUp(): void {
  if (!running && isMissing()) void load();
}

function columnsOf(found: TrendsDocument, which: "min" | "max" | "mean"): Columns {
  const none = found.at.map(() => null);
  return Object.fromEntries(CHANNELS.map((name) => [name, found.series[name]?.[which] ?? none])) as unknown as Columns;
}

async function load(): Promise<void> {
  const [from, to] = edges();
  if (to <= 0) return;
  const margin = (to - from) * MARGIN;
  const span = { from: Math.max(from - margin, 0), to: Math.min(to + margin, trendNow()) };
  if (span.to <= span.from) return;
  running?.abort();
  const mine = new AbortController();
  running = mine;
  isLoading.value = true;
  const query = `from=${span.from.toFixed(3)}&to=${span.to.toFixed(3)}`;
  try {
    const [found, marked] = await Promise.all([
      get<TrendsDocument>(`/cell/trends?${query}&points=${POINTS * (1 + 2 * MARGIN)}`, mine.signal),
      get<TrendMarks>(`/cell/trends/marks?${query}`, mine.signal),
    ]);
    loaded = { from: span.from, to: span.to, at: found.at, mean: columnsOf(found, "mean"), least: columnsOf(found, "min"), greatest: columnsOf(found, "max") };
    marks.value = marked.items;
    loadedCount.value += 1;
  } catch (error) {
    if (!(error instanceof DOMException)) told(error);
  } finally {
    if (running === mine) {
      running = null;
      isLoading.value = false;
    }
  }
}

export interface Drawn {
  at: number[];
  of(channel: Channel, which: "mean" | "least" | "greatest"): Series;
}

/** What is drawn: what was loaded, and behind it what came in since. */
export function drawn(): Drawn {
  const [from, to] = edges();
  const liveFrom = live.at[0] ?? Number.POSITIVE_INFINITY;
  const isLive = liveFrom <= from && to > (live.at.at(-1) ?? 0) - 1;
  const old = isLive ? null : loaded;
  const behind = old ? live.at.findIndex((at) => at > old.to) : 0;
  const begin = behind < 0 ? live.at.length : behind;
  const at = [...(old?.at ?? []), ...live.at.slice(begin)];
  return { at, of: (channel, which) => [...(old?.[which][channel] ?? []), ...live.columns[channel].slice(begin)] };
}
