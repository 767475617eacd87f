// One part: how it looks, what was found in it, what it would take, and submitting it.
import { useState } from "preact/hooks";
import { newKey, post } from "../api/http";
import { CellChoice, cellOf } from "../cells/CellChoice";
import type { Job, Page, Part } from "../api/types";
import { newestFirst, takeJob } from "../state/jobs";
import { noticeOf, type Notice } from "../state/notices";
import { isOperator } from "../state/session";
import { words } from "../words";
import { fixed, whole } from "../words/format";
import { JobState } from "../jobs/JobState";
import { useAsked } from "./asked";
import type { MaterialFacts, Schema } from "./documents";
import { EstimateBox } from "./EstimateBox";
import { useEstimate } from "./estimating";
import { Found } from "./Found";
import type { Box } from "./measured";
import { PartStage } from "./PartStage";
import { Problem } from "./Problem";
import { faultOf, sent, type Recipe } from "./recipe";
import { RecipeForm } from "./RecipeForm";
import { addressOf, go, type Route } from "./route";
import { FileSize, grams, sizeText } from "./sizes";

const say = words.parts;

export function PartPage({ id, like }: { id: string; like: string | null }) {
  const part = useAsked<Part>(`/parts/${id}`);
  const schema = useAsked<Schema>("/recipe/schema");
  const materials = useAsked<Page<{ name: string; facts: MaterialFacts }>>("/materials");
  const model = useAsked<Job>(like ? `/jobs/${like}` : null);
  const problem = part.problem ?? schema.problem ?? materials.problem ?? model.problem;
  const isReady = part.found && schema.found && materials.found && (!like || model.found);
  return (
    <div class="part-page">
      <Back to={{ view: "list" }} text={say.all} />
      <Problem of={problem} />
      {!isReady && !problem && <p class="muted">{words.view.loading}</p>}
      {isReady && part.found && schema.found && materials.found && (
        <Whole part={part.found} schema={schema.found} materials={materials.found.items.map(({ facts }) => facts)} begin={model.found?.recipe ?? {}} />
      )}
    </div>
  );
}

export function Back({ to, text }: { to: Route; text: string }) {
  return (
    <div>
      <button type="button" class="control" onClick={() => go(to)}>
        ‹ {text}
      </button>
    </div>
  );
}

function Whole({ part, schema, materials, begin }: { part: Part; schema: Schema; materials: MaterialFacts[]; begin: Recipe }) {
  const [recipe, change] = useState<Recipe>({ material: materials[0]?.name, ...chosen(begin, schema) });
  const [mark, setMark] = useState<number | null>(null);
  const material = materials.find(({ name }) => name === recipe.material) ?? null;
  const hasFault = Object.entries(recipe).some(([name, value]) => faultOf(name, value, schema.properties[name], material) !== "");
  const estimating = useEstimate(part.id, hasFault ? null : sent(recipe));
  return (
    <div class="part-columns">
      <div class="part-left">
        <PartStage part={part} place={mark === null ? null : (part.findings[mark]?.place_mm ?? null)} />
        <Facts part={part} materials={materials} />
        <section class="panel" aria-label={say.findings}>
          <h2>{say.findings}</h2>
          <Found findings={part.findings} shown={mark} show={setMark} />
        </section>
        <JobsOf part={part.id} />
      </div>
      <div class="part-right">
        <EstimateBox state={estimating} />
        <RecipeForm schema={schema} materials={materials} material={material} recipe={recipe} change={change} />
        <Submit part={part} recipe={hasFault ? null : sent(recipe)} />
      </div>
    </div>
  );
}

/** Of another job's recipe, what differs from the schema's defaults. */
function chosen(begin: Recipe, schema: Schema): Recipe {
  const differs = ([name, value]: [string, unknown]) => JSON.stringify(value) !== JSON.stringify(schema.properties[name]?.default) && name !== "stock";
  return Object.fromEntries(Object.entries(begin).filter(differs));
}

function Facts({ part, materials }: { part: Part; materials: MaterialFacts[] }) {
  const [low = [], high = []] = part.bbox_mm;
  const box = [0, 1, 2].map((k) => (high[k] ?? 0) - (low[k] ?? 0)) as Box;
  const masses = materials.map(({ name, density_g_mm3 }) => `${name} ${grams(density_g_mm3 * part.volume_mm3)}`);
  return (
    <section class="panel" aria-label={part.name}>
      <h2 class="part-name">{part.name}</h2>
      <dl class="pairs stacked">
        <dt>{say.size}</dt>
        <dd>{sizeText(box, 1)}</dd>
        <dt>{say.fileUnits}</dt>
        <dd>
          {say.units[part.units]} · <FileSize bytes={part.bytes} />
        </dd>
        <dt>{say.volume}</dt>
        <dd>{fixed(part.volume_mm3 / 1000, 2)} cm³</dd>
        <dt>{say.facets}</dt>
        <dd>{whole(part.facets)}</dd>
        <dt>{say.mass}</dt>
        <dd>{masses.join(" · ")}</dd>
      </dl>
    </section>
  );
}

function JobsOf({ part }: { part: string }) {
  const jobs = newestFirst.value.filter((job) => job.part_id === part);
  if (jobs.length === 0) return null;
  return (
    <section class="panel" aria-label={say.jobs}>
      <h2>{say.jobs}</h2>
      <ul class="job-links">
        {jobs.map((job) => (
          <li key={job.id}>
            <a
              href={addressOf({ view: "plan", job: job.id })}
              onClick={(event) => {
                event.preventDefault();
                go({ view: "plan", job: job.id });
              }}
            >
              {job.name}
            </a>
            <JobState state={job.state} />
          </li>
        ))}
      </ul>
    </section>
  );
}

function Submit({ part, recipe }: { part: Part; recipe: Recipe | null }) {
  const [name, setName] = useState(part.name);
  const [busy, setBusy] = useState(false);
  const [problem, setProblem] = useState<Notice | null>(null);
  if (!isOperator.value) return <p class="muted">{say.noUpload}</p>;
  const submit = async (event: Event) => {
    event.preventDefault();
    const cell = cellOf(new FormData(event.currentTarget as HTMLFormElement));
    setBusy(true);
    setProblem(null);
    try {
      const job = await post<Job>("/jobs", { part_id: part.id, recipe, ...cell, ...(name.trim() ? { name: name.trim() } : {}) }, newKey("job"));
      takeJob(job);
      go({ view: "plan", job: job.id });
    } catch (error) {
      setProblem(noticeOf(error));
      setBusy(false);
    }
  };
  return (
    <form class="panel submit" onSubmit={(event) => void submit(event)}>
      <div class="row">
        <label class="grow">
          {say.jobName}
          <input value={name} maxLength={200} onInput={(event) => setName(event.currentTarget.value)} />
        </label>
        <CellChoice />
        <button type="submit" class="control primary" disabled={busy || !recipe}>
          {say.submit}
        </button>
      </div>
      <small class="muted">{say.submitHint}</small>
      <Problem of={problem} />
    </form>
  );
}
