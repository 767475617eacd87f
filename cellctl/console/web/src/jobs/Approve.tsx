// A person's yes: the table is clear, because …; an engineer may override a proof that did not pass.
import { useRef, useState } from "preact/hooks";
import { post } from "../api/http";
import type { Job } from "../api/types";
import { takeJob } from "../state/jobs";
import { told } from "../state/notices";
import { isEngineer, isOperator } from "../state/session";
import { words } from "../words";

const say = words.jobs;

export function Approve({ job }: { job: Job }) {
  const isConfirming = job.state === "queued" && !job.table_clear;
  const [isClear, setClear] = useState(false);
  const [busy, setBusy] = useState(false);
  const because = useRef<HTMLInputElement>(null);
  const override = useRef<HTMLInputElement>(null);
  if (job.state !== "waiting_for_approval" && !isConfirming) return null;
  const needsOverride = !isConfirming && job.proof?.passed !== true;
  if (needsOverride && !isEngineer.value) return <p class="problem">{say.engineerOnly}</p>;
  const approve = async (event: Event) => {
    event.preventDefault();
    setBusy(true);
    const body: Record<string, unknown> = { because: because.current?.value.trim() ?? "" };
    body[job.continues_job ? "part_untouched" : "table_clear"] = isClear;
    if (needsOverride) body.override_reason = override.current?.value.trim() ?? "";
    try {
      takeJob(await post<Job>(`/jobs/${job.id}/approve`, body));
    } catch (error) {
      told(error);
    } finally {
      setBusy(false);
    }
  };
  return (
    <form class="panel approve" onSubmit={(event) => void approve(event)}>
      <h2>{!isConfirming ? say.approveTitle : job.continues_job ? words.goOn.confirmTitle : say.confirmTitle}</h2>
      <label class="check">
        <input type="checkbox" checked={isClear} onChange={(event) => setClear(event.currentTarget.checked)} />
        <span>{job.continues_job ? words.goOn.untouched : say.tableClear}</span>
      </label>
      {needsOverride && (
        <label>
          {say.override}
          <input ref={override} required maxLength={500} />
        </label>
      )}
      <div class="row">
        <label class="grow">
          {say.because}
          <input ref={because} maxLength={500} />
        </label>
        <button type="submit" class="control primary" disabled={!isOperator.value || busy || (isConfirming && !isClear)}>
          {isConfirming ? say.confirm : say.approve}
        </button>
      </div>
    </form>
  );
}
