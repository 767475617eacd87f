// From a job to its plan in figures, where plans are compared too.
import type { Job } from "../api/types";
import { words } from "../words";
import { addressOf, go } from "./route";

export function PlanLink({ job }: { job: Job }) {
  if (!job.plan_sha256) return null;
  const to = { view: "plan", job: job.id } as const;
  return (
    <a
      class="control"
      href={addressOf(to)}
      onClick={(event) => {
        event.preventDefault();
        go(to);
      }}
    >
      {words.parts.planLink} ›
    </a>
  );
}
