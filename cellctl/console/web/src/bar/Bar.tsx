// The bar that is always there, to be read from three metres: state and remaining time, then cause, what comes next, and the controls.
import { dataAge, isStale, snapshot } from "../state/cell";
import { cause, next, tone } from "../state/meaning";
import { words } from "../words";
import { age, duration } from "../words/format";
import { CellName } from "./CellName";
import { Controls } from "./Controls";
import { Sign } from "./Signs";

const say = words.bar;

export function Bar() {
  return (
    <header class={`bar tone-${tone.value} ${isStale.value ? "is-stale" : ""}`} aria-label={say.region}>
      <StateWord />
      <CellName />
      <Remaining />
      <Reasons />
      <Progress />
      <Controls />
    </header>
  );
}

function StateWord() {
  const now = snapshot.value;
  return (
    <div class="state" role="status">
      <Sign name={tone.value} />
      <strong class="state-word" data-state={now?.state ?? ""}>
        {now ? (words.states[now.state] ?? now.state) : words.noData}
      </strong>
      {isStale.value && now && (
        <span class="stale-mark" title={say.staleTitle}>
          {say.stale(age(dataAge.value))}
        </span>
      )}
    </div>
  );
}

function Remaining() {
  const job = snapshot.value?.job;
  if (!job || job.outcome) return null;
  return (
    <div class="remaining">
      <small>{say.remaining}</small>
      <b>{duration(job.remaining_s)}</b>
    </div>
  );
}

function Reasons() {
  return (
    <dl class="reasons">
      <div>
        <dt>{say.because}</dt>
        <dd class="cause" title={cause.value}>
          {cause.value || words.dash}
        </dd>
      </div>
      <div>
        <dt>{say.next}</dt>
        <dd title={next.value}>{next.value || words.dash}</dd>
      </div>
    </dl>
  );
}

function Progress() {
  const job = snapshot.value?.job;
  if (!job) return <div class="progress">{say.noJob}</div>;
  if (job.outcome) return <div class="progress">{`${job.name}: ${words.jobs.states[job.outcome] ?? job.outcome}`}</div>;
  return (
    <div class="progress">
      <b class="job-name" title={job.name}>
        {job.name}
      </b>
      <span>{say.layer(job.layer + 1, job.layers)}</span>
      <span>{words.kinds[job.operation_kind] ?? job.operation_kind}</span>
      <progress max={1} value={job.progress} aria-label={say.progress} />
    </div>
  );
}
