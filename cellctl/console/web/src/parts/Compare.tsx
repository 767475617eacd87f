// Two plans side by side: what was asked differently, what came of it, layer by layer over each other.
import type { Job } from "../api/types";
import { words } from "../words";
import { decimal, duration, fixed, whole } from "../words/format";
import { useAsked } from "./asked";
import type { PlanFigures, ProofFigures } from "./documents";
import { useJob } from "./jobs_by_id";
import { LayersChart } from "./LayersChart";
import { Back } from "./PartPage";
import { Problem } from "./Problem";
import { nameOf } from "./recipe";
import { addressOf, go } from "./route";
import { grams } from "./sizes";

const say = words.parts.compare;

interface Side {
  job: Job;
  figures: PlanFigures | null;
  proof: ProofFigures | null;
}

interface Row {
  name: string;
  values: [number | undefined, number | undefined];
  text: (value: number) => string;
}

function useSide(id: string) {
  const { job, problem } = useJob(id);
  const figures = useAsked<PlanFigures>(job?.plan_sha256 ? `/jobs/${id}/plan/figures` : null);
  const proof = useAsked<ProofFigures>(job?.proof_sha256 ? `/jobs/${id}/proof` : null);
  return { side: job && { job, figures: figures.found, proof: proof.found }, problem: problem ?? figures.problem ?? proof.problem };
}

export function Compare({ ids }: { ids: [string, string] }) {
  const a = useSide(ids[0]);
  const b = useSide(ids[1]);
  return (
    <div class="compare">
      <div class="panel-head">
        <Back to={{ view: "plan", job: ids[0] }} text={say.back} />
        <h2 class="parts-title">{say.title}</h2>
        <button type="button" class="control" onClick={() => go({ view: "compare", jobs: [ids[1], ids[0]] })}>
          {say.swap}
        </button>
      </div>
      <Problem of={a.problem ?? b.problem} />
      {a.side && b.side && <Both a={a.side} b={b.side} />}
    </div>
  );
}

function Both({ a, b }: { a: Side; b: Side }) {
  return (
    <>
      <section class="panel" aria-label={say.figures}>
        <table class="compare-table">
          <thead>
            <tr>
              <th scope="col" class="aside">
                {say.figure}
              </th>
              <Head letter="A" job={a.job} />
              <Head letter="B" job={b.job} />
              <th scope="col" class="aside">
                {say.difference}
              </th>
            </tr>
          </thead>
          <tbody>
            <Asked a={a.job} b={b.job} />
            {rows(a, b).map((row) => (
              <FigureRow key={row.name} row={row} />
            ))}
            <tr>
              <th scope="row">{say.verdict}</th>
              <td>{verdict(a.proof)}</td>
              <td>{verdict(b.proof)}</td>
              <td class="aside">{a.proof && b.proof ? (a.proof.passed === b.proof.passed ? say.same : say.onlyOne(a.proof.passed ? "A" : "B")) : words.dash}</td>
            </tr>
          </tbody>
        </table>
      </section>
      {a.figures && b.figures && <Over a={a.figures} b={b.figures} />}
    </>
  );
}

function Head({ letter, job }: { letter: string; job: Job }) {
  return (
    <th scope="col">
      <b class={`letter letter-${letter.toLowerCase()}`}>{letter}</b>{" "}
      <a
        href={addressOf({ view: "plan", job: job.id })}
        onClick={(event) => {
          event.preventDefault();
          go({ view: "plan", job: job.id });
        }}
      >
        {job.name}
      </a>
    </th>
  );
}

function told(value: unknown): string {
  if (value === undefined || value === null) return say.left;
  return typeof value === "object" ? JSON.stringify(value) : typeof value === "number" ? decimal(value, value % 1 ? 3 : 0) : String(value);
}

/** The recipes' fields that differ. */
function Asked({ a, b }: { a: Job; b: Job }) {
  const names = [...new Set([...Object.keys(a.recipe), ...Object.keys(b.recipe)])].filter((name) => JSON.stringify(a.recipe[name]) !== JSON.stringify(b.recipe[name]));
  if (names.length === 0 && a.part_id === b.part_id) {
    return (
      <tr>
        <th scope="row">{say.recipe}</th>
        <td colSpan={3} class="aside muted">
          {say.sameRecipe}
        </td>
      </tr>
    );
  }
  return (
    <>
      {a.part_id !== b.part_id && (
        <tr class="asked">
          <th scope="row">{say.part}</th>
          <td colSpan={3} class="aside tone-hold">
            ▲ {say.otherPart}
          </td>
        </tr>
      )}
      {names.map((name) => {
        const { label, unit } = nameOf(name);
        const [left, right] = [a.recipe[name], b.recipe[name]];
        const isNumbers = typeof left === "number" && typeof right === "number";
        return (
          <tr key={name} class="asked">
            <th scope="row">{[label, unit].filter(Boolean).join(", ")}</th>
            <td>{told(left)}</td>
            <td>{told(right)}</td>
            <td class="aside">{isNumbers ? difference(left, right) : say.other}</td>
          </tr>
        );
      })}
    </>
  );
}

function rows({ job: jobA, figures: a, proof: proofA }: Side, { job: jobB, figures: b, proof: proofB }: Side): Row[] {
  const total = (name: string): [number | undefined, number | undefined] => [a?.totals[name], b?.totals[name]];
  const deviation = (name: string): [number | undefined, number | undefined] => [proofA?.deviation[name], proofB?.deviation[name]];
  const mm = (value: number) => `${fixed(value, 3)} mm`;
  const metres = (value: number) => `${fixed(value / 1000, 2)} m`;
  return [
    { name: say.layers, values: [a?.layers.length, b?.layers.length], text: whole },
    { name: say.programTime, values: [jobA.duration_s || undefined, jobB.duration_s || undefined], text: duration },
    { name: say.depositTime, values: total("deposit_s"), text: duration },
    { name: say.millTime, values: total("mill_s"), text: duration },
    { name: say.depositLength, values: total("deposit_mm"), text: metres },
    { name: say.millLength, values: total("mill_mm"), text: metres },
    { name: say.powder, values: total("powder_g"), text: grams },
    { name: say.milled, values: [a?.volumes_mm3.milled, b?.volumes_mm3.milled], text: (value) => `${fixed(value / 1000, 2)} cm³` },
    { name: say.p99, values: deviation("p99_mm"), text: mm },
    { name: say.hollow, values: deviation("max_missing_mm"), text: mm },
    { name: say.bump, values: deviation("max_excess_mm"), text: mm },
    { name: say.missing, values: deviation("missing_mm3"), text: (value) => `${fixed(value, 1)} mm³` },
  ];
}

/** What B is against A, in words. */
function difference(a: number | undefined, b: number | undefined): string {
  if (a === undefined || b === undefined) return words.dash;
  if (a === b) return say.same;
  if (a === 0) return b > 0 ? say.onlyB : say.onlyA;
  const share = (100 * (b - a)) / Math.abs(a);
  if (Math.abs(share) < 0.1) return say.same;
  const text = decimal(Math.abs(share), Math.abs(share) < 10 ? 1 : 0);
  return share > 0 ? say.more(text) : say.less(text);
}

function FigureRow({ row }: { row: Row }) {
  const [a, b] = row.values;
  return (
    <tr>
      <th scope="row">{row.name}</th>
      <td>{a === undefined ? words.dash : row.text(a)}</td>
      <td>{b === undefined ? words.dash : row.text(b)}</td>
      <td class="aside">{difference(a, b)}</td>
    </tr>
  );
}

function verdict(proof: ProofFigures | null): string {
  if (!proof) return words.dash;
  return proof.passed ? `✓ ${words.jobs.proofPassed}` : `✕ ${words.jobs.proofFailed}`;
}

function Over({ a, b }: { a: PlanFigures; b: PlanFigures }) {
  const both = (pick: (layer: PlanFigures["layers"][number]) => number) => [
    { name: "A", className: "series-a", values: a.layers.map(pick) },
    { name: "B", className: "series-b", values: b.layers.map(pick) },
  ];
  return (
    <section class="panel" aria-label={say.byLayer}>
      <LayersChart title={words.parts.plan.powderByLayer} unit="g" series={both((layer) => layer.powder_g)} />
      <LayersChart title={words.parts.plan.timeByLayer} unit="s" series={both((layer) => layer.deposit_s + layer.mill_s)} />
    </section>
  );
}
