// The live feed: one WebSocket that comes back by itself and misses no event.
import type { CellEvent, Job, LiveMessage, Page, Snapshot } from "./types";
import { api } from "./base";
import { get } from "./http";

const FIRST_WAIT_MS = 250;
const LAST_WAIT_MS = 3000;
const SILENT_MS = 5000; // an open socket that says nothing is opened anew
const LOG_AT_START = 200;

export interface Listener {
  snapshot(snapshot: Snapshot): void;
  events(events: CellEvent[]): void;
  job(job: Job): void;
  connected(is: boolean): void;
  /** Before every connection; raises if there is no session or no service. */
  opening(): Promise<void>;
  lastSeq(): number | null;
}

/** Keeps one connection until it is closed. */
export class Live {
  private socket: WebSocket | null = null;
  private wait = FIRST_WAIT_MS;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private heardAt = 0;
  private readonly watch: ReturnType<typeof setInterval>;
  private isClosed = false;

  constructor(private readonly listener: Listener) {
    this.watch = setInterval(() => this.checkSilence(), 1000);
    void this.open();
  }

  close(): void {
    this.isClosed = true;
    clearInterval(this.watch);
    clearTimeout(this.timer);
    this.socket?.close();
  }

  private async open(): Promise<void> {
    try {
      await this.listener.opening();
      if (this.listener.lastSeq() === null) {
        this.listener.events((await get<Page<CellEvent>>(`/cell/events?limit=${LOG_AT_START}`)).items);
      }
    } catch {
      this.later();
      return;
    }
    if (this.isClosed) return;
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const seq = this.listener.lastSeq();
    const socket = new WebSocket(`${scheme}://${location.host}${api}/live${seq === null ? "" : `?from=${seq}`}`);
    this.socket = socket;
    socket.onopen = () => {
      this.heardAt = performance.now();
      this.listener.connected(true);
    };
    socket.onmessage = (message) => this.hear(String(message.data));
    socket.onclose = () => {
      if (this.socket !== socket) return;
      this.socket = null;
      this.listener.connected(false);
      this.later();
    };
  }

  private hear(text: string): void {
    this.heardAt = performance.now();
    this.wait = FIRST_WAIT_MS;
    const message = JSON.parse(text) as LiveMessage;
    if (message.type === "snapshot") this.listener.snapshot(message.snapshot);
    else if (message.type === "event") this.listener.events([message.event]);
    else if (message.type === "job") this.listener.job(message.job);
  }

  private later(): void {
    if (this.isClosed) return;
    this.timer = setTimeout(() => void this.open(), this.wait);
    this.wait = Math.min(this.wait * 2, LAST_WAIT_MS);
  }

  private checkSilence(): void {
    if (this.socket?.readyState === WebSocket.OPEN && performance.now() - this.heardAt > SILENT_MS) this.socket.close();
  }
}
