// The page's end of the worker: one promise for each drawing that is asked for.
import { clientId, RequestError } from "../api/http";
import { words } from "../words";
import type { Asked, FromWorker, Made, ToWorker } from "./messages";

interface Waiting {
  done(made: Made): void;
  failed(error: Error): void;
}

export class Loader {
  private readonly worker = new Worker(new URL("./drawing.worker.ts", import.meta.url), { type: "module" });
  private readonly waiting = new Map<number, Waiting>();
  private last = 0;

  constructor() {
    this.worker.onmessage = ({ data }: MessageEvent<FromWorker>) => {
      const asked = this.waiting.get(data.id);
      this.waiting.delete(data.id);
      if ("made" in data) asked?.done(data.made);
      else asked?.failed(refused(data.status, data.error));
    };
  }

  /** A drawing. Rejects with a RequestError where it cannot be had, or with an AbortError. */
  ask(ask: Asked, signal: AbortSignal): Promise<Made> {
    const id = ++this.last;
    return new Promise((done, failed) => {
      const abort = () => {
        this.waiting.delete(id);
        this.tell({ id, abort: true });
        failed(new DOMException("not wanted any more", "AbortError"));
      };
      if (signal.aborted) return abort();
      signal.addEventListener("abort", abort, { once: true });
      const end = () => signal.removeEventListener("abort", abort);
      this.waiting.set(id, { done: (made) => (end(), done(made)), failed: (error) => (end(), failed(error)) });
      this.tell({ id, ask, headers: { "X-Client-Id": clientId } });
    });
  }

  private tell(message: ToWorker): void {
    this.worker.postMessage(message);
  }

  dispose(): void {
    this.worker.terminate();
    this.waiting.clear();
  }
}

/** status 0: no answer; 200: what came is no drawing */
function refused(status: number, detail: string): RequestError {
  const { problems } = words;
  if (status === 0) return new RequestError(0, { title: problems.noAnswer, detail: problems.noAnswerDetail });
  return new RequestError(status, { title: problems.refused(status), detail });
}
