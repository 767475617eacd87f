// Which page is open, and which pages there are.
import { computed, signal } from "@preact/signals";
import { isShared } from "./fleet";

export type PageName = "machine" | "hand" | "jobs" | "parts" | "alarms" | "log" | "cells";

/** In the order of the rail. wide : the page takes the whole width; the 3-D view and the trends stand beside the others. */
const OF_ONE: readonly { name: PageName; wide: boolean }[] = [
  { name: "machine", wide: false },
  { name: "hand", wide: true },
  { name: "jobs", wide: false },
  { name: "parts", wide: true },
  { name: "alarms", wide: true },
  { name: "log", wide: true },
];

/** The cells of the house are a page where there are several. */
export const pages = computed(() => (isShared.value ? [...OF_ONE, { name: "cells" as const, wide: true }] : OF_ONE));

const opened = signal<PageName>("machine");

export const page = computed(() => opened.value);
export const isWide = computed(() => pages.value.some(({ name, wide }) => wide && name === opened.value));

/** Open a page. */
export function open(name: PageName): void {
  opened.value = name;
}
