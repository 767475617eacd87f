// Signs that say by their shape what colour says too.
import type { Tone } from "../state/meaning";

const PATHS: Record<string, string> = {
  run: "M8 5l12 7-12 7z",
  wait: "M7 3h10M7 21h10M8 3c0 5 4 6 4 9s-4 4-4 9M16 3c0 5-4 6-4 9s4 4 4 9",
  hold: "M8 5v14M16 5v14",
  fault: "M12 3l10 18H2zM12 10v5M12 17.8v.4",
  rest: "M5 12.5l4.5 4.5L19 7.5",
  off: "M6 6l12 12M18 6L6 18",
  abort: "M6 6h12v12H6z",
  reset: "M19 12a7 7 0 1 1-2.1-5M17 3v4.5h-4.5",
};

/** name: a tone, "abort" or "reset". */
export function Sign({ name }: { name: Tone | "abort" | "reset" }) {
  return (
    <svg class={`sign ${name}`} viewBox="0 0 24 24" aria-hidden="true" focusable="false">
      <path d={PATHS[name]} />
    </svg>
  );
}
