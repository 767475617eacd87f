// Figures by layer as lines in one drawing: one plan, or two laid over each other.
import { words } from "../words";
import { fixed } from "../words/format";

const say = words.parts;
const W = 600;
const H = 170;
const PAD = { left: 46, right: 10, top: 10, bottom: 26 };

export interface Series {
  name: string;
  className: string;
  values: number[];
}

/** A round number above or at the greatest: 1, 2 or 5 times a power of ten. */
function roundUp(value: number): number {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return power * ([1, 2, 5, 10].find((step) => step * power >= value) ?? 10);
}

function path(values: number[], x: (i: number) => number, y: (value: number) => number): string {
  return values.map((value, i) => `${i ? "H" : `M${x(0).toFixed(1)},${y(value).toFixed(1)}H`}${x(i).toFixed(1)}V${y(value).toFixed(1)}H${x(i + 1).toFixed(1)}`).join("");
}

export function LayersChart({ title, unit, series }: { title: string; unit: string; series: Series[] }) {
  const count = Math.max(1, ...series.map(({ values }) => values.length));
  const top = roundUp(Math.max(0, ...series.flatMap(({ values }) => values)));
  const x = (i: number) => PAD.left + ((W - PAD.left - PAD.right) * i) / count;
  const y = (value: number) => H - PAD.bottom - ((H - PAD.top - PAD.bottom) * value) / top;
  const ticks = [0, 0.25, 0.5, 0.75, 1].map((share) => Math.round(share * (count - 1)));
  const sums = series.map(({ name, values }) => say.chartSum(name, fixed(values.reduce((sum, value) => sum + value, 0), 1), unit)).join("; ");
  return (
    <figure class="layers-chart">
      <figcaption>
        <h3>
          {title}, {unit}
        </h3>
        {series.length > 1 &&
          series.map(({ name, className }) => (
            <span key={className} class={`key ${className}`}>
              {name}
            </span>
          ))}
      </figcaption>
      <svg viewBox={`0 0 ${W} ${H}`} role="img" aria-label={`${title}. ${sums}`}>
        {[0, 0.5, 1].map((share) => (
          <g key={share}>
            <line class="grid" x1={PAD.left} x2={W - PAD.right} y1={y(share * top)} y2={y(share * top)} />
            <text x={PAD.left - 6} y={y(share * top) + 4} text-anchor="end">
              {fixed(share * top, top < 4 ? 1 : 0)}
            </text>
          </g>
        ))}
        {[...new Set(ticks)].map((layer) => (
          <text key={layer} x={x(layer + 0.5)} y={H - 8} text-anchor="middle">
            {layer + 1}
          </text>
        ))}
        {series.map(({ className, values }) => (
          <path key={className} class={`line ${className}`} d={path(values, x, y)} />
        ))}
      </svg>
    </figure>
  );
}
