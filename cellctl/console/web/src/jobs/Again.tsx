// A job once more: the same, with changes that are shown before they are made, or after it failed.
import { useEffect, useRef, useState } from "preact/hooks";
import { get, newKey, post } from "../api/http";
import type { Change, Job, Page } from "../api/types";
import { chosen, takeJob } from "../state/jobs";
import { noticeOf, told } from "../state/notices";
import { isOperator } from "../state/session";
import { words } from "../words";
import { Other } from "./GoOn";

const say = words.jobs;
const PAUSE_MS = 250;

async function make(job: Job, verb: string, body: object, key: string): Promise<void> {
  const made = await post<Job>(`/jobs/${job.id}/${verb}`, body, key);
  takeJob(made);
  chosen.value = made.id;
}

function asText(value: unknown): string {
  return value === null || value === undefined ? say.byItself : Array.isArray(value) ? value.join(", ") : String(value);
}

export function Changes({ changes }: { changes: Change[] }) {
  return (
    <ul class="texts">
      {changes.map((one) => (
        <li key={one.field}>{say.changed(one.field, asText(one.before), asText(one.after))}</li>
      ))}
    </ul>
  );
}

export function Again({ job }: { job: Job }) {
  const [isCloning, setCloning] = useState(false);
  const [busy, setBusy] = useState(false);
  const keys = useRef({ rerun: newKey("rerun"), retry: newKey("retry") });
  const again = async (verb: "rerun" | "retry") => {
    setBusy(true);
    try {
      await make(job, verb, {}, keys.current[verb]);
    } catch (error) {
      told(error);
      setBusy(false);
    }
  };
  const canRetry = job.state === "failed" && job.timestamps.running === undefined;
  return (
    <section class="panel again">
      <h2>{say.again}</h2>
      {job.made_from && <Other label={say.madeFrom[job.made_how] ?? ""} id={job.made_from} />}
      {job.changes.length > 0 && <Changes changes={job.changes} />}
      {!job.continues_job && (
        <>
          <p class="muted">{canRetry ? say.retryHint : say.rerunHint}</p>
          <div class="row">
            {canRetry && (
              <button type="button" class="control primary" disabled={!isOperator.value || busy} onClick={() => void again("retry")}>
                {say.retry}
              </button>
            )}
            <button type="button" class="control" disabled={!isOperator.value || busy} onClick={() => void again("rerun")}>
              {say.rerun}
            </button>
            <button type="button" class="control" aria-expanded={isCloning} disabled={!isOperator.value} onClick={() => setCloning(!isCloning)}>
              {say.clone}
            </button>
          </div>
        </>
      )}
      {isCloning && <CloneForm job={job} />}
    </section>
  );
}

function CloneForm({ job }: { job: Job }) {
  const [recipe, setRecipe] = useState<Record<string, unknown>>({});
  const [name, setName] = useState(job.name);
  const [shown, setShown] = useState<Change[]>([]);
  const [problem, setProblem] = useState("");
  const [materials, setMaterials] = useState<string[]>([job.material]);
  const key = useRef(newKey("clone"));
  useEffect(() => {
    get<Page<{ name: string }>>("/materials").then(({ items }) => setMaterials(items.map((one) => one.name)), told);
  }, []);
  const asked = JSON.stringify(recipe);
  useEffect(() => {
    const timer = setTimeout(() => {
      post<{ changes: Change[] }>(`/jobs/${job.id}/clone/changes`, { recipe }).then(
        ({ changes }) => {
          setShown(changes);
          setProblem("");
        },
        (error) => setProblem(noticeOf(error).detail || noticeOf(error).title),
      );
    }, PAUSE_MS);
    return () => clearTimeout(timer);
  }, [asked]);
  const set = (field: string, value: unknown) => setRecipe({ ...recipe, [field]: value });
  const send = (event: Event) => {
    event.preventDefault();
    make(job, "clone", { recipe, name }, key.current).catch((error) => {
      key.current = newKey("clone");
      setProblem(noticeOf(error).detail);
    });
  };
  return (
    <form class="clone-form" aria-label={say.cloneTitle} onSubmit={send}>
      <div class="form-grid">
        <label>
          {say.cloneName}
          <input value={name} maxLength={200} onInput={(event) => setName(event.currentTarget.value)} />
        </label>
        <label>
          {say.tolerance}, mm
          <input type="number" step="any" min="0.001" max="5" value={String(recipe.tolerance_mm ?? job.recipe.tolerance_mm ?? "")} onInput={(event) => set("tolerance_mm", Number(event.currentTarget.value))} />
        </label>
        <Select label={say.material} value={String(recipe.material ?? job.material)} options={materials.map((one) => [one, one])} set={(value) => set("material", value)} />
        <Select label={say.process} value={String(recipe.process ?? job.recipe.process)} options={Object.entries(say.processes)} set={(value) => set("process", value)} />
      </div>
      <h3>{say.cloneChanges}</h3>
      {shown.length === 0 ? <p class="muted">{say.cloneNothing}</p> : <Changes changes={shown} />}
      {problem && (
        <p class="problem" role="alert">
          {problem}
        </p>
      )}
      <div class="row end">
        <button type="submit" class="control primary" disabled={problem !== "" || shown.length === 0}>
          {say.cloneMake}
        </button>
      </div>
    </form>
  );
}

function Select({ label, value, options, set }: { label: string; value: string; options: [string, string][]; set: (value: string) => void }) {
  return (
    <label>
      {label}
      <select value={value} onChange={(event) => set(event.currentTarget.value)}>
        {options.map(([one, text]) => (
          <option key={one} value={one}>
            {text}
          </option>
        ))}
      </select>
    </label>
  );
}
