// A new job: a part file with its units, and the recipe's first choices.
import { useEffect, useState } from "preact/hooks";
import { get, newKey, post, postForm } from "../api/http";
import type { Job, Page, Part } from "../api/types";
import { CellChoice, cellOf } from "../cells/CellChoice";
import { takeJob } from "../state/jobs";
import { noticeOf, type Notice } from "../state/notices";
import { words } from "../words";

const say = words.submit;
const ACCEPTED = ".stl,.3mf,.obj,.ply";
const DEFAULT_TOLERANCE_MM = "0.1";

interface Named {
  name: string;
}

function direction(text: string): string | number[] {
  return text === "auto" ? text : text.split(",").map(Number);
}

async function submit(form: HTMLFormElement): Promise<Job> {
  const given = new FormData(form);
  const file = given.get("file");
  if (!(file instanceof File) || file.size === 0) throw new Error(say.noFile);
  const upload = new FormData();
  upload.set("file", file);
  upload.set("units", String(given.get("units")));
  const part = await postForm<Part>("/parts", upload, newKey("part"));
  const recipe = {
    material: String(given.get("material")),
    process: String(given.get("process")),
    build_direction: direction(String(given.get("direction"))),
    tolerance_mm: Number(given.get("tolerance")),
  };
  const name = String(given.get("name")).trim();
  return post<Job>("/jobs", { part_id: part.id, recipe, ...cellOf(given), ...(name ? { name } : {}) }, newKey("job"));
}

export function NewJob({ done }: { done: (job: string | null) => void }) {
  const [materials, setMaterials] = useState<string[]>([]);
  const [busy, setBusy] = useState(false);
  const [problem, setProblem] = useState<Notice | null>(null);
  useEffect(() => {
    get<Page<Named>>("/materials").then(
      ({ items }) => setMaterials(items.map(({ name }) => name)),
      (error) => setProblem(noticeOf(error)),
    );
  }, []);
  const send = async (event: Event) => {
    event.preventDefault();
    setBusy(true);
    setProblem(null);
    try {
      const job = await submit(event.currentTarget as HTMLFormElement);
      takeJob(job);
      done(job.id);
    } catch (error) {
      setProblem(noticeOf(error));
      setBusy(false);
    }
  };
  return (
    <form class="panel new-job" onSubmit={(event) => void send(event)}>
      <h2>{say.title}</h2>
      <label>
        {say.file}
        <input type="file" name="file" accept={ACCEPTED} required />
      </label>
      <fieldset class="choice">
        <legend>{say.units}</legend>
        {(["mm", "inch"] as const).map((unit) => (
          <label class="check" key={unit}>
            <input type="radio" name="units" value={unit} defaultChecked={unit === "mm"} /> {say[unit]}
          </label>
        ))}
      </fieldset>
      <label>
        {say.name}
        <input name="name" maxLength={200} />
      </label>
      <div class="form-grid">
        <Choice label={say.material} name="material" options={materials.map((name) => [name, name])} />
        <CellChoice />
        <Choice label={say.process} name="process" options={Object.entries(say.processes)} />
        <Choice label={say.direction} name="direction" options={Object.entries(say.directions)} />
        <label>
          {say.tolerance}
          <input type="number" name="tolerance" min="0.001" max="5" step="any" required defaultValue={DEFAULT_TOLERANCE_MM} />
        </label>
      </div>
      {problem && (
        <p class="problem" role="alert">
          <b>{problem.title}</b> {problem.detail} {problem.hint}
        </p>
      )}
      <div class="row end">
        <button type="button" class="control" onClick={() => done(null)}>
          {say.cancel}
        </button>
        <button type="submit" class="control primary" disabled={busy || materials.length === 0}>
          {busy ? say.uploading : say.submit}
        </button>
      </div>
    </form>
  );
}

function Choice({ label, name, options }: { label: string; name: string; options: [string, string][] }) {
  return (
    <label>
      {label}
      <select name={name}>
        {options.map(([value, text]) => (
          <option key={value} value={value}>
            {text}
          </option>
        ))}
      </select>
    </label>
  );
}
