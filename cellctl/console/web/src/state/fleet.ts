// The cells of the house, read now and then from the host that served the page, and which of them this page is for.
import { computed, effect, signal } from "@preact/signals";
import { base } from "../api/base";
import { get } from "../api/http";
import type { Fleet, FleetCell } from "../api/types";
import { session } from "./session";

const READ_MS = 2000; // as often as cells tell of themselves
const SINGLE_MS = 60_000; // where there is one cell only

export const fleet = signal<Fleet | null>(null);
const readAt = signal(0);
const clock = signal(performance.now());

export const isShared = computed(() => fleet.value?.shared ?? false);

/** The name of the cell that this page is for; "" while that is not known. */
export const hereCell = computed(() => (base ? decodeURIComponent(base.replace("/cells/", "")) : (fleet.value?.here ?? "")));

/** Alarms of the other cells. */
export const alarmsElsewhere = computed(() => (fleet.value?.cells ?? []).filter((one) => one.cell !== hereCell.value).reduce((sum, one) => sum + one.alarms, 0));

/** Seconds since a cell was heard: as told, and since then. */
export function ageOf(cell: FleetCell): number {
  return cell.age_s + Math.max(0, clock.value - readAt.value) / 1000;
}

async function read(): Promise<void> {
  try {
    fleet.value = await get<Fleet>("/fleet");
    readAt.value = performance.now();
  } catch {
    // what is known grows older, and says so
  }
}

/** Read for as long as somebody is signed in. */
export function followFleet(): void {
  let timer = 0;
  const again = () => {
    clearTimeout(timer);
    if (!session.peek()) return;
    void read().finally(() => (timer = window.setTimeout(again, base || isShared.peek() ? READ_MS : SINGLE_MS)));
  };
  effect(() => {
    if (session.value) again();
    else fleet.value = null;
  });
  setInterval(() => (clock.value = performance.now()), 500);
}

/** Make the whole page another cell's. Raises if the host does not answer: a page that cannot be loaded has no STOP. */
export async function openCell(cell: FleetCell): Promise<void> {
  const answer = await fetch(cell.path, { cache: "no-store" });
  if (!answer.ok) throw new Error(`${cell.cell}: ${answer.status}`);
  location.assign(cell.path);
}
