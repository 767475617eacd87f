// The cells of the house: one card each, to be read from three metres; choosing one makes the whole page that cell's.
import { Sign } from "../bar/Signs";
import type { FleetCell } from "../api/types";
import { ageOf, fleet, hereCell, openCell } from "../state/fleet";
import { toneOf } from "../state/meaning";
import { told } from "../state/notices";
import { words } from "../words";
import { age, duration } from "../words/format";

const say = words.cells;
const STALE_S = 10; // five heartbeats: what is older is not about now

export function Cells() {
  const now = fleet.value;
  if (!now) return null;
  return (
    <section class="cells-page" aria-label={say.title}>
      {now.unassigned > 0 && <p class="panel">{say.unassigned(now.unassigned)}</p>}
      <ul class="cells">
        {now.cells.map((cell) => (
          <Card key={cell.cell} cell={cell} />
        ))}
      </ul>
    </section>
  );
}

function Card({ cell }: { cell: FleetCell }) {
  const seconds = ageOf(cell);
  const isStale = seconds >= STALE_S;
  const isShown = cell.cell === hereCell.value;
  const tone = isStale ? "off" : toneOf(cell.state);
  const state = cell.state ? (words.states[cell.state] ?? cell.state) : words.noData;
  return (
    <li class={`panel cell-card tone-${tone}`} data-cell={cell.cell} data-state={cell.state}>
      <h2>{cell.cell}</h2>
      <div class="cell-state">
        <Sign name={tone} />
        <strong>{isStale ? say.silent : state}</strong>
        {cell.alarms > 0 && !isStale && <span class="cell-alarms">▲ {say.alarms(cell.alarms)}</span>}
      </div>
      <p class={isStale ? "cell-age is-old" : "cell-age"}>{isStale ? say.lastHeard(age(seconds), state) : say.heard(age(seconds))}</p>
      <p class="cell-because">{cell.because ? words.cell.said(cell.because) : words.dash}</p>
      <dl class="cell-facts">
        <div>
          <dt>{words.bar.job}</dt>
          <dd>{cell.job?.name ?? words.bar.noJob}</dd>
        </div>
        <div>
          <dt>{words.bar.remaining}</dt>
          <dd>{cell.job && cell.job.remaining_s !== null ? duration(cell.job.remaining_s) : words.dash}</dd>
        </div>
        <div>
          <dt>{say.queued}</dt>
          <dd>{cell.queued}</dd>
        </div>
      </dl>
      <Way cell={cell} isShown={isShown} />
    </li>
  );
}

/** The button that opens the cell; for the cell of this page a word that it is. */
function Way({ cell, isShown }: { cell: FleetCell; isShown: boolean }) {
  if (isShown) return <p class="cell-shown">✓ {say.shown}</p>;
  if (!cell.path) return <p class="muted">{say.noWay}</p>;
  return (
    <button type="button" class="control" onClick={() => void openCell(cell).catch(told)}>
      {say.open(cell.cell)}
    </button>
  );
}
