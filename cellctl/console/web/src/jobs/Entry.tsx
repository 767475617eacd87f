// A job in a list: its name and state, what it waits for, its tags.
import type { Job } from "../api/types";
import { chosen, takeJob } from "../state/jobs";
import { words } from "../words";
import { duration } from "../words/format";
import { JobState } from "./JobState";

const say = words.jobs;

export function Entry({ job, withNote = true }: { job: Job; withNote?: boolean }) {
  const isWorkedOn = ["planning", "posting", "proving", "running", "held"].includes(job.state);
  const open = () => {
    takeJob(job);
    chosen.value = job.id;
  };
  return (
    <button type="button" class="job-entry" onClick={open}>
      <span class="job-title">{job.name}</span>
      <JobState state={job.state} />
      <span class="muted job-note">{job.error?.detail || (withNote && job.why) || `${job.material} · ${job.layers || words.dash} ${say.layers.toLowerCase()}`}</span>
      <span class="muted">{job.duration_s > 0 ? duration(job.duration_s) : ""}</span>
      {job.tags.length > 0 && (
        <span class="job-tags">
          {job.tags.map((tag) => (
            <span class="badge" key={tag}>
              {tag}
            </span>
          ))}
        </span>
      )}
      {isWorkedOn && <progress max={1} value={job.progress} aria-label={words.bar.progress} />}
    </button>
  );
}
