// Moving along the time with a finger, a mouse or the keyboard.
import { pan, show, zoom } from "../state/history";

const STEP = 0.2; // of the time shown, per key
const CLOSER = 0.6; // per key or button
const WHEEL = 0.0015; // per pixel of a wheel

const KEYS: Record<string, () => void> = {
  ArrowLeft: () => pan(-STEP),
  ArrowRight: () => pan(STEP),
  PageUp: () => pan(-1),
  PageDown: () => pan(1),
  "+": () => zoom(CLOSER),
  "-": () => zoom(1 / CLOSER),
};

export const closer = () => zoom(CLOSER);
export const farther = () => zoom(1 / CLOSER);
export const back = () => pan(-0.5);
export const forward = () => pan(0.5);

/** Keys on the charts; the others go on to the page. follow : for the key End */
export function onKey(event: KeyboardEvent, follow: () => void): void {
  const act = event.key === "End" ? follow : KEYS[event.key];
  if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  act();
}

/** One pointer moves, two draw together or apart, a wheel with Ctrl or to the side zooms and moves. Returns what takes it away again. */
export function listen(host: HTMLElement, plotWidth: () => number): () => void {
  const down = new Map<number, number>(); // pointer -> x
  const end = new AbortController();
  const { signal } = end;
  const where = (x: number) => Math.min(Math.max((x - host.getBoundingClientRect().left) / host.clientWidth, 0), 1);
  host.addEventListener("pointerdown", (event) => down.set(event.pointerId, event.clientX), { signal });
  host.addEventListener(
    "pointermove",
    (event) => {
      const before = down.get(event.pointerId);
      if (before === undefined || event.clientX === before) return;
      const other = [...down].find(([id]) => id !== event.pointerId);
      if (other) zoom(Math.abs(before - other[1]) / Math.max(Math.abs(event.clientX - other[1]), 1), where(other[1]));
      else pan((before - event.clientX) / Math.max(plotWidth(), 1));
      down.set(event.pointerId, event.clientX);
    },
    { signal },
  );
  for (const name of ["pointerup", "pointercancel", "pointerleave"] as const) host.addEventListener(name, (event) => down.delete(event.pointerId), { signal });
  host.addEventListener(
    "wheel",
    (event) => {
      if (!event.ctrlKey && !event.shiftKey && Math.abs(event.deltaX) <= Math.abs(event.deltaY)) return; // the page scrolls
      event.preventDefault();
      if (event.ctrlKey) zoom(Math.exp(event.deltaY * WHEEL), where(event.clientX));
      else pan((event.deltaX || event.deltaY) / Math.max(plotWidth(), 1));
    },
    { signal, passive: false },
  );
  return () => end.abort();
}

/** Show a span that ends now. */
export function follow(span: number): void {
  show(span, null);
}
