// The jobs page: the list, one job, or the form for a new one.
import { signal } from "@preact/signals";
import type { Job } from "../api/types";
import { chosen, jobs, newestFirst } from "../state/jobs";
import { isOperator } from "../state/session";
import { words } from "../words";
import { duration } from "../words/format";
import { JobDetail } from "./JobDetail";
import { JobState } from "./JobState";
import { NewJob } from "./NewJob";

const say = words.jobs;
const isAdding = signal(false);

export function Jobs() {
  if (isAdding.value) {
    return (
      <NewJob
        done={(job) => {
          isAdding.value = false;
          if (job) chosen.value = job;
        }}
      />
    );
  }
  const open = jobs.value.get(chosen.value ?? "");
  return open ? <JobDetail job={open} key={open.id} /> : <JobList />;
}

function JobList() {
  return (
    <section class="jobs">
      <div class="panel-head">
        <h2>{say.title}</h2>
        <button type="button" class="control primary" disabled={!isOperator.value} onClick={() => (isAdding.value = true)}>
          {say.add}
        </button>
      </div>
      {newestFirst.value.length === 0 && <p class="muted">{say.none}</p>}
      <ul class="job-list">
        {newestFirst.value.map((job) => (
          <Entry key={job.id} job={job} />
        ))}
      </ul>
    </section>
  );
}

function Entry({ job }: { job: Job }) {
  const isWorkedOn = ["planning", "posting", "proving", "running", "held"].includes(job.state);
  return (
    <li>
      <button type="button" class="job-entry" onClick={() => (chosen.value = job.id)}>
        <span class="job-title">{job.name}</span>
        <JobState state={job.state} />
        <span class="muted job-note">{job.error?.detail || job.why || `${job.material} · ${job.layers || words.dash} ${say.layers.toLowerCase()}`}</span>
        <span class="muted">{job.duration_s > 0 ? duration(job.duration_s) : ""}</span>
        {isWorkedOn && <progress max={1} value={job.progress} aria-label={words.bar.progress} />}
      </button>
    </li>
  );
}
