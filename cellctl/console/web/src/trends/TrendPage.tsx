// Trends of any time: all channels under one axis of time, with what happened on it, and the event log.
import { effect, signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import { EventLog } from "../log/EventLog";
import { events, isStale } from "../state/cell";
import { drawn, edges, isFollowing, keepUp, loadedCount, marks, pointed, show, window_ } from "../state/history";
import { theme } from "../state/theme";
import { words } from "../words";
import { clock, fixed } from "../words/format";
import { CHARTS, optionsOf, rowsOf, SIGNS, type Chart } from "./charts";
import { follow, listen, onKey } from "./gestures";
import { TimeBar } from "./TimeBar";

const say = words.trendPage;
const PERIOD_MS = 500; // between drawings while the newest time is followed
const CALM_MS = 1000; // the same where much is drawn
const CALM_S = 300;
const MARKS_SHOWN = 40;

const cursorAt = signal<number | null>(null); // Unix s, on all charts at once; null: nowhere
const drawnCount = signal(0);

function connect(host: HTMLElement, chart: Chart): () => void {
  let plot: uPlot | null = null;
  const build = () => {
    plot?.destroy();
    plot = new uPlot(optionsOf(chart, host.clientWidth, host.clientHeight), rowsOf(chart, drawn()), host);
  };
  const stopTheme = effect(() => {
    void theme.value;
    build();
  });
  const draw = () => plot?.setData(rowsOf(chart, drawn()));
  const stopDrawing = effect(() => {
    void [window_.value, loadedCount.value, drawnCount.value, marks.value, pointed.value];
    draw();
  });
  const stopCursor = effect(() => {
    const at = cursorAt.value;
    plot?.setCursor(at === null ? { left: -10, top: -10 } : { left: plot.valToPos(at, "x"), top: 0 }, false);
  });
  const resizer = new ResizeObserver(() => plot?.setSize({ width: host.clientWidth, height: host.clientHeight }));
  resizer.observe(host);
  const unpoint = followPointer(host, (x) => plot && plot.posToVal(x - plot.over.getBoundingClientRect().left, "x"));
  const deaf = listen(host, () => (plot ? plot.bbox.width / devicePixelRatio : host.clientWidth));
  return () => {
    resizer.disconnect();
    stopTheme();
    stopDrawing();
    stopCursor();
    deaf();
    unpoint();
    plot?.destroy();
  };
}

/** The cursor is where the pointer is; a finger leaves it where it was lifted, a mouse takes it along. */
function followPointer(host: HTMLElement, timeOf: (x: number) => number | null): () => void {
  const move = (event: PointerEvent) => (cursorAt.value = timeOf(event.clientX));
  const leave = (event: PointerEvent) => {
    if (event.pointerType === "mouse") cursorAt.value = null;
  };
  host.addEventListener("pointermove", move);
  host.addEventListener("pointerdown", move);
  host.addEventListener("pointerleave", leave);
  return () => {
    host.removeEventListener("pointermove", move);
    host.removeEventListener("pointerdown", move);
    host.removeEventListener("pointerleave", leave);
  };
}

/** The last row that is not later than `at`; -1 if there is none. */
function rowAt(times: readonly number[], at: number): number {
  let low = 0;
  let high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((times[middle] ?? 0) <= at) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

/** Draws anew and asks again while the page is open. */
function useClock(): void {
  useEffect(() => {
    let last = 0;
    keepUp();
    const timer = setInterval(() => {
      if (document.hidden) return;
      keepUp();
      const period = window_.peek().span > CALM_S ? CALM_MS : PERIOD_MS;
      if (isFollowing.peek() && performance.now() - last >= period - 50) {
        last = performance.now();
        drawnCount.value += 1;
      }
    }, PERIOD_MS);
    return () => clearInterval(timer);
  }, []);
}

export function TrendPage() {
  useClock();
  return (
    <div class={`trend-page ${isStale.value ? "is-old" : ""}`}>
      <TimeBar />
      <section class="trend-grid" role="group" tabIndex={0} aria-label={say.region} onKeyDown={(event) => onKey(event, () => follow(window_.peek().span))}>
        {CHARTS.map((chart) => (
          <Figure key={chart.name} chart={chart} />
        ))}
      </section>
      <div class="trend-below">
        <Marks />
        <EventLog />
      </div>
    </div>
  );
}

function Figure({ chart }: { chart: Chart }) {
  const host = useRef<HTMLDivElement>(null);
  useEffect(() => (host.current ? connect(host.current, chart) : undefined), [chart]);
  return (
    <figure class="panel trend" data-chart={chart.name}>
      <figcaption>
        <h2>{chart.title}</h2>
        <span class="space" />
        <Values chart={chart} />
        <span class="key-unit">{chart.unit}</span>
      </figcaption>
      <div class="plot" ref={host} />
    </figure>
  );
}

/** Under the cursor, or the newest of what is shown. */
function Values({ chart }: { chart: Chart }) {
  void [drawnCount.value, loadedCount.value, window_.value];
  const rows = drawn();
  const [, to] = edges();
  const pointedAt = cursorAt.value;
  const row = rowAt(rows.at, pointedAt ?? to);
  return (
    <>
      {pointedAt !== null && <time class="muted">{clock(pointedAt)}</time>}
      {chart.lines.map(({ channel, label, colourName, set }) => (
        <span key={channel} class={`key ${set ? "set" : colourName}`}>
          {label} <b>{fixed(rows.of(channel, "mean")[row] ?? undefined, chart.decimals)}</b>
        </span>
      ))}
    </>
  );
}

/** What happened in the time that is shown, in words: a press puts it in the middle. */
function Marks() {
  void [loadedCount.value, events.value, drawnCount.value];
  const { span } = window_.value;
  const [from, to] = edges();
  const shown = marks.value.filter(({ at }) => at >= from && at <= to).slice(-MARKS_SHOWN);
  const point = (at: number) => {
    pointed.value = at;
    show(span, at + span / 2);
  };
  return (
    <section class="panel trend-marks" aria-label={say.marks}>
      <h2>{say.marks}</h2>
      {shown.length === 0 && <p class="muted">{say.noMarks}</p>}
      <ol>
        {shown.map(({ seq, at, kind, text }) => (
          <li key={seq}>
            <button type="button" class={`mark mark-${kind}`} onClick={() => point(at)}>
              <i aria-hidden="true">{SIGNS[kind][0]}</i>
              <time>{clock(at)}</time>
              <b>{say.kinds[kind]}</b>
              <span>{text}</span>
            </button>
          </li>
        ))}
      </ol>
    </section>
  );
}
