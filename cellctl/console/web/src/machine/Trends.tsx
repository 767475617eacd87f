// Laser power and powder of the last two minutes, set and read.
import { effect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import { isStale } from "../state/cell";
import { colour, theme } from "../state/theme";
import { SPAN_S, trendNow, trends, type Series } from "../state/trends";
import { words } from "../words/en";

const say = words.trends;
const PERIOD_MS = 250; // between drawings
const FONT = "12px system-ui, sans-serif";

interface Kind {
  title: string;
  colourName: string;
  least: number; // the scale shows at least this much
  data: () => [number[], Series, Series];
}

const KINDS: Kind[] = [
  { title: say.laser, colourName: "laser", least: 200, data: () => [trends.time, trends.laserSet, trends.laserRead] },
  { title: say.powder, colourName: "powder", least: 4, data: () => [trends.time, trends.powderSet, trends.powderRead] },
];

function options(kind: Kind, width: number, height: number): uPlot.Options {
  const grid = { stroke: colour("line"), width: 1 };
  const axis = { stroke: colour("muted"), font: FONT, grid, ticks: { show: false } };
  return {
    width,
    height,
    padding: [8, 14, 0, 0],
    legend: { show: false },
    cursor: { show: false },
    scales: {
      x: { time: false, range: () => [trendNow() - SPAN_S, trendNow()] },
      y: { range: (_plot, _low, high) => [0, Math.max(kind.least, (high ?? 0) * 1.15)] },
    },
    axes: [
      {
        ...axis,
        size: 24,
        splits: () => [-120, -90, -60, -30, 0].map((s) => trendNow() + s),
        values: () => [-120, -90, -60, -30, 0].map((s) => say.seconds(s)),
      },
      { ...axis, size: 44 },
    ],
    series: [
      {},
      { label: say.set, stroke: colour("muted"), width: 1.5, dash: [5, 4], points: { show: false } },
      { label: say.read, stroke: colour(kind.colourName), width: 2, points: { show: false } },
    ],
  };
}

function connect(host: HTMLElement, kind: Kind): () => void {
  let plot: uPlot | null = null;
  const build = () => {
    plot?.destroy();
    plot = new uPlot(options(kind, host.clientWidth, host.clientHeight), kind.data(), host);
  };
  const stopTheme = effect(() => {
    void theme.value;
    build();
  });
  const timer = setInterval(() => document.hidden || plot?.setData(kind.data()), PERIOD_MS);
  const resizer = new ResizeObserver(() => plot?.setSize({ width: host.clientWidth, height: host.clientHeight }));
  resizer.observe(host);
  return () => {
    clearInterval(timer);
    resizer.disconnect();
    stopTheme();
    plot?.destroy();
  };
}

export function Trends() {
  return (
    <section class={`trends ${isStale.value ? "is-stale" : ""}`} aria-label={say.region}>
      {KINDS.map((kind) => (
        <Trend key={kind.title} kind={kind} />
      ))}
    </section>
  );
}

function Trend({ kind }: { kind: Kind }) {
  const host = useRef<HTMLDivElement>(null);
  useEffect(() => (host.current ? connect(host.current, kind) : undefined), [kind]);
  return (
    <figure class="panel trend">
      <figcaption>
        <h2>{kind.title}</h2>
        <span class="key set">{say.set}</span>
        <span class={`key read ${kind.colourName}`}>{say.read}</span>
      </figcaption>
      <div class="plot" ref={host} />
    </figure>
  );
}
