// The life of a job: every step, when, why, by whom, and how long it stayed there.
import type { Job, JobStep } from "../api/types";
import { words } from "../words";
import { duration, moment } from "../words/format";
import { JobState } from "./JobState";
import { useDocument } from "./read";

const say = words.jobs;

export function Life({ job }: { job: Job }) {
  const [life] = useDocument<{ items: JobStep[] }>(`/jobs/${job.id}/life`, `${job.state} ${job.timestamps[job.state]}`);
  if (!life) return null;
  return (
    <section class="panel">
      <h2>{say.life}</h2>
      <ol class="life">
        {life.items.map((step, k) => (
          <li key={k}>
            <JobState state={step.state} isPast />
            <span class="muted">
              <time dateTime={new Date(step.at * 1000).toISOString()}>{moment(step.at)}</time>
              {step.lasted_s !== null && step.lasted_s >= 1 && `, ${say.lasted(duration(step.lasted_s))}`}
            </span>
            <span class="life-why">
              {step.why}
              {step.who && !step.why.includes(step.who) && ` (${say.by(step.who)})`}
            </span>
          </li>
        ))}
      </ol>
    </section>
  );
}
