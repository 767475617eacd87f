// The charts of the trends page: which channels stand together, in which colour, and how one is drawn.
import type uPlot from "uplot";
import { colour } from "../state/theme";
import { edges, marks, pointed, type Drawn } from "../state/history";
import type { Channel } from "../state/trends";
import type { TrendMark } from "../api/types";
import { words } from "../words";
import { axisTime, fixed } from "../words/format";

const say = words.trendPage;
const FONT = "12px system-ui, sans-serif";
const AXIS_PX = 48;

/** set : dashed and without its least and greatest, which are those of the read-back */
export interface Line {
  channel: Channel;
  label: string;
  colourName: string;
  set?: boolean;
}

export interface Chart {
  name: string;
  title: string;
  unit: string;
  decimals: number;
  least: number; // the scale shows at least this much
  lines: Line[];
}

const pair = (set: Channel, read: Channel, colourName: string): Line[] => [
  { channel: set, label: say.set, colourName: "muted", set: true },
  { channel: read, label: say.read, colourName },
];

export const CHARTS: readonly Chart[] = [
  { name: "laser", title: say.laser, unit: "W", decimals: 0, least: 200, lines: pair("laser_setpoint_w", "laser_readback_w", "laser") },
  { name: "powder", title: say.powder, unit: "g/min", decimals: 1, least: 4, lines: pair("powder_setpoint_g_min", "powder_readback_g_min", "powder") },
  { name: "carrier", title: say.carrier, unit: "L/min", decimals: 1, least: 4, lines: pair("carrier_gas_setpoint_l_min", "carrier_gas_readback_l_min", "wait") },
  { name: "shield", title: say.shield, unit: "L/min", decimals: 1, least: 4, lines: pair("shield_gas_setpoint_l_min", "shield_gas_readback_l_min", "wait") },
  { name: "speed", title: say.speed, unit: "mm/s", decimals: 1, least: 5, lines: [{ channel: "tip_speed_mm_s", label: "", colourName: "run" }] },
  { name: "spindle", title: say.spindle, unit: "1/min", decimals: 0, least: 1000, lines: [{ channel: "spindle_rpm", label: "", colourName: "run" }] },
  {
    name: "buffer",
    title: say.buffer,
    unit: "%",
    decimals: 0,
    least: 100,
    lines: [
      { channel: "rx_fill_percent", label: say.rx, colourName: "muted" },
      { channel: "planner_fill_percent", label: say.planner, colourName: "wait" },
    ],
  },
  { name: "jitter", title: say.jitter, unit: "ms", decimals: 2, least: 2, lines: [{ channel: "tick_jitter_ms", label: "", colourName: "hold" }] },
  {
    name: "overrides",
    title: say.overrides,
    unit: "%",
    decimals: 0,
    least: 120,
    lines: [
      { channel: "feed_override_percent", label: say.feed, colourName: "run" },
      { channel: "laser_override_percent", label: say.laser, colourName: "laser" },
      { channel: "powder_override_percent", label: say.powder, colourName: "powder" },
    ],
  },
];

/** Sign and colour of a mark: told by its sign, not by colour alone. */
export const SIGNS: Record<TrendMark["kind"], [sign: string, colourName: string]> = {
  alarm: ["▲", "fault"],
  hold: ["‖", "hold"],
  reset: ["↺", "wait"],
  acknowledge: ["✓", "muted"],
  job: ["●", "run"],
  layer: ["·", "muted"],
};
const WITH_LINE = new Set(["alarm", "hold", "reset", "job"]);

/** Rows for uPlot: time, then of each line its mean and, of a read-back, least and greatest. */
export function rowsOf(chart: Chart, rows: Drawn): uPlot.AlignedData {
  return [
    rows.at,
    ...chart.lines.flatMap(({ channel, set }) =>
      set ? [rows.of(channel, "mean")] : [rows.of(channel, "mean"), rows.of(channel, "least"), rows.of(channel, "greatest")],
    ),
  ];
}

function drawMarks(plot: uPlot): void {
  const { ctx, bbox } = plot;
  const [from, to] = edges();
  ctx.save();
  ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
  ctx.textAlign = "center";
  const line = (at: number, colourName: string, dash: number[]) => {
    const x = Math.round(plot.valToPos(at, "x", true)) + 0.5;
    ctx.strokeStyle = ctx.fillStyle = colour(colourName);
    ctx.setLineDash(dash);
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
    return x;
  };
  for (const { at, kind } of marks.peek()) {
    if (at < from || at > to || !WITH_LINE.has(kind)) continue;
    const [sign, colourName] = SIGNS[kind];
    const x = line(at, colourName, [2, 3]);
    ctx.fillText(sign, x, bbox.top + 11 * devicePixelRatio);
  }
  const moment = pointed.peek();
  if (moment !== null && moment >= from && moment <= to) line(moment, "focus", []);
  ctx.restore();
}

function seriesOf(chart: Chart): uPlot.Series[] {
  const points = { show: false };
  const all: uPlot.Series[] = [{}];
  for (const { label, colourName, set } of chart.lines) {
    const stroke = colour(colourName);
    all.push(set ? { label, stroke, width: 1.5, dash: [5, 4], points } : { label, stroke, width: 2, points });
    if (!set) all.push({ label, stroke: "transparent", width: 0, points }, { label, stroke: "transparent", width: 0, points });
  }
  return all;
}

/** Between least and greatest of each read-back, in its own colour. */
function bandsOf(chart: Chart): uPlot.Band[] {
  const bands: uPlot.Band[] = [];
  let at = 1;
  for (const { colourName, set } of chart.lines) {
    if (!set) bands.push({ series: [at + 2, at + 1], fill: `${colour(colourName)}3a` });
    at += set ? 1 : 3;
  }
  return bands;
}

/** uPlot's options of a chart. */
export function optionsOf(chart: Chart, width: number, height: number): uPlot.Options {
  const axis = { stroke: colour("muted"), font: FONT, grid: { stroke: colour("line"), width: 1 }, ticks: { show: false } };
  return {
    width,
    height,
    padding: [8, 12, 0, 0],
    legend: { show: false },
    cursor: { drag: { x: false, y: false }, points: { show: false }, x: true, y: false },
    scales: {
      x: { time: false, range: () => edges() },
      y: { range: (_plot, _low, high) => [0, Math.max(chart.least, (high ?? 0) * 1.08)] },
    },
    axes: [
      { ...axis, size: 24, space: 90, incrs: INCREMENTS, values: (_plot, splits) => splits.map((at) => axisTime(at, edges()[1] - edges()[0])) },
      { ...axis, size: AXIS_PX, values: (_plot, splits) => splits.map((value) => fixed(value, chart.least < 4 && value % 1 ? 1 : 0)) },
    ],
    series: seriesOf(chart),
    bands: bandsOf(chart),
    hooks: { draw: [drawMarks] },
  };
}

const INCREMENTS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 21600, 43200, 86400, 172800, 604800, 1209600, 2592000, 7776000];
