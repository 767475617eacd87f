// The jobs page: all jobs with search, the queue in its order, one job, or the form for a new one.
import { signal } from "@preact/signals";
import { chosen, jobs } from "../state/jobs";
import { isOperator } from "../state/session";
import { words } from "../words";
import { JobDetail } from "./JobDetail";
import { NewJob } from "./NewJob";
import { QueueView } from "./QueueView";
import { SearchView } from "./SearchView";

const say = words.jobs;
const isAdding = signal(false);
const view = signal<"list" | "queue">("list");

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
  if (open) return <JobDetail job={open} key={open.id} />;
  return (
    <section class="jobs">
      <div class="panel-head">
        <div class="job-views" role="group" aria-label={say.viewsAria}>
          {(["list", "queue"] as const).map((name) => (
            <button type="button" class="control" key={name} aria-pressed={view.value === name} onClick={() => (view.value = name)}>
              {say.views[name]}
            </button>
          ))}
        </div>
        <button type="button" class="control primary" disabled={!isOperator.value} onClick={() => (isAdding.value = true)}>
          {say.add}
        </button>
      </div>
      {view.value === "queue" ? <QueueView /> : <SearchView />}
    </section>
  );
}
