// The one dialog that may be open. It lies over the page but never over state, HOLD and STOP, which stay in reach.
import { signal } from "@preact/signals";
import type { JSX } from "preact";

export interface Dialog {
  label: string; // its accessible name
  body: () => JSX.Element | null;
}

export const dialog = signal<Dialog | null>(null);
let before: Element | null = null;

/** Open a dialog; the focus comes back to where it was when it closes. */
export function openDialog(label: string, body: () => JSX.Element | null): void {
  if (!dialog.peek()) before = document.activeElement;
  dialog.value = { label, body };
}

export function closeDialog(): void {
  if (!dialog.peek()) return;
  dialog.value = null;
  const back = before;
  before = null;
  requestAnimationFrame(() => back instanceof HTMLElement && back.isConnected && back.focus()); // when the page takes a focus again
}
