// The CNC: state, feed, tool, and the program's line counts.
import { snapshot } from "../state/cell";
import { facts } from "../state/plan";
import type { Lines } from "../api/types";
import { words } from "../words";
import { fixed, whole } from "../words/format";

const say = words.machine;
const NONE: Lines = { sent: 0, acknowledged: 0, executing: 0, executed: 0, total: 0 };

export function Cnc() {
  const now = snapshot.value;
  const cnc = now?.cnc;
  const tool = facts.value?.tools.find((found) => found.number === cnc?.tool);
  return (
    <section class="panel cnc">
      <h2>{say.cnc}</h2>
      <dl class="pairs">
        <dt>{say.cncState}</dt>
        <dd>{cnc?.state || words.dash}</dd>
        <dt>{say.feed}</dt>
        <dd>{fixed(cnc?.feed_mm_min, 0)} mm/min</dd>
        <dt>{say.tipSpeed}</dt>
        <dd>{fixed(now?.tip_speed_mm_s, 1)} mm/s</dd>
        <dt>{say.tool}</dt>
        <dd title={tool?.name}>{cnc?.tool ? `T${cnc.tool}${tool ? ` ${tool.name}` : ""}` : words.dash}</dd>
        <dt>{say.spindle}</dt>
        <dd>{whole(cnc?.spindle_rpm ?? 0)} rpm</dd>
        <dt>{say.override}</dt>
        <dd>{cnc?.feed_override ?? words.dash} %</dd>
      </dl>
    </section>
  );
}

export function LineCounts() {
  const { executed, acknowledged, sent, total } = snapshot.value?.lines ?? NONE;
  const lines = { executed, acknowledged, sent, total };
  return (
    <section class="panel lines">
      <h2>{say.lines}</h2>
      <svg viewBox="0 0 100 6" preserveAspectRatio="none" role="img" aria-label={say.linesAria(executed, total)}>
        <rect class="total" width="100" height="6" />
        {(["sent", "acknowledged", "executed"] as const).map((name) => (
          <rect class={name} key={name} width={total > 0 ? (100 * lines[name]) / total : 0} height="6" />
        ))}
      </svg>
      <ul>
        {Object.entries(lines).map(([name, count]) => (
          <li key={name}>
            <i class={`swatch line-${name}`} />
            <b>{whole(count)}</b> {say.lineWords[name as keyof typeof say.lineWords]}
          </li>
        ))}
      </ul>
    </section>
  );
}
