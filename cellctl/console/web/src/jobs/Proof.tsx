// What the twin says: verdict, reasons, figures, findings, the picture and the report to print.
import { useEffect, useState } from "preact/hooks";
import { api } from "../api/base";
import { get } from "../api/http";
import type { Job, ProofDocument } from "../api/types";
import { told } from "../state/notices";
import { words } from "../words";
import { duration, fixed } from "../words/format";
import { Findings } from "./Findings";
import { Texts } from "./JobDetail";

const say = words.jobs;
const REPORTED_SINCE = 2; // schema of a proof that has a report

function figure(name: string, value: number): string {
  if (name.endsWith("_mm3")) return `${fixed(value, 1)} mm³`;
  if (name.endsWith("_mm")) return `${fixed(value, 3)} mm`;
  return duration(value);
}

export function Proof({ job }: { job: Job }) {
  const [proof, setProof] = useState<ProofDocument | null>(null);
  useEffect(() => {
    const aborter = new AbortController();
    get<ProofDocument>(`/jobs/${job.id}/proof`, aborter.signal).then(setProof, (error) => aborter.signal.aborted || told(error));
    return () => aborter.abort();
  }, [job.id]);
  const passed = job.proof?.passed === true;
  const root = `${api}/jobs/${encodeURIComponent(job.id)}/proof`;
  return (
    <section class="panel proof">
      <div class="panel-head">
        <h2>{say.proof}</h2>
        <b class={`job-state tone-${passed ? "run" : "fault"}`}>
          <i aria-hidden="true">{passed ? "✓" : "✕"}</i> {passed ? say.proofPassed : say.proofFailed}
        </b>
      </div>
      <div class="proof-columns">
        <dl class="pairs">
          {Object.entries(say.figures).map(([name, label]) => {
            const value = job.proof?.[name];
            if (typeof value !== "number") return null;
            return (
              <div key={name}>
                <dt>{label}</dt>
                <dd>{figure(name, value)}</dd>
              </div>
            );
          })}
        </dl>
        <a href={`${root}/picture`} target="_blank" rel="noopener">
          <img src={`${root}/picture`} alt={say.proofPicture} />
        </a>
      </div>
      <Texts texts={proof?.reasons ?? []} />
      <Findings findings={proof?.findings ?? []} />
      {proof && proof.schema >= REPORTED_SINCE && (
        <a class="control proof-report" href={`${root}/report`} target="_blank" rel="noopener">
          {say.proofReport} ↗
        </a>
      )}
      {proof && proof.schema < REPORTED_SINCE && <p class="muted">{say.proofWithoutReport}</p>}
    </section>
  );
}
