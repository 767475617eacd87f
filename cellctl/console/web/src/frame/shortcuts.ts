// Keys that work on every page. None of them moves or lights anything: they stop, hold, or look.
import { computed, effect, signal } from "@preact/signals";
import { hold } from "../bar/Controls";
import { closeDialog, dialog } from "../state/dialog";
import { open, pages } from "../state/pages";
import { session } from "../state/session";
import { words } from "../words";

const KEPT = "letter-keys";
const say = words.frame;

/** F9 is STOP's own, in index.html. */
export const shortcuts = computed<readonly { key: string; name: string }[]>(() => [
  { key: "F9", name: say.keyNames.stop },
  { key: "F8", name: say.keyNames.hold },
  { key: `1 – ${pages.value.length}`, name: say.keyNames.pages },
  { key: "?", name: say.keyNames.menu },
  { key: "Esc", name: say.keyNames.close },
]);

function remembered(): boolean {
  try {
    return localStorage.getItem(KEPT) !== "off";
  } catch {
    return true; // storage is switched off
  }
}

/** Whether single digits and signs are shortcuts; whoever speaks to the page turns them off. */
export const hasLetterKeys = signal(remembered());
effect(() => {
  try {
    localStorage.setItem(KEPT, hasLetterKeys.value ? "on" : "off");
  } catch {
    return; // it lasts as long as the page
  }
});

function isTyping(target: EventTarget | null): boolean {
  return target instanceof HTMLElement && target.matches("input:not([type=checkbox], [type=radio], [type=range]), select, textarea, [contenteditable]");
}

function pressed(event: KeyboardEvent, openMenu: () => void): void {
  if (!session.peek() || event.ctrlKey || event.altKey || event.metaKey) return;
  if (event.key === "F8") {
    event.preventDefault();
    if (!event.repeat) hold();
  } else if (event.key === "Escape") {
    closeDialog();
  } else if (hasLetterKeys.peek() && !isTyping(event.target) && !dialog.peek()) {
    const page = pages.peek()[Number(event.key) - 1];
    if (page) open(page.name);
    else if (event.key === "?") openMenu();
  }
}

/** Listen for as long as the page lasts. */
export function listenForKeys(openMenu: () => void): void {
  addEventListener("keydown", (event) => pressed(event, openMenu));
}
