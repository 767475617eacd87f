// A plan in figures: layers and their directions, operations, lengths, times, powder; pieces in order; the proof; approving it.
import type { Job, Plan } from "../api/types";
import { Approve } from "../jobs/Approve";
import { JobState } from "../jobs/JobState";
import { Pieces } from "../jobs/Pieces";
import { newestFirst } from "../state/jobs";
import { words } from "../words";
import { duration, fixed, whole } from "../words/format";
import { useAsked } from "./asked";
import type { PlanFigures } from "./documents";
import { useJob } from "./jobs_by_id";
import { LayersChart } from "./LayersChart";
import { Back } from "./PartPage";
import { Problem } from "./Problem";
import { ProofReport } from "./ProofReport";
import { go } from "./route";
import { grams, spanText } from "./sizes";

const say = words.parts.plan;

export function PlanReport({ id }: { id: string }) {
  const { job, problem } = useJob(id);
  const planned = job?.plan_sha256 ? job.id : null;
  const plan = useAsked<Plan>(planned && `/jobs/${planned}/plan`);
  const figures = useAsked<PlanFigures>(planned && `/jobs/${planned}/plan/figures`);
  if (!job) return <Problem of={problem} />;
  return (
    <div class="plan-page">
      <div class="panel-head plan-head">
        <Back to={{ view: "part", part: job.part_id, like: job.id }} text={say.toPart} />
        <h2 class="parts-title">{job.name}</h2>
        <JobState state={job.state} />
        <CompareWith job={job} />
      </div>
      <Stage job={job} />
      <Problem of={plan.problem ?? figures.problem} />
      <div class="plan-columns">
        <div class="plan-left">
          {figures.found && <Summary job={job} figures={figures.found} plan={plan.found} />}
          {figures.found && <Charts figures={figures.found} />}
          {figures.found && <Operations figures={figures.found} />}
          {plan.found && <Pieces plan={plan.found} />}
          {plan.found && plan.found.findings.length > 0 && (
            <section class="panel" aria-label={words.jobs.planFindings}>
              <h2>{words.jobs.planFindings}</h2>
              <ul class="texts">
                {plan.found.findings.map((text) => (
                  <li key={text}>{text}</li>
                ))}
              </ul>
            </section>
          )}
        </div>
        <div class="plan-right">
          <Approve job={job} />
          <ProofReport job={job} />
        </div>
      </div>
    </div>
  );
}

function Stage({ job }: { job: Job }) {
  const isWorkedOn = ["submitted", "planning", "planned", "posting", "proving"].includes(job.state);
  if (job.error) {
    return (
      <p class="problem" role="alert">
        <b>{job.error.title}</b> {job.error.detail} {job.error.hint}
      </p>
    );
  }
  if (!isWorkedOn) return null;
  return (
    <div class="working panel" role="status">
      <span>{say.working(job.stage)}</span>
      <progress max={1} value={job.progress} aria-label={words.bar.progress} />
    </div>
  );
}

function CompareWith({ job }: { job: Job }) {
  const others = newestFirst.value.filter((other) => other.id !== job.id && other.plan_sha256);
  const ranked = [...others.filter((other) => other.part_id === job.part_id), ...others.filter((other) => other.part_id !== job.part_id)];
  if (!job.plan_sha256 || ranked.length === 0) return null;
  return (
    <label class="compare-with">
      <span class="hidden-word">{say.compareWith}</span>
      <select value="" onChange={(event) => event.currentTarget.value && go({ view: "compare", jobs: [job.id, event.currentTarget.value] })}>
        <option value="">{say.compareWith}</option>
        {ranked.map((other) => (
          <option key={other.id} value={other.id}>
            {say.other(other.name, other.material, fixed(Number(other.recipe.tolerance_mm), 2))}
          </option>
        ))}
      </select>
    </label>
  );
}

/** Directions of the layers' planes, in words: how many differ, and how far they turn from the first. */
function directionsText(figures: PlanFigures): string {
  const first = figures.layers[0]?.direction ?? [0, 0, 1];
  const angles = figures.layers.map(({ direction }) => (Math.acos(Math.min(1, direction.reduce((sum, value, k) => sum + value * (first[k] ?? 0), 0))) * 180) / Math.PI);
  const most = Math.max(0, ...angles);
  return most < 0.1 ? say.oneDirection : say.directions(new Set(angles.map((angle) => angle.toFixed(0))).size, fixed(most, 0));
}

function Summary({ job, figures, plan }: { job: Job; figures: PlanFigures; plan: Plan | null }) {
  const { totals, volumes_mm3: volumes } = figures;
  const thickness = figures.layers.flatMap((layer) => layer.thickness_mm.filter((value) => value > 0));
  const rows: [string, string][] = [
    [say.layers, `${whole(figures.layers.length)} · ${fixed(Math.min(...thickness), 2)} – ${fixed(Math.max(...thickness), 2)} mm`],
    [say.direction, directionsText(figures)],
    [say.pieces, plan ? say.piecesOf(plan.subcomponents?.length ?? 1, plan.setups?.length ?? 1) : words.dash],
    [say.programTime, job.duration_s ? duration(job.duration_s) : words.dash],
    [say.deposit, say.lengthAndTime(fixed((totals.deposit_mm ?? 0) / 1000, 1), spanText(totals.deposit_s ?? 0))],
    [say.mill, say.lengthAndTime(fixed((totals.mill_mm ?? 0) / 1000, 1), spanText(totals.mill_s ?? 0))],
    [say.links, spanText(totals.link_s ?? 0)],
    [say.powder, grams(totals.powder_g ?? 0)],
    [say.volumes, say.volumesOf(fixed((volumes.part ?? 0) / 1000, 2), fixed((volumes.deposited ?? 0) / 1000, 2), fixed((volumes.milled ?? 0) / 1000, 2))],
    [words.jobs.material, figures.material],
    [words.jobs.tolerance, `± ${fixed(Number(job.recipe.tolerance_mm), 3)} mm`],
  ];
  return (
    <section class="panel" aria-label={say.title}>
      <h2>{say.title}</h2>
      <dl class="pairs stacked">
        {rows.map(([name, value]) => (
          <div key={name}>
            <dt>{name}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
      <small class="muted">{say.timesAre}</small>
    </section>
  );
}

function Charts({ figures }: { figures: PlanFigures }) {
  return (
    <section class="panel" aria-label={say.byLayer}>
      <LayersChart title={say.powderByLayer} unit="g" series={[{ name: say.powder, className: "series-powder", values: figures.layers.map((layer) => layer.powder_g) }]} />
      <LayersChart
        title={say.timeByLayer}
        unit="s"
        series={[
          { name: say.deposit, className: "series-a", values: figures.layers.map((layer) => layer.deposit_s) },
          { name: say.mill, className: "series-b", values: figures.layers.map((layer) => layer.mill_s) },
        ]}
      />
    </section>
  );
}

function Operations({ figures }: { figures: PlanFigures }) {
  return (
    <section class="panel" aria-label={say.operations}>
      <h2>{say.operations}</h2>
      <table>
        <thead>
          <tr>
            <th scope="col" class="aside">
              {say.process}
            </th>
            <th scope="col">{say.count}</th>
            <th scope="col">{say.passes}</th>
            <th scope="col">{say.length}</th>
            <th scope="col">{say.time}</th>
          </tr>
        </thead>
        <tbody>
          {figures.processes.map((row) => (
            <tr key={`${row.process} ${row.cutter_diameter_mm}`}>
              <th scope="row">
                {words.operation(row.process)}
                {row.cutter_diameter_mm > 0 && ` ⌀ ${fixed(row.cutter_diameter_mm, 0)}`}
              </th>
              <td>{whole(row.operations)}</td>
              <td>{whole(row.passes)}</td>
              <td>{fixed(row.length_mm / 1000, 2)} m</td>
              <td>{duration(row.time_s)}</td>
            </tr>
          ))}
        </tbody>
      </table>
    </section>
  );
}
