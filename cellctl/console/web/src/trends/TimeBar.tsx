// Which time is shown: the last minutes or hours, a date and time, a job or a layer of it; and steps along it.
import { signal } from "@preact/signals";
import { get } from "../api/http";
import type { TrendMark, TrendMarks } from "../api/types";
import { edges, isFollowing, isLoading, pointed, show, SPANS, window_ } from "../state/history";
import { jobs, newestFirst } from "../state/jobs";
import { told } from "../state/notices";
import { trendNow } from "../state/trends";
import { words } from "../words";
import { moment } from "../words/format";
import { back, closer, farther, follow, forward } from "./gestures";

const say = words.trendPage;
const LAYER_MARGIN = 0.02; // of a job's or layer's time, shown to either side
const SHORTEST_S = 10;

const layersOf = signal<{ job: string; marks: TrendMark[] } | null>(null);

function showBetween(from: number, to: number): void {
  const span = Math.max(to - from, SHORTEST_S) * (1 + 2 * LAYER_MARGIN);
  pointed.value = null;
  show(span, to + (to - from) * LAYER_MARGIN);
}

/** Show a job from its begin to its end, and learn when its layers began. */
async function showJob(id: string): Promise<void> {
  layersOf.value = null;
  if (!id) return;
  try {
    const found = (await get<TrendMarks>(`/cell/trends/marks?job=${encodeURIComponent(id)}&layers=true`)).items;
    layersOf.value = { job: id, marks: found };
    const first = found[0];
    if (first) showBetween(first.at, endOf(id, found));
  } catch (error) {
    told(error);
  }
}

function endOf(id: string, found: TrendMark[]): number {
  const runs = ["running", "held"].includes(jobs.peek().get(id)?.state ?? "");
  return runs ? trendNow() : (found.at(-1)?.at ?? trendNow());
}

function showLayer(layer: number): void {
  const known = layersOf.peek();
  if (!known) return;
  const begins = known.marks.filter(({ kind }) => kind === "layer");
  const at = begins.findIndex((mark) => mark.layer === layer);
  const begin = begins[at];
  if (begin) showBetween(begin.at, begins[at + 1]?.at ?? endOf(known.job, known.marks));
}

/** Unix seconds of what a field of date and time holds, which is local. */
function showAt(text: string): void {
  const at = new Date(text).getTime() / 1000;
  if (!Number.isFinite(at)) return;
  pointed.value = at;
  show(window_.peek().span, at + window_.peek().span / 2);
}

/** Local date and time as the field wants it. */
function localOf(at: number): string {
  const date = new Date(at * 1000);
  return new Date(date.getTime() - date.getTimezoneOffset() * 60_000).toISOString().slice(0, 19);
}

export function TimeBar() {
  const { span } = window_.value;
  return (
    <section class="panel time-bar" aria-label={say.time}>
      <div class="spans" role="group" aria-label={say.spans}>
        {SPANS.map((seconds) => (
          <button type="button" class="control" key={seconds} aria-pressed={isFollowing.value && span === seconds} onClick={() => follow(seconds)}>
            {say.span(seconds)}
          </button>
        ))}
      </div>
      <div class="steps" role="group" aria-label={say.steps}>
        <Step label={say.back} sign="◀" act={back} />
        <Step label={say.forward} sign="▶" act={forward} off={isFollowing.value} />
        <Step label={say.closer} sign="+" act={closer} />
        <Step label={say.farther} sign="−" act={farther} />
      </div>
      <Moments />
      <Shown />
    </section>
  );
}

function Step({ label, sign, act, off = false }: { label: string; sign: string; act: () => void; off?: boolean }) {
  return (
    <button type="button" class="control" aria-label={label} title={label} disabled={off} onClick={act}>
      {sign}
    </button>
  );
}

function Moments() {
  const known = layersOf.value;
  const layers = known?.marks.filter(({ kind, layer }) => kind === "layer" && layer !== null) ?? [];
  const ran = newestFirst.value.filter((job) => job.lines_executed > 0 || ["running", "held"].includes(job.state));
  return (
    <>
      <label>
        {say.at}
        <input type="datetime-local" step={1} onChange={(event) => showAt(event.currentTarget.value)} max={localOf(trendNow() || Date.now() / 1000)} />
      </label>
      <label class="pick">
        {say.job}
        <select value={known?.job ?? ""} onChange={(event) => void showJob(event.currentTarget.value)}>
          <option value="">{say.noJob}</option>
          {ran.map((job) => (
            <option key={job.id} value={job.id}>
              {job.name}
            </option>
          ))}
        </select>
      </label>
      <label class="pick">
        {say.layer}
        <select disabled={layers.length === 0} onChange={(event) => showLayer(Number(event.currentTarget.value))}>
          <option value="">{say.noLayer}</option>
          {layers.map(({ seq, layer }) => (
            <option key={seq} value={layer ?? 0}>
              {(layer ?? 0) + 1}
            </option>
          ))}
        </select>
      </label>
    </>
  );
}

/** From when to when, in words; and whether it follows. */
function Shown() {
  void window_.value;
  const [from, to] = edges();
  return (
    <p class="shown" aria-live="polite">
      <b>{isFollowing.value ? say.following : say.standing}</b>
      {!isFollowing.value && <span> {say.between(moment(from), moment(to))}</span>}
      {isLoading.value && <span class="muted"> {say.loading}</span>}
    </p>
  );
}
