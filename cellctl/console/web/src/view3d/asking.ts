// What is asked for of a row of numbered drawings: the newest wishes count, older ones are given up, and what failed is asked for again.
import type { Loader } from "./loader";
import type { Asked, Made } from "./messages";

const AT_ONCE = 3; // wishes under way: what is looked at, what comes next, and what its colours need
const AGAIN_MS = 3000; // after which a failed wish is asked for again

export class Asking {
  private readonly asked = new Map<number, AbortController>(); // the newest wish stands last
  private readonly failed = new Map<number, number>(); // and the timer that ends the wait

  /** came: with what was asked for; changed: when a wish failed, and when it may be asked for again */
  constructor(
    private readonly loader: Loader,
    private readonly of: (n: number) => Asked,
    private readonly came: (n: number, made: Made) => void,
    private readonly changed: () => void,
  ) {}

  get count(): number {
    return this.asked.size;
  }

  hasFailed(n: number): boolean {
    return this.failed.has(n);
  }

  /** Ask for a drawing, once however often it is wanted. */
  want(n: number): void {
    if (this.failed.has(n)) return;
    const aborter = this.asked.get(n) ?? this.ask(n);
    this.asked.delete(n);
    this.asked.set(n, aborter);
    for (const old of [...this.asked.keys()].slice(0, -AT_ONCE)) this.giveUp(old);
  }

  private ask(n: number): AbortController {
    const aborter = new AbortController();
    this.loader.ask(this.of(n), aborter.signal).then(
      (made) => {
        if (aborter.signal.aborted) return;
        this.asked.delete(n);
        this.came(n, made);
      },
      (error: unknown) => {
        if (aborter.signal.aborted) return;
        console.warn(error);
        this.asked.delete(n);
        this.failed.set(n, window.setTimeout(() => this.again(n), AGAIN_MS));
        this.changed();
      },
    );
    return aborter;
  }

  private again(n: number): void {
    this.failed.delete(n);
    this.changed();
  }

  private giveUp(n: number): void {
    this.asked.get(n)?.abort();
    this.asked.delete(n);
  }

  clear(): void {
    for (const n of [...this.asked.keys()]) this.giveUp(n);
    for (const timer of this.failed.values()) clearTimeout(timer);
    this.failed.clear();
  }
}
