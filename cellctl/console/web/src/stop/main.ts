// STOP: from the finger to the cell process's own listener, whatever the rest of the page does.
import { api, base } from "../api/base";
import { language } from "../words/language";
import { stopWords as say } from "../words/stop";

const REPEAT_MS = 200; // until acknowledged
const ANSWER_MS = 1000; // an attempt that takes longer is given up
const USE_ESTOP_MS = 2000; // unacknowledged for this long: the hardware chain is the way
const WEB_AFTER_MS = base ? 0 : 400; // from here on also by way of the web process; another cell's listener may not be reached from here
const ABOUT_MS = 5000; // between questions where the listener is
const STOP_KEY = "F9"; // works wherever the focus is
const SHOWN_MS = 15000; // how long an acknowledgement stays readable

interface Press {
  id: string;
  at: number;
  done: boolean;
}

const button = document.getElementById("stop-button") as HTMLButtonElement;
const said = document.getElementById("stop-said") as HTMLOutputElement;
let listener = base ? toldInPage() : nextPort();
let press: Press | null = null;

/** Where the listener of another cell is, as the host of this page knows it; "": it is not known, and no other cell's will do. */
function toldInPage(): string {
  return document.querySelector<HTMLMetaElement>('meta[name="stop-url"]')?.content ?? "";
}

/** Where the listener is by default: the port after the page's own. */
function nextPort(): string {
  const port = Number(location.port || (location.protocol === "https:" ? 443 : 80));
  return `${location.protocol}//${location.hostname}:${port + 1}/stop`;
}

function newId(): string {
  const bytes = crypto.getRandomValues(new Uint8Array(12));
  return `stop-${Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("")}`;
}

function show(text: string, kind: "" | "sent" | "done" | "lost"): void {
  said.textContent = text;
  said.className = kind;
  button.className = kind;
}

function acknowledged(mine: Press, state: string): void {
  if (mine.done) return;
  mine.done = true;
  const elapsed = performance.now() - mine.at;
  show(say.acknowledged(elapsed, state), "done");
  setTimeout(() => press === mine && show("", ""), SHOWN_MS);
}

/** One attempt. A body without a JSON type needs no preflight: one trip instead of two. */
async function attempt(url: string, mine: Press, body: object, json: boolean): Promise<void> {
  const aborter = new AbortController();
  const timer = setTimeout(() => aborter.abort(), ANSWER_MS);
  try {
    const answer = await fetch(url, {
      method: "POST",
      body: JSON.stringify(body),
      signal: aborter.signal,
      cache: "no-store",
      ...(json ? { headers: { "Content-Type": "application/json" } } : {}),
    });
    if (!answer.ok) return;
    const told = (await answer.json()) as { state?: string };
    acknowledged(mine, told.state ?? "");
  } catch {
    return; // the next attempt follows in any case
  } finally {
    clearTimeout(timer);
  }
}

function again(mine: Press): void {
  if (mine.done || press !== mine) return;
  const elapsed = performance.now() - mine.at;
  const body = { id: mine.id, because: say.because };
  if (listener) void attempt(listener, mine, body, false);
  if (elapsed >= WEB_AFTER_MS) void attempt(`${api}/cell/stop`, mine, body, true);
  show(elapsed >= USE_ESTOP_MS ? say.lost(elapsed) : say.sent, elapsed >= USE_ESTOP_MS ? "lost" : "sent");
  setTimeout(() => again(mine), REPEAT_MS);
}

/** at : when the finger came down, which may be before a busy page heard of it */
function pressed({ timeStamp: at }: Event): void {
  if (press && !press.done) return; // already on its way
  press = { id: newId(), at, done: false };
  again(press);
}

async function ask(): Promise<void> {
  try {
    const answer = await fetch(`${api}/cell/about`, { cache: "no-store" });
    if (!answer.ok) throw new Error(String(answer.status));
    const about = (await answer.json()) as { stop_url?: string };
    if (about.stop_url) listener = about.stop_url;
  } catch {
    setTimeout(() => void ask(), ABOUT_MS);
  }
}

button.addEventListener("pointerdown", pressed);
button.addEventListener("click", (event) => {
  if (event.detail === 0) pressed(event); // the keyboard; a pointer has already pressed
});
function byKey(event: KeyboardEvent): void {
  if (event.key !== STOP_KEY || event.repeat) return;
  event.preventDefault();
  pressed(event);
}

addEventListener("keydown", byKey, { capture: true });
document.documentElement.lang = language;
button.textContent = say.label;
button.setAttribute("aria-label", say.aria);
void ask();
