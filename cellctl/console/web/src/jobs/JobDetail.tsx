// One job: what it is, what was found, what the proof says, and what a person may do with it.
import { useEffect, useState } from "preact/hooks";
import { api } from "../api/base";
import { get, post } from "../api/http";
import type { Job, Part } from "../api/types";
import { chosen, takeJob } from "../state/jobs";
import { told } from "../state/notices";
import { plan } from "../state/plan";
import { isOperator } from "../state/session";
import { words } from "../words";
import { duration, fixed, whole } from "../words/format";
import { Again } from "./Again";
import { Approve } from "./Approve";
import { GoOn } from "./GoOn";
import { PlanLink } from "../parts/PlanLink";
import { JobState } from "./JobState";
import { Life } from "./Life";
import { Order, Tags } from "./Order";
import { Pieces } from "./Pieces";
import { Proof } from "./Proof";
import { Rest } from "./Rest";
import { Attachments, Notes } from "./Thread";
import { Waits } from "./Waits";

const say = words.jobs;
const CANCELLABLE = ["submitted", "planning", "planned", "posting", "proving", "proven", "waiting_for_approval", "queued"];

export function JobDetail({ job }: { job: Job }) {
  return (
    <article class="job">
      <div class="panel-head">
        <button type="button" class="control" onClick={() => (chosen.value = null)}>
          ‹ {say.back}
        </button>
        <JobState state={job.state} />
      </div>
      <h2 class="job-heading">{job.name}</h2>
      {job.waits_for.length > 0 ? <Waits job={job} withTitle /> : job.why && <p class="why">{job.why}</p>}
      <Working job={job} />
      {job.error && (
        <p class="problem" role="alert">
          <b>{job.error.title}</b> {job.error.detail}. {job.error.hint}
        </p>
      )}
      <PlanLink job={job} />
      <GoOn job={job} key={job.id} />
      <Approve job={job} key={`approve-${job.id}`} />
      <Rest job={job} key={`rest-${job.id}`} />
      <Facts job={job} />
      <PartFacts id={job.part_id} />
      {plan.value?.job === job.id && <Pieces plan={plan.value.plan} />}
      {job.proof_sha256 && <Proof job={job} key={job.proof_sha256} />}
      <Order job={job} />
      <Life job={job} />
      <Notes job={job} />
      <Attachments job={job} />
      <Tags job={job} />
      <Again job={job} key={`again-${job.id}`} />
      <Actions job={job} />
    </article>
  );
}

function Working({ job }: { job: Job }) {
  if (!["submitted", "planning", "posting", "proving", "running", "held"].includes(job.state)) return null;
  return (
    <div class="working">
      <span>{job.stage}</span>
      <progress max={1} value={job.progress} aria-label={words.bar.progress} />
    </div>
  );
}

function Facts({ job }: { job: Job }) {
  const recipe = job.recipe;
  const direction = Array.isArray(recipe.build_direction) ? recipe.build_direction.join(", ") : String(recipe.build_direction ?? words.dash);
  const rows: [string, string][] = [
    [say.material, job.material],
    [say.process, say.processes[String(recipe.process)] ?? String(recipe.process ?? words.dash)],
    [say.direction, direction],
    [say.tolerance, `${fixed(Number(recipe.tolerance_mm), 3)} mm`],
    [say.layers, job.layers ? whole(job.layers) : words.dash],
    [say.duration, job.duration_s ? duration(job.duration_s) : words.dash],
    [say.lines, job.lines_total ? `${whole(job.lines_executed)} / ${whole(job.lines_total)}` : words.dash],
    [say.submittedBy, job.created_by],
  ];
  if (job.approved_by) rows.push([say.approvedBy, [job.approved_by, job.approve_because || job.override_reason].filter(Boolean).join(": ")]);
  return (
    <section class="panel">
      <dl class="pairs two">
        {rows.map(([name, value]) => (
          <div key={name}>
            <dt>{name}</dt>
            <dd title={value}>{value}</dd>
          </div>
        ))}
      </dl>
    </section>
  );
}

function PartFacts({ id }: { id: string }) {
  const [part, setPart] = useState<Part | null>(null);
  useEffect(() => {
    const aborter = new AbortController();
    get<Part>(`/parts/${id}`, aborter.signal).then(setPart, (error) => aborter.signal.aborted || told(error));
    return () => aborter.abort();
  }, [id]);
  if (!part) return null;
  const [low = [], high = []] = part.bbox_mm;
  const [x, y, z] = [0, 1, 2].map((k) => fixed((high[k] ?? 0) - (low[k] ?? 0), 2));
  const remarks = plan.value?.part === id ? plan.value.plan.findings : [];
  return (
    <section class="panel">
      <h2>{say.part}</h2>
      <p>
        {part.name} · {say.size(x ?? "", y ?? "", z ?? "")} · {say.facets(whole(part.facets))} · {fixed(part.volume_mm3 / 1000, 2)} cm³
      </p>
      <h3>{say.findings}</h3>
      {part.findings.length === 0 ? <p class="muted">{say.noFindings}</p> : <Texts texts={part.findings.map((found) => found.text)} />}
      {remarks.length > 0 && <h3>{say.planFindings}</h3>}
      <Texts texts={remarks} />
    </section>
  );
}

export function Texts({ texts }: { texts: string[] }) {
  if (texts.length === 0) return null;
  return (
    <ul class="texts">
      {texts.map((text, i) => (
        <li key={i}>{text}</li>
      ))}
    </ul>
  );
}

function Actions({ job }: { job: Job }) {
  const cancel = async () => {
    try {
      takeJob(await post<Job>(`/jobs/${job.id}/cancel`, { because: say.cancelBecause }));
    } catch (error) {
      told(error);
    }
  };
  return (
    <div class="row">
      {CANCELLABLE.includes(job.state) && (
        <button type="button" class="control" disabled={!isOperator.value} onClick={() => void cancel()}>
          {say.cancel}
        </button>
      )}
      {job.approved_by && (
        <a class="control" href={`${api}/jobs/${encodeURIComponent(job.id)}/record?format=html`} target="_blank" rel="noopener">
          {say.record}
        </a>
      )}
    </div>
  );
}
