// Dark or light, remembered in this browser.
import { signal } from "@preact/signals";

export type Theme = "dark" | "light";
const KEY = "theme";

function remembered(): Theme {
  try {
    return localStorage.getItem(KEY) === "light" ? "light" : "dark";
  } catch {
    return "dark"; // storage is switched off
  }
}

export const theme = signal<Theme>(remembered());
document.documentElement.dataset.theme = theme.value;

export function changeTheme(): void {
  const next = theme.peek() === "dark" ? "light" : "dark";
  document.documentElement.dataset.theme = next; // first: what draws itself anew reads its colours from there
  theme.value = next;
  try {
    localStorage.setItem(KEY, theme.value);
  } catch {
    return; // it lasts as long as the page
  }
}

/** A colour of the style sheet by its name. */
export function colour(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}
