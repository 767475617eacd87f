// All that a job waits for, each with its sign.
import type { Job } from "../api/types";
import { words } from "../words";

const say = words.jobs;
const SIGNS: Record<string, string> = { job: "⛓", time: "◷", table: "▭", cell: "◷", planner: "◷", approval: "✋", person: "✋" };

export function Waits({ job, withTitle = false }: { job: Job; withTitle?: boolean }) {
  if (job.waits_for.length === 0) return null;
  return (
    <>
      {withTitle && <h3>{say.waits}</h3>}
      <ul class="waits">
        {job.waits_for.map((wait, k) => (
          <li key={k} class={wait.blocked ? "tone-fault" : ""}>
            <i aria-hidden="true">{SIGNS[wait.kind] ?? "◷"}</i>
            <span>
              {wait.blocked && `${say.blocked} `}
              {wait.text}
            </span>
          </li>
        ))}
      </ul>
    </>
  );
}
