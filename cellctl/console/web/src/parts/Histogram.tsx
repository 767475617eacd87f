// How much of the surface deviates by how much, with the bounds that it is judged by.
import { words } from "../words";
import { fixed } from "../words/format";
import type { ProofFigures } from "./documents";

const say = words.parts.proof;
const W = 600;
const H = 150;
const FOOT = 24;

export function Histogram({ proof }: { proof: ProofFigures }) {
  const { histogram, allowed_mm: allowed } = proof;
  if (!histogram) return null;
  const { edges_mm: edges, counts } = histogram;
  const low = edges[0] ?? -1;
  const high = edges.at(-1) ?? 1;
  const most = Math.max(1, ...counts);
  const x = (mm: number) => (W * (mm - low)) / (high - low);
  const y = (count: number) => (H - FOOT) * (1 - count / most);
  const within = counts.reduce((sum, count, i) => sum + (Math.abs(((edges[i] ?? 0) + (edges[i + 1] ?? 0)) / 2) <= allowed ? count : 0), 0);
  const total = Math.max(1, counts.reduce((sum, count) => sum + count, 0));
  return (
    <figure class="histogram">
      <figcaption>
        <h3>{say.histogram}</h3>
      </figcaption>
      <svg viewBox={`0 0 ${W} ${H}`} role="img" aria-label={say.histogramText(fixed((100 * within) / total, 1), fixed(allowed, 2))}>
        {counts.map((count, i) => {
          const [left, right] = [edges[i] ?? 0, edges[i + 1] ?? 0];
          const isBeyond = Math.abs((left + right) / 2) > allowed;
          return <rect key={i} class={isBeyond ? "beyond" : "within"} x={x(left)} width={Math.max(x(right) - x(left) - 1, 0.5)} y={y(count)} height={H - FOOT - y(count)} />;
        })}
        {[-allowed, 0, allowed].map((mm) => (
          <g key={mm}>
            <line class={mm === 0 ? "grid" : "bound"} x1={x(mm)} x2={x(mm)} y1={0} y2={H - FOOT} />
            <text x={Math.min(Math.max(x(mm), 24), W - 24)} y={H - 7} text-anchor="middle">
              {fixed(mm, 2)}
            </text>
          </g>
        ))}
      </svg>
      <small class="muted">{say.histogramText(fixed((100 * within) / total, 1), fixed(allowed, 2))}</small>
    </figure>
  );
}
