// The 3-D view with its layer slider.
import { computed, effect, signal, untracked } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { PlanLayer } from "../api/types";
import { isStale, snapshot } from "../state/cell";
import { shown } from "../state/jobs";
import { facts, operations, plan } from "../state/plan";
import { theme } from "../state/theme";
import { words } from "../words";
import { PlanView } from "./plan_view";
import type { ViewName } from "./stage";

const say = words.view;
const isFollowing = signal(true);
const byHand = signal(0);
const withBelow = signal(true);
const withPart = signal(true);
const hasGl = signal(true);

const count = computed(() => plan.value?.plan.layers.length ?? 0);
const onCell = computed(() => {
  const job = snapshot.value?.job;
  return job && job.id === plan.value?.job && !job.outcome ? job : null;
});
const place = computed(() => (onCell.value ? operations.value[onCell.value.operation] : undefined));
const liveLayer = computed(() => (onCell.value ? (place.value?.layer ?? onCell.value.layer) : -1));
const layer = computed(() => {
  const wanted = isFollowing.value && liveLayer.value >= 0 ? liveLayer.value : byHand.value;
  return Math.min(Math.max(0, wanted), Math.max(0, count.value - 1));
});

function connect(host: HTMLElement): () => void {
  let view: PlanView;
  try {
    view = new PlanView(host);
  } catch (error) {
    console.warn(error);
    hasGl.value = false;
    return () => undefined;
  }
  active = view;
  let isFirstPaint = true;
  const ends = [
    effect(() => {
      const current = plan.value;
      view.setPlan(current);
      untracked(() => {
        byHand.value = Math.max(0, (current?.plan.layers.length ?? 1) - 1);
        view.setLayer(layer.value, withBelow.value);
      });
    }),
    effect(() => view.setLayer(layer.value, withBelow.value)),
    effect(() => view.showPart(withPart.value)),
    effect(() => {
      void theme.value;
      if (isFirstPaint) isFirstPaint = false;
      else untracked(() => view.paint());
    }),
    effect(() => {
      void layer.value;
      view.follow(snapshot.value, place.value, facts.value?.tools ?? []);
    }),
  ];
  return () => {
    for (const end of ends) end();
    view.dispose();
    active = null;
  };
}

let active: PlanView | null = null;

export function View3d() {
  const host = useRef<HTMLDivElement>(null);
  useEffect(() => (host.current ? connect(host.current) : undefined), []);
  return (
    <section class="view panel" aria-label={say.region}>
      <div class={isStale.value && onCell.value ? "stage is-stale" : "stage"} ref={host} />
      <Overlay />
      <LayerBar />
    </section>
  );
}

function Overlay() {
  const job = shown.value;
  const empty = !hasGl.value ? say.noGl : !job ? say.nothing : !job.plan_sha256 ? say.notPlanned : plan.value ? "" : say.loading;
  return (
    <>
      <div class="view-head">
        <strong class="view-name">{job?.name ?? ""}</strong>
        <div class="view-tools" role="group">
          {(["fit", "top", "side"] as ViewName[]).map((name) => (
            <button type="button" class="small" key={name} onClick={() => active?.look(name, plan.value?.plan.layers[layer.value]?.bottom?.slice(3))}>
              {say[name as "fit" | "top" | "side"]}
            </button>
          ))}
          <Toggle on={withPart} label={say.part} aria={say.partAria} />
          <Toggle on={withBelow} label={say.below} aria={say.belowAria} />
        </div>
      </div>
      {empty && <p class="view-empty">{empty}</p>}
      {plan.value && <Legend />}
    </>
  );
}

function Toggle({ on, label, aria }: { on: { value: boolean }; label: string; aria: string }) {
  return (
    <button type="button" class="small" aria-pressed={on.value} aria-label={aria} onClick={() => (on.value = !on.value)}>
      {label}
    </button>
  );
}

function Legend() {
  return (
    <ul class="legend" aria-label={say.legend}>
      {Object.entries(say.processes).map(([name, label]) => (
        <li key={name}>
          <i class={`swatch ${name}`} />
          {label}
        </li>
      ))}
      {onCell.value && <li class="muted">{say.done}</li>}
    </ul>
  );
}

/** Height of a level layer; tilt and thickness of another one; the piece where there are several. */
function placeOf(facts: PlanLayer): string {
  const pieces = plan.value?.plan.subcomponents ?? [];
  const name = pieces.length > 1 ? pieces[facts.subcomponent]?.name : undefined;
  const [least = 0, greatest = 0] = facts.thickness_mm ?? [];
  const where = facts.tilt_deg > 0 ? say.tilted(facts.tilt_deg, least, greatest) : say.height(facts.z_top);
  return [where, name && say.piece(name), facts.overhang_mm2 > 0 && say.overhang(facts.overhang_mm2)].filter(Boolean).join(" · ");
}

function LayerBar() {
  if (count.value === 0) return null;
  const facts = plan.value?.plan.layers[layer.value];
  const canFollow = liveLayer.value >= 0;
  const move = (event: Event) => {
    isFollowing.value = false;
    byHand.value = Number((event.currentTarget as HTMLInputElement).value);
  };
  return (
    <div class="layer-bar">
      <label for="layer">{say.layer}</label>
      <input id="layer" type="range" min={0} max={count.value - 1} step={1} value={layer.value} onInput={move} />
      <output for="layer">{say.layerOf(layer.value + 1, count.value, facts ? placeOf(facts) : "")}</output>
      <button
        type="button"
        class="small"
        aria-label={say.followAria}
        aria-pressed={isFollowing.value && canFollow}
        disabled={!canFollow}
        onClick={() => (isFollowing.value = true)}
      >
        {say.follow}
      </button>
    </div>
  );
}
