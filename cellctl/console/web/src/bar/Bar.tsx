// The bar that is always there: state, cause, what comes next, remaining time, and the controls.
import { dataAge, isStale, snapshot } from "../state/cell";
import { cause, next, tone } from "../state/meaning";
import { words } from "../words";
import { age, duration } from "../words/format";
import { Controls } from "./Controls";
import { Sign } from "./Signs";

const say = words.bar;

export function Bar() {
  return (
    <header class={`bar tone-${tone.value} ${isStale.value ? "is-stale" : ""}`} aria-label={say.region}>
      <StateWord />
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
      <div>
        <strong class="state-word" data-state={now?.state ?? ""}>
          {now ? (words.states[now.state] ?? now.state) : words.noData}
        </strong>
        {isStale.value && now ? (
          <span class="stale-mark" title={say.staleTitle}>
            {say.stale(age(dataAge.value))}
          </span>
        ) : (
          <span class="state-kind">{doing()}</span>
        )}
      </div>
    </div>
  );
}

function doing(): string {
  const job = snapshot.value?.job;
  if (!job || job.outcome) return snapshot.value?.mode === "sim" ? say.simulated : (snapshot.value?.cell ?? "");
  return words.kinds[job.operation_kind] ?? job.operation_kind;
}

function Reasons() {
  return (
    <dl class="reasons">
      <dt>{say.because}</dt>
      <dd class="cause" title={cause.value}>
        {cause.value || words.dash}
      </dd>
      <dt>{say.next}</dt>
      <dd title={next.value}>{next.value || words.dash}</dd>
    </dl>
  );
}

function Progress() {
  const job = snapshot.value?.job;
  if (!job || job.outcome) {
    return (
      <div class="progress empty">
        <span class="muted">{job ? `${job.name}: ${words.jobs.states[job.outcome] ?? job.outcome}` : say.noJob}</span>
      </div>
    );
  }
  return (
    <div class="progress">
      <span class="remaining">
        <small>{say.remaining}</small>
        <b>{duration(job.remaining_s)}</b>
      </span>
      <span class="job-name" title={job.name}>
        {job.name}
        <small>{say.layer(job.layer + 1, job.layers)}</small>
      </span>
      <progress max={1} value={job.progress} aria-label={say.progress} />
    </div>
  );
}
