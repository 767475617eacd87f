// Sends a file in pieces (tus 1.0.0) and goes on where it was when the line breaks; the service says from which byte.
import { checked, newKey, RequestError } from "../api/http";
import type { Part } from "../api/types";

const PIECE = 4 << 20; // bytes: a fair progress bar, few round trips
const TUS = { "Tus-Resumable": "1.0.0" };
const WAITS_MS = [500, 1000, 2000, 4000, 8000];
const GIVE_UP_MS = 600_000; // without any byte getting through

export interface Sending {
  sent: number; // bytes
  total: number;
  isBroken: boolean; // waiting for the line to come back
  isChecking: boolean;
}

function base64(text: string): string {
  return btoa(String.fromCharCode(...new TextEncoder().encode(text)));
}

/** Whether trying again may help: no answer, or the service is busy or starting. */
function passes(error: unknown): boolean {
  return error instanceof RequestError && (error.status === 0 || error.status === 423 || error.status === 502 || error.status === 503);
}

async function patiently<T>(attempt: () => Promise<T>, tell: (isBroken: boolean) => void, signal: AbortSignal): Promise<T> {
  const begun = performance.now();
  for (let n = 0; ; n++) {
    try {
      const done = await attempt();
      tell(false);
      return done;
    } catch (error) {
      if (signal.aborted || !passes(error) || performance.now() - begun > GIVE_UP_MS) throw error;
      tell(true);
      await new Promise((go) => setTimeout(go, WAITS_MS[Math.min(n, WAITS_MS.length - 1)]));
      signal.throwIfAborted();
    }
  }
}

/** The part that a file becomes. Raises RequestError; AbortError where it was cancelled: what was sent is given up then. */
export async function send(file: File, units: "mm" | "inch", tell: (state: Sending) => void, signal: AbortSignal): Promise<Part> {
  const state: Sending = { sent: 0, total: file.size, isBroken: false, isChecking: false };
  const told = (change: Partial<Sending>) => tell(Object.assign(state, change) && { ...state });
  const broken = (isBroken: boolean) => isBroken !== state.isBroken && told({ isBroken });
  const metadata = `filename ${base64(file.name)},units ${base64(units)}`;
  const head = { ...TUS, "Upload-Length": String(file.size), "Upload-Metadata": metadata, "Idempotency-Key": newKey("upload") };
  const made = await patiently(() => checked("/uploads", { method: "POST", headers: head, signal }), broken, signal);
  const path = (made.headers.get("Location") ?? "").replace(/^\/api\/v1/, "");
  try {
    while (state.sent < file.size) {
      const sent = await patiently(() => piece(path, file, state, signal), broken, signal);
      told({ sent });
    }
    told({ isChecking: true });
    const part = await patiently(() => checked(`${path}/part`, { method: "POST", headers: TUS, signal }), broken, signal);
    return (await part.json()) as Part;
  } catch (error) {
    if (!passes(error)) void checked(path, { method: "DELETE", headers: TUS }).catch(() => undefined);
    throw error;
  }
}

/** Send the next piece; after a break ask first how much has arrived. The bytes that are there. */
async function piece(path: string, file: File, state: Sending, signal: AbortSignal): Promise<number> {
  if (state.isBroken) {
    const head = await checked(path, { method: "HEAD", headers: TUS, signal });
    const there = Number(head.headers.get("Upload-Offset"));
    if (there !== state.sent) return there;
  }
  const headers = { ...TUS, "Content-Type": "application/offset+octet-stream", "Upload-Offset": String(state.sent) };
  const body = file.slice(state.sent, state.sent + PIECE);
  const answer = await checked(path, { method: "PATCH", headers, body, signal });
  return Number(answer.headers.get("Upload-Offset"));
}
