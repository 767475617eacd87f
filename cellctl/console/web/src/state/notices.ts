// What could not be done, told until it is dismissed.
import { signal } from "@preact/signals";
import { RequestError } from "../api/http";

export interface Notice {
  title: string;
  detail: string;
  hint: string;
}

const SHOWN_MS = 12000;
export const notice = signal<Notice | null>(null);
let timer: ReturnType<typeof setTimeout> | undefined;

/** The words of an error. */
export function noticeOf(error: unknown): Notice {
  if (error instanceof RequestError) {
    return { title: error.problem.title, detail: error.problem.detail, hint: error.problem.hint ?? "" };
  }
  return { title: error instanceof Error ? error.message : String(error), detail: "", hint: "" };
}

/** Show an error to the operator. */
export function told(error: unknown): void {
  notice.value = noticeOf(error);
  clearTimeout(timer);
  timer = setTimeout(() => (notice.value = null), SHOWN_MS);
}

export function dismiss(): void {
  notice.value = null;
}
