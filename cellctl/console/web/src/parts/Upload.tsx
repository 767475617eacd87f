// Files dropped or chosen: their units asked, their size shown in both, then sent one by one.
import { signal } from "@preact/signals";
import { useEffect, useState } from "preact/hooks";
import type { Part } from "../api/types";
import { noticeOf, type Notice } from "../state/notices";
import { isOperator } from "../state/session";
import { words } from "../words";
import { fixed } from "../words/format";
import { Found } from "./Found";
import { measured, type Box } from "./measured";
import { Problem } from "./Problem";
import { go } from "./route";
import { send, type Sending } from "./sending";
import { FileSize, MM_PER_INCH, sizeText } from "./sizes";

const say = words.parts;
const ACCEPTED = ".stl,.3mf,.obj,.ply";
type Units = "mm" | "inch";

interface Entry {
  key: number;
  file: File;
}

const entries = signal<Entry[]>([]);
let count = 0;

function take(files: FileList | null): void {
  entries.value = [...entries.value, ...[...(files ?? [])].map((file) => ({ key: ++count, file }))];
}

function drop(key: number): void {
  entries.value = entries.value.filter((entry) => entry.key !== key);
}

/** done: told of every part that arrived. */
export function Upload({ done }: { done: (part: Part) => void }) {
  const [isOver, setOver] = useState(false);
  if (!isOperator.value) return <p class="muted">{say.noUpload}</p>;
  const over = (is: boolean) => (event: DragEvent) => {
    event.preventDefault();
    setOver(is);
    if (event.type === "drop") take(event.dataTransfer?.files ?? null);
  };
  return (
    <section aria-label={say.upload} class="uploads">
      <label class={isOver ? "drop is-over" : "drop"} onDragOver={over(true)} onDragEnter={over(true)} onDragLeave={over(false)} onDrop={over(false)}>
        <b>{say.dropHere}</b>
        <span>{say.orChoose}</span>
        <input
          type="file"
          multiple
          accept={ACCEPTED}
          aria-label={say.choose}
          onChange={(event) => {
            take(event.currentTarget.files);
            event.currentTarget.value = "";
          }}
        />
      </label>
      {entries.value.map((entry) => (
        <OneFile key={entry.key} entry={entry} done={done} />
      ))}
    </section>
  );
}

function OneFile({ entry, done }: { entry: Entry; done: (part: Part) => void }) {
  const { file } = entry;
  const [box, setBox] = useState<Box | null>(null);
  const [units, setUnits] = useState<Units | null>(null);
  const [state, setState] = useState<Sending | null>(null);
  const [part, setPart] = useState<Part | null>(null);
  const [problem, setProblem] = useState<Notice | null>(null);
  const [aborter, setAborter] = useState<AbortController | null>(null);
  useEffect(() => void measured(file).then(setBox, () => setBox(null)), [file]);
  const start = async () => {
    if (!units) return;
    const own = new AbortController();
    setAborter(own);
    setProblem(null);
    try {
      const made = await send(file, units, setState, own.signal);
      setPart(made);
      done(made);
    } catch (error) {
      if (!own.signal.aborted) setProblem(noticeOf(error));
    }
    setState(null);
    setAborter(null);
  };
  return (
    <div class="panel file">
      <div class="panel-head">
        <b class="file-name">{file.name}</b>
        <FileSize bytes={file.size} />
      </div>
      {!part && !state && <Units box={box} units={units} choose={setUnits} name={`units-${entry.key}`} />}
      {state && <Way state={state} />}
      <Problem of={problem} />
      {part && <Arrived part={part} />}
      <div class="row end">
        <button
          type="button"
          class="control"
          onClick={() => {
            aborter?.abort();
            drop(entry.key);
          }}
        >
          {part ? say.close : say.cancel}
        </button>
        {part ? (
          <button type="button" class="control primary" onClick={() => go({ view: "part", part: part.id, like: null })}>
            {say.openPart}
          </button>
        ) : (
          <button type="button" class="control primary" disabled={!units || state !== null} onClick={() => void start()}>
            {problem ? say.again : say.send}
          </button>
        )}
      </div>
    </div>
  );
}

function Units({ box, units, choose, name }: { box: Box | null; units: Units | null; choose: (units: Units) => void; name: string }) {
  return (
    <fieldset class="units">
      <legend>{say.unitsAsked}</legend>
      {(["mm", "inch"] as const).map((unit) => (
        <label class="check unit" key={unit}>
          <input type="radio" name={name} checked={units === unit} onChange={() => choose(unit)} />
          <span>
            <b>{say.units[unit]}</b>
            {box && <span class="unit-size">{sizeText(box, unit === "inch" ? MM_PER_INCH : 1)}</span>}
          </span>
        </label>
      ))}
      {!box && <p class="muted">{say.sizeLater}</p>}
    </fieldset>
  );
}

function Way({ state }: { state: Sending }) {
  const text = state.isBroken ? say.broken : state.isChecking ? say.checking : say.sent(fixed((100 * state.sent) / Math.max(state.total, 1), 0));
  return (
    <div class="working" role="status">
      <span class={state.isBroken ? "tone-hold" : ""}>{text}</span>
      <progress {...(state.isChecking ? {} : { max: Math.max(state.total, 1), value: state.sent })} aria-label={say.sending} />
    </div>
  );
}

function Arrived({ part }: { part: Part }) {
  const [low = [], high = []] = part.bbox_mm;
  const box = [0, 1, 2].map((k) => (high[k] ?? 0) - (low[k] ?? 0)) as Box;
  return (
    <>
      <p>
        <b class="tone-run">✓ {say.arrived}</b> {sizeText(box, 1)}
      </p>
      <Found findings={part.findings} />
    </>
  );
}
