// What the twin measured against what is allowed, what it found, and where to read all of it.
import { api } from "../api/base";
import type { Job, ProofDocument } from "../api/types";
import { Findings } from "../jobs/Findings";
import { words } from "../words";
import { duration, fixed } from "../words/format";
import { useAsked } from "./asked";
import type { ProofFigures } from "./documents";
import { Histogram } from "./Histogram";
import { Problem } from "./Problem";

const say = words.parts.proof;

interface Row {
  name: string;
  measured: string;
  bound: string;
  isKept: boolean | null; // null: nothing is asked of it
}

export function boundRows(proof: ProofFigures): Row[] {
  const { deviation, allowed_mm: allowed, allowed_missing_share: share, clearance_mm: clearance } = proof;
  const mm = (value: number | undefined) => `${fixed(value, 3)} mm`;
  const missing = (deviation.missing_mm3 ?? 0) / Math.max(deviation.part_mm3 ?? 0, 1e-9);
  const rows: Row[] = [
    { name: say.p99, measured: mm(deviation.p99_mm), bound: `≤ ${mm(allowed)}`, isKept: (deviation.p99_mm ?? 0) <= allowed },
    { name: say.missing, measured: `${fixed(100 * missing, 2)} %`, bound: `≤ ${fixed(100 * share, 2)} %`, isKept: missing <= share },
  ];
  if (proof.milled) rows.push({ name: say.milled, measured: mm(proof.milled.p99_mm), bound: `≤ ${mm(allowed)}`, isKept: (proof.milled.p99_mm ?? 0) <= allowed });
  const least = proof.thresholds.clearance_mm;
  if (clearance !== null && least !== undefined) rows.push({ name: say.clearance, measured: mm(clearance), bound: `≥ ${mm(least)}`, isKept: clearance >= least });
  rows.push({ name: say.mean, measured: mm(deviation.mean_mm), bound: words.dash, isKept: null });
  rows.push({ name: say.hollow, measured: mm(deviation.max_missing_mm), bound: words.dash, isKept: null });
  rows.push({ name: say.bump, measured: mm(deviation.max_excess_mm), bound: words.dash, isKept: null });
  rows.push({ name: say.duration, measured: duration(proof.duration_s), bound: words.dash, isKept: null });
  return rows;
}

export function ProofReport({ job }: { job: Job }) {
  const { found: proof, problem } = useAsked<ProofFigures & ProofDocument>(job.proof_sha256 ? `/jobs/${job.id}/proof` : null);
  if (!job.proof_sha256) return null;
  const root = `${api}/jobs/${encodeURIComponent(job.id)}/proof`;
  return (
    <section class="panel proof-page" aria-label={say.title}>
      <div class="panel-head">
        <h2>{say.title}</h2>
        {proof && (
          <b class={`job-state tone-${proof.passed ? "run" : "fault"}`}>
            <i aria-hidden="true">{proof.passed ? "✓" : "✕"}</i> {proof.passed ? words.jobs.proofPassed : words.jobs.proofFailed}
          </b>
        )}
      </div>
      <Problem of={problem} />
      {proof && (
        <>
          {proof.reasons.length > 0 && (
            <ul class="texts">
              {proof.reasons.map((reason) => (
                <li key={reason}>{reason}</li>
              ))}
            </ul>
          )}
          <Bounds proof={proof} />
          <Histogram proof={proof} />
          <Findings findings={proof.findings} />
          <a href={`${root}/picture`} target="_blank" rel="noopener">
            <img src={`${root}/picture`} alt={words.jobs.proofPicture} loading="lazy" />
          </a>
          <a class="control" href={`${root}/report`} target="_blank" rel="noopener">
            {words.jobs.proofReport} ↗
          </a>
        </>
      )}
    </section>
  );
}

function Bounds({ proof }: { proof: ProofFigures }) {
  return (
    <table class="bounds">
      <thead>
        <tr>
          <th scope="col">{say.figure}</th>
          <th scope="col">{say.measured}</th>
          <th scope="col">{say.allowed}</th>
          <th scope="col">{say.verdict}</th>
        </tr>
      </thead>
      <tbody>
        {boundRows(proof).map((row) => (
          <tr key={row.name}>
            <th scope="row">{row.name}</th>
            <td>{row.measured}</td>
            <td>{row.bound}</td>
            <td class={row.isKept === null ? "muted" : row.isKept ? "tone-run" : "tone-fault"}>{row.isKept === null ? words.dash : row.isKept ? `✓ ${say.kept}` : `✕ ${say.broken}`}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}
