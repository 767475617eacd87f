// The 3-D view: the drawing, what is laid over it, and the bars by which one goes through layers and time.
import { computed, effect, signal, untracked } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { isStale, snapshot } from "../state/cell";
import { shown } from "../state/jobs";
import { facts, plan } from "../state/plan";
import { theme } from "../state/theme";
import { words } from "../words";
import { drawing, drawn, flat, loaded, reading } from "./drawing";
import { FindingsList, Pins, placePins } from "./Findings";
import { FlatView } from "./flat_view";
import { LayerBar } from "./LayerBar";
import { Legend } from "./Legend";
import { stepByKey } from "./LineSteps";
import { PlanView } from "./plan_view";
import { Reading } from "./Reading";
import { ScrubBar, ScrubCard } from "./ScrubBar";
import { standOfMoment, standOfSnapshot } from "./stand";
import {
  followFindings,
  layer,
  layerByHand,
  layerCount,
  moment,
  onCell,
  quantity,
  scrubLine,
  scrubTime,
  shownMode,
  track,
  withBelow,
  withMachine,
  withMetal,
  withPart,
} from "./state";
import { ViewHead } from "./ViewHead";

const say = words.view;
const ORBIT_STEP = Math.PI / 24;
const ZOOM_STEP = 1.15;

/** Hash of the shown job's program. */
const program = computed(() => (shown.value && shown.value.id === plan.value?.job ? (shown.value.program_sha256 ?? "") : ""));
const isBuilt = computed(() => shown.value?.state === "completed" && shown.value.id === plan.value?.job);

/** The moment that is shown: of the program's time, or of the line that the cell executes. */
function momentNow(view: PlanView) {
  const lines = view.track;
  if (!lines) return null;
  if (shownMode.value === "scrub") return scrubLine.value >= 0 ? lines.atEnd(scrubLine.value) : lines.atTime(scrubTime.value);
  const now = onCell.value ? snapshot.value : null;
  if (!now) return null;
  const line = now.lines.executing > 0 ? now.lines.executing - 1 : now.lines.executed - 1;
  return line < 0 ? null : lines.atLine(line, now.tip);
}

function show(view: PlanView): void {
  const now = onCell.value ? snapshot.value : null; // without a job on the cell no snapshot draws a frame
  const isLayer = shownMode.value === "layer";
  const found = isLayer && !onCell.value ? null : momentNow(view);
  if (!isLayer) moment.value = found ?? (shownMode.value === "scrub" ? moment.peek() : null);
  const at = isLayer ? (onCell.value ? found : null) : moment.peek();
  const live = onCell.value && now && shownMode.value !== "scrub" ? standOfSnapshot(now) : null;
  const scrubbed =
    shownMode.value === "scrub" && at && view.track ? standOfMoment(at, view.track.index.axes, view.tipAt(at), view.holdingAt(at)) : null;
  view.show({
    layer: layer.value,
    moment: at,
    isExecuted: isLayer && isBuilt.value,
    stand: scrubbed ?? live,
    quantity: quantity.value,
    below: withBelow.value,
    part: withPart.value,
    metal: withMetal.value,
    machine: withMachine.value,
  });
}

function connect(host: HTMLElement): () => void {
  let view: PlanView;
  try {
    view = new PlanView(host, () => told(host, view), () => (loaded.value = loaded.peek() + 1));
  } catch (error) {
    console.warn(error);
    return connectFlat(host);
  }
  drawing.value = view;
  const painted = signal(false);
  const ends = [
    effect(() => view.setFacts(facts.value)),
    effect(() => {
      view.setPlan(plan.value);
      untracked(() => {
        layerByHand.value = Math.max(0, layerCount.value - 1);
        moment.value = null;
        scrubLine.value = -1;
        track.value = null;
      });
    }),
    effect(() => {
      void plan.value;
      view.setProgram(program.value);
    }),
    effect(() => {
      void loaded.value;
      track.value = view.track?.index ?? null;
    }),
    effect(() => {
      void loaded.value;
      show(view);
    }),
    effect(() => {
      void theme.value;
      if (painted.peek()) untracked(() => view.paint());
      painted.value = true;
    }),
    followFindings(),
  ];
  return () => {
    for (const end of ends) end();
    drawing.value = null;
    view.dispose();
  };
}

/** Without WebGL: the layer flat, as it is. */
function connectFlat(host: HTMLElement): () => void {
  const view = new FlatView(host);
  flat.value = view;
  const ends = [
    effect(() => {
      view.setPlan(plan.value);
      untracked(() => (layerByHand.value = Math.max(0, layerCount.value - 1)));
    }),
    effect(() => {
      void theme.value;
      view.show(layer.value, quantity.value, onCell.value && snapshot.value ? snapshot.value.tip : null);
    }),
    followFindings(),
  ];
  return () => {
    for (const end of ends) end();
    flat.value = null;
    view.dispose();
  };
}

/** What the drawing costs is written on its element, for whoever looks after it. */
function told(host: HTMLElement, view: PlanView): void {
  const { calls, triangles, lines, bytes, frames, frameMs, longestMs, layers, isReady } = view.costs;
  Object.assign(host.dataset, { calls, triangles, lines, bytes, frames, layers });
  host.dataset.frameMs = frameMs.toFixed(2);
  host.dataset.longestMs = longestMs.toFixed(2);
  host.dataset.tool = view.toolName;
  host.dataset.tip = view.tip;
  host.dataset.ready = String(isReady);
  placePins(view);
  drawn.value++;
}

function onKey(event: KeyboardEvent): void {
  const view = drawing.peek();
  if (!view || event.ctrlKey || event.metaKey || event.altKey) return;
  const turns: Record<string, [number, number, number]> = {
    ArrowLeft: [-ORBIT_STEP, 0, 1],
    ArrowRight: [ORBIT_STEP, 0, 1],
    ArrowUp: [0, ORBIT_STEP, 1],
    ArrowDown: [0, -ORBIT_STEP, 1],
    "+": [0, 0, ZOOM_STEP],
    "=": [0, 0, ZOOM_STEP],
    "-": [0, 0, 1 / ZOOM_STEP],
  };
  if (stepByKey(event)) return event.preventDefault();
  const turn = turns[event.key];
  if (!turn) return;
  event.preventDefault();
  view.stage.orbit(...turn);
}

function onPoint(event: PointerEvent): void {
  const view = drawing.peek();
  if (!view || (event.type === "pointermove" && event.buttons)) return;
  const box = view.stage.canvas.getBoundingClientRect();
  reading.value = { x: event.clientX - box.left, y: event.clientY - box.top };
}

export function View3d() {
  const host = useRef<HTMLDivElement>(null);
  useEffect(() => (host.current ? connect(host.current) : undefined), []);
  return (
    <section class="view panel" aria-label={say.region}>
      <div class={shownMode.value === "scrub" ? "view-space is-scrubbing" : "view-space"}>
        <div
          class={isStale.value && onCell.value && shownMode.value === "live" ? "stage is-stale" : "stage"}
          ref={host}
          tabIndex={0}
          role="application"
          aria-label={say.stage}
          onKeyDown={onKey}
          onPointerMove={onPoint}
          onClick={onPoint as unknown as (event: MouseEvent) => void}
          onPointerLeave={() => (reading.value = null)}
        />
        <Pins />
        <ViewHead />
        <Empty />
        <ScrubCard />
        {plan.value && <Legend />}
        <FindingsList />
        <Reading />
      </div>
      <LayerBar />
      <ScrubBar />
    </section>
  );
}

function Empty() {
  const job = shown.value;
  const empty = !job ? say.nothing : !job.plan_sha256 ? say.notPlanned : plan.value ? "" : say.loading;
  void loaded.value;
  if (empty) return <p class="view-empty">{empty}</p>;
  if (drawing.value?.isMissing) return <p class="view-flat" role="status">{say.notCome}</p>;
  return flat.value ? <p class="view-flat">{say.noGl}</p> : null;
}
