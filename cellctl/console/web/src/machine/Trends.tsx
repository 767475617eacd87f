// Laser power and powder of the last two minutes, set and read.
import { effect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import type { Snapshot } from "../api/types";
import { isStale, snapshot } from "../state/cell";
import { colour, theme } from "../state/theme";
import { live, trendNow, type Channel } from "../state/trends";
import { words } from "../words";
import { fixed } from "../words/format";

const say = words.trends;
const SPAN_S = 120;
const PERIOD_MS = 250; // between drawings
const FONT = "12px system-ui, sans-serif";

interface Kind {
  title: string;
  unit: string;
  decimals: number;
  values: (now: Snapshot) => [set: number, read: number];
  colourName: string;
  least: number; // the scale shows at least this much
  channels: [set: Channel, read: Channel];
}

const KINDS: Kind[] = [
  {
    title: say.laser,
    unit: say.watts,
    decimals: 0,
    values: ({ laser }) => [laser.power_setpoint_w, laser.power_readback_w],
    colourName: "laser",
    least: 200,
    channels: ["laser_setpoint_w", "laser_readback_w"],
  },
  {
    title: say.powder,
    unit: say.grams,
    decimals: 1,
    values: ({ feeder }) => [feeder.rate_setpoint_g_min, feeder.rate_readback_g_min],
    colourName: "powder",
    least: 4,
    channels: ["powder_setpoint_g_min", "powder_readback_g_min"],
  },
];

/** The rows of the time that is drawn. */
function dataOf({ channels }: Kind): uPlot.AlignedData {
  const from = trendNow() - SPAN_S - 1;
  const begin = Math.max(live.at.findIndex((at) => at >= from), 0);
  return [live.at.slice(begin), live.columns[channels[0]].slice(begin), live.columns[channels[1]].slice(begin)];
}

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
      { ...axis, size: 44, values: (_plot, splits) => splits.map((value) => fixed(value, kind.least < 10 && value % 1 ? 1 : 0)) },
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
    plot = new uPlot(options(kind, host.clientWidth, host.clientHeight), dataOf(kind), host);
  };
  const stopTheme = effect(() => {
    void theme.value;
    build();
  });
  const timer = setInterval(() => document.hidden || plot?.setData(dataOf(kind)), PERIOD_MS);
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
  const now = snapshot.value;
  const [set, read] = now ? kind.values(now) : [undefined, undefined];
  return (
    <figure class="panel trend">
      <figcaption>
        <h2>{kind.title}</h2>
        {kind.colourName === "laser" && now && <Emission laser={now.laser} />}
        <span class="space" />
        <span class="key set">
          {say.set} <b>{fixed(set, kind.decimals)}</b>
        </span>
        <span class={`key read ${kind.colourName}`}>
          {say.read} <b class="big">{fixed(read, kind.decimals)}</b> {kind.unit}
        </span>
      </figcaption>
      <div class="plot" ref={host} />
    </figure>
  );
}

function Emission({ laser }: { laser: Snapshot["laser"] }) {
  return (
    <b class={laser.emitting ? "badge laser-on" : "badge"} title={words.machine.permits(laser.enabled, laser.permitted)}>
      {laser.emitting ? words.machine.emitting : laser.permitted ? words.machine.permitted : words.machine.dark}
    </b>
  );
}
