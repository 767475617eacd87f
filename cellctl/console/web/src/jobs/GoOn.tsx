// A job that was interrupted: where metal ended, how that is known, and from where a new job goes on.
import { useEffect, useRef, useState } from "preact/hooks";
import { get, newKey, post } from "../api/http";
import type { Job, ResumptionPoint, Standpoint } from "../api/types";
import { chosen, jobs, takeJob } from "../state/jobs";
import { told } from "../state/notices";
import { isOperator } from "../state/session";
import { words } from "../words";
import { fixed, whole } from "../words/format";
import { Texts } from "./JobDetail";

const say = words.goOn;
const INTERRUPTED = ["interrupted", "aborted", "failed"];
type From = "metal_end" | "layer" | "operation";

export function GoOn({ job }: { job: Job }) {
  const [point, setPoint] = useState<ResumptionPoint | null>(null);
  const isOver = INTERRUPTED.includes(job.state) && job.program_sha256 !== null && job.approved_by !== "";
  const known = jobs.value.size; // another job may have come that goes on with it
  useEffect(() => {
    if (!isOver) return;
    const aborter = new AbortController();
    get<ResumptionPoint>(`/jobs/${job.id}/resumption-point`, aborter.signal).then(setPoint, (error) => aborter.signal.aborted || told(error));
    return () => aborter.abort();
  }, [job.id, job.state, isOver, known]);
  if (!isOver || !point?.metal_end) return null;
  return (
    <section class="panel go-on">
      <h2>{say.title}</h2>
      <Where end={point.metal_end} point={point} />
      <Texts texts={point.notes} />
      {point.why_not && (
        <p class="why">
          {say.cannot} {point.why_not}
        </p>
      )}
      {point.continued_by.map((id) => (
        <Other key={id} label={say.continuedBy} id={id} />
      ))}
      {point.possible && <Ask job={job} point={point} />}
    </section>
  );
}

function Where({ end, point }: { end: Standpoint; point: ResumptionPoint }) {
  const [x = 0, y = 0, z = 0] = end.tip_mm;
  const rows: [string, string][] = [
    [say.ended, end.text],
    [say.known, end.known_by_text],
    [say.at, say.place(fixed(x, 2), fixed(y, 2), fixed(z, 2))],
    [say.executed, `${whole(point.lines_executed)} / ${whole(point.lines_total)}`],
  ];
  return (
    <dl class="pairs stacked">
      {rows.map(([name, value]) => (
        <div key={name}>
          <dt>{name}</dt>
          <dd>{value}</dd>
        </div>
      ))}
    </dl>
  );
}

/** A job that this one has to do with, to be opened. */
export function Other({ label, id }: { label: string; id: string }) {
  return (
    <p>
      {label}{" "}
      <button type="button" class="link" onClick={() => (chosen.value = id)}>
        {jobs.value.get(id)?.name ?? id}
      </button>
    </p>
  );
}

function Ask({ job, point }: { job: Job; point: ResumptionPoint }) {
  const [from, setFrom] = useState<From>("metal_end");
  const [busy, setBusy] = useState(false);
  const sent = useRef({ asked: "", key: "" }); // asked again after a lost answer it is the same request
  const layers = [...new Set(point.choices.map((choice) => choice.layer))];
  const submit = async (event: SubmitEvent) => {
    event.preventDefault();
    setBusy(true);
    const form = new FormData(event.currentTarget as HTMLFormElement);
    const overlap = String(form.get("overlap") ?? "");
    const body: Record<string, unknown> = { from, because: String(form.get("because") ?? "").trim() };
    if (from !== "metal_end") body[from] = Number(form.get(from));
    if (overlap) body.overlap_mm = Number(overlap);
    const asked = JSON.stringify(body);
    if (sent.current.asked !== asked) sent.current = { asked, key: newKey("go-on") };
    try {
      const made = await post<Job>(`/jobs/${job.id}/resume`, body, sent.current.key);
      takeJob(made);
      chosen.value = made.id;
    } catch (error) {
      told(error);
    } finally {
      setBusy(false);
    }
  };
  const ways: [From, string][] = [
    ["metal_end", say.metalEnd],
    ["layer", say.layerBegin],
    ["operation", say.operationBegin],
  ];
  return (
    <form class="go-on-form" onSubmit={(event) => void submit(event)}>
      <label>
        {say.from}
        <select value={from} onChange={(event) => setFrom(event.currentTarget.value as From)}>
          {ways.map(([name, label]) => (
            <option key={name} value={name}>
              {label}
            </option>
          ))}
        </select>
      </label>
      {from === "layer" && (
        <label>
          {say.layer}
          <select name="layer">
            {layers.map((index) => (
              <option key={index} value={index} selected={index === point.metal_end?.layer}>
                {say.layerOption(index, point.layers)}
              </option>
            ))}
          </select>
        </label>
      )}
      {from === "operation" && (
        <label>
          {say.operation}
          <select name="operation">
            {point.choices.map((choice) => (
              <option key={choice.operation} value={choice.operation} selected={choice.operation === point.metal_end?.operation}>
                {say.operationOption(choice.operation, words.process[choice.process] ?? choice.process, choice.layer)}
              </option>
            ))}
          </select>
        </label>
      )}
      <label>
        {say.overlap}
        <input name="overlap" type="number" min={0} max={1000} step="0.1" />
      </label>
      <label>
        {say.because}
        <input name="because" maxLength={500} />
      </label>
      <p class="muted">{say.hint}</p>
      <div class="row">
        <button type="submit" class="control primary" disabled={!isOperator.value || busy}>
          {say.submit}
        </button>
      </div>
    </form>
  );
}
