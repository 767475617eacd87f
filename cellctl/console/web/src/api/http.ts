// Requests to the service. Whatever it refuses becomes a RequestError that carries its problem document.
import type { Problem } from "./types";
import { words } from "../words";
import { api, houseApi } from "./base";

const OF_HOUSE = /^\/(session|fleet)\b/;

/** A refused or failed request, in words for the operator. status 0: no answer. */
export class RequestError extends Error {
  constructor(
    readonly status: number,
    readonly problem: Problem,
  ) {
    super(problem.detail || problem.title);
  }
}

/** By which the cell tells this page from others; a page that is loaded again keeps it. */
export const clientId = kept("cellctl.client", () => newKey("console").slice(0, 14));

/** What the session gave this page to send with everything that changes something. */
let csrf = "";
let askAgain: () => Promise<void> = () => Promise.resolve();

/** The word of a new session; how to ask for it again when another page of this browser opened one. */
export function useCsrf(word: string, again?: () => Promise<void>): void {
  csrf = word;
  if (again) askAgain = again;
}

function kept(key: string, make: () => string): string {
  const known = sessionStorage.getItem(key);
  if (known) return known;
  const made = make();
  sessionStorage.setItem(key, made);
  return made;
}

/** Any request under the API. Raises RequestError unless it is answered with 2xx. */
export async function checked(path: string, init: RequestInit, isFirst = true): Promise<Response> {
  let answer: Response;
  const headers: Record<string, string> = { ...(init.headers as Record<string, string> | undefined), "X-Client-Id": clientId };
  if (init.method && init.method !== "GET") headers["X-CSRF-Token"] = csrf;
  try {
    answer = await fetch(`${OF_HOUSE.test(path) ? houseApi : api}${path}`, { credentials: "same-origin", ...init, headers });
  } catch (error) {
    if (error instanceof DOMException && error.name === "AbortError") throw error;
    throw new RequestError(0, { title: words.problems.noAnswer, detail: words.problems.noAnswerDetail });
  }
  if (answer.ok) return answer;
  if (isFirst && answer.status === 403 && answer.headers.has("X-Session-Changed")) {
    await askAgain();
    return checked(path, init, false);
  }
  let problem: Problem = { title: words.problems.refused(answer.status), detail: "" };
  try {
    problem = { ...problem, ...((await answer.json()) as Problem) };
  } catch {
    // no problem document: the status is all there is to say
  }
  throw new RequestError(answer.status, problem);
}

/** GET a JSON document. */
export async function get<T>(path: string, signal?: AbortSignal): Promise<T> {
  return (await (await checked(path, signal ? { signal } : {})).json()) as T;
}

/** GET bytes. */
export async function getBytes(path: string, signal?: AbortSignal): Promise<ArrayBuffer> {
  return (await checked(path, signal ? { signal } : {})).arrayBuffer();
}

/** POST a JSON body. The key makes a repeated request harmless. */
export async function post<T>(path: string, body: object, idempotencyKey?: string): Promise<T> {
  const headers: Record<string, string> = { "Content-Type": "application/json" };
  if (idempotencyKey) headers["Idempotency-Key"] = idempotencyKey;
  return (await (await checked(path, { method: "POST", headers, body: JSON.stringify(body) })).json()) as T;
}

/** POST or PATCH a JSON body that is answered without one, or with one that does not matter. */
export async function send(method: "POST" | "PATCH" | "PUT", path: string, body: object): Promise<void> {
  await checked(path, { method, headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
}

/** POST a form with a file. */
export async function postForm<T>(path: string, form: FormData, idempotencyKey: string): Promise<T> {
  const headers = { "Idempotency-Key": idempotencyKey };
  return (await (await checked(path, { method: "POST", headers, body: form })).json()) as T;
}

/** DELETE. */
export async function remove(path: string): Promise<void> {
  await checked(path, { method: "DELETE" });
}

/** A fresh name for a request or command, so that carrying it out twice is noticed. */
export function newKey(prefix: string): string {
  const bytes = crypto.getRandomValues(new Uint8Array(12));
  return `${prefix}-${Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("")}`;
}
