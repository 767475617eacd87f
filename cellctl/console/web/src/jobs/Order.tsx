// When a job may start, and its tags: priority, the time and the jobs that it waits for.
import { useRef } from "preact/hooks";
import { send } from "../api/http";
import type { Job } from "../api/types";
import { newestFirst } from "../state/jobs";
import { told } from "../state/notices";
import { isOperator } from "../state/session";
import { words } from "../words";

const say = words.jobs;
const OVER = ["running", "held", "interrupted", "completed", "failed", "aborted", "cancelled"];
const ENDED_BADLY = ["interrupted", "failed", "aborted", "cancelled"];

function change(job: Job, body: object): void {
  void send("PATCH", `/jobs/${job.id}`, body).catch(told);
}

/** Unix seconds as a field of date and time has it, in local time. */
function local(at: number | null): string {
  if (at === null) return "";
  const date = new Date(at * 1000);
  return new Date(date.getTime() - date.getTimezoneOffset() * 60_000).toISOString().slice(0, 16);
}

export function Tags({ job }: { job: Job }) {
  const input = useRef<HTMLInputElement>(null);
  const add = (event: Event) => {
    event.preventDefault();
    const tag = input.current?.value.trim();
    if (!tag || !input.current) return;
    change(job, { tags: [...job.tags, tag] });
    input.current.value = "";
  };
  return (
    <section class="panel">
      <h2>{say.tags}</h2>
      <div class="job-tags">
        {job.tags.map((tag) => (
          <span class="badge" key={tag}>
            {tag}
            {isOperator.value && (
              <button type="button" class="tag-off" aria-label={say.removeTag(tag)} onClick={() => change(job, { tags: job.tags.filter((one) => one !== tag) })}>
                ✕
              </button>
            )}
          </span>
        ))}
      </div>
      {isOperator.value && (
        <form class="row" onSubmit={add}>
          <label class="grow">
            {say.tag}
            <input ref={input} maxLength={40} required />
          </label>
          <button type="submit" class="control">
            {say.addTag}
          </button>
        </form>
      )}
    </section>
  );
}

export function Order({ job }: { job: Job }) {
  if (OVER.includes(job.state) || !isOperator.value) return null;
  return (
    <section class="panel">
      <h2>{say.order}</h2>
      <div class="form-grid">
        <label>
          {say.priority}
          <select value={job.priority} onChange={(event) => change(job, { priority: Number(event.currentTarget.value) })}>
            {Object.entries(say.priorities).map(([value, label]) => (
              <option key={value} value={value}>
                {label}
              </option>
            ))}
          </select>
        </label>
        <label>
          {say.notBefore}
          <input
            type="datetime-local"
            value={local(job.not_before)}
            onChange={(event) => change(job, { not_before: event.currentTarget.value ? new Date(event.currentTarget.value).getTime() / 1000 : null })}
          />
        </label>
      </div>
      <ul class="waits">
        {job.after.map((one) => (
          <li key={`${one.job}${one.until}`}>
            <i>{one.met ? say.met : say.unmet}</i>
            <span>
              {one.name} {say.untils[one.until]}
            </span>
            <button type="button" class="small" aria-label={say.removeAfter(one.name)} onClick={() => change(job, { after: links(job).filter((link) => link.job !== one.job || link.until !== one.until) })}>
              ✕
            </button>
          </li>
        ))}
      </ul>
      <NewLink job={job} />
    </section>
  );
}

function links(job: Job): { job: string; until: string }[] {
  return job.after.map((one) => ({ job: one.job, until: one.until }));
}

function NewLink({ job }: { job: Job }) {
  const others = newestFirst.value.filter((other) => other.id !== job.id && !ENDED_BADLY.includes(other.state));
  const add = (event: SubmitEvent) => {
    event.preventDefault();
    const form = event.currentTarget as HTMLFormElement;
    const given = new FormData(form);
    change(job, { after: [...links(job), { job: String(given.get("job")), until: String(given.get("until")) }] });
    form.reset();
  };
  return (
    <form class="row" onSubmit={add}>
      <label class="grow">
        {say.after}
        <select name="job" required>
          <option value="">{say.afterNone}</option>
          {others.map((other) => (
            <option key={other.id} value={other.id}>
              {other.name} · {say.states[other.state]}
            </option>
          ))}
        </select>
      </label>
      <label>
        {say.until}
        <select name="until">
          {Object.entries(say.untils).map(([value, label]) => (
            <option key={value} value={value}>
              {label}
            </option>
          ))}
        </select>
      </label>
      <button type="submit" class="control">
        {say.addAfter}
      </button>
    </form>
  );
}
