// What the part would take with the recipe as it stands; what moved since the last choice is said.
import { words } from "../words";
import { decimal, fixed, whole } from "../words/format";
import type { Estimate } from "./documents";
import type { Estimating } from "./estimating";
import { Problem } from "./Problem";
import { grams, spanText } from "./sizes";

const say = words.parts.estimate;
const PARTS = ["deposit", "mill", "changes", "interpass", "waits"];
const SAME = 0.005; // relative: less is not worth a word

function moved(now: number, before: number | undefined): string {
  if (before === undefined || before === 0 || Math.abs(now / before - 1) < SAME) return "";
  const share = 100 * (now / before - 1);
  return `${share > 0 ? "▲ +" : "▼ −"}${decimal(Math.abs(share), Math.abs(share) < 10 ? 1 : 0)} %`;
}

export function EstimateBox({ state }: { state: Estimating }) {
  const { estimate, before, problem, isBusy } = state;
  return (
    <>
      <section class={`panel estimate ${isBusy ? "is-asked" : ""}`} aria-label={say.title} aria-busy={isBusy}>
        <div class="panel-head">
          <h2>{say.title}</h2>
          <span class="muted" role="status">
            {isBusy ? say.busy : estimate ? say.range(decimal(100 * estimate.uncertainty, 0)) : ""}
          </span>
        </div>
        <Problem of={problem} />
        {estimate && !problem && <Figures of={estimate} before={before} />}
      </section>
      {estimate && !problem && <Behind of={estimate} />}
    </>
  );
}

function Figures({ of, before }: { of: Estimate; before: Estimate | null }) {
  const [least, most] = of.thickness_mm;
  const [low, high] = of.time_range_s;
  const thickness = most - least < 0.005 ? `${fixed(most, 2)} mm` : `${fixed(least, 2)} – ${fixed(most, 2)} mm`;
  return (
    <>
      <dl class="big-figures">
        <Figure name={say.layers} value={whole(of.layers)} note={thickness} change={moved(of.layers, before?.layers)} id="layers" />
        <Figure name={say.time} value={spanText(of.build_time_s)} note={`${spanText(low)} – ${spanText(high)}`} change={moved(of.build_time_s, before?.build_time_s)} id="time" />
        <Figure name={say.powder} value={grams(of.powder_g)} note={say.mass(grams(of.mass_g))} change={moved(of.powder_g, before?.powder_g)} id="powder" />
        <Figure
          name={say.cost}
          value={of.cost ? `${fixed(of.cost.total, 2)} ${of.cost.currency}` : words.dash}
          note={of.cost ? say.costParts(fixed(of.cost.machine, 2), fixed(of.cost.powder, 2), fixed(of.cost.gas, 2)) : say.noCost}
          change={of.cost && before?.cost ? moved(of.cost.total, before.cost.total) : ""}
          id="cost"
        />
      </dl>
      <Shares of={of} />
    </>
  );
}

/** What is missing for a cost, and how the figures were found. */
function Behind({ of }: { of: Estimate }) {
  return (
    <section class="panel behind" aria-label={say.basis}>
      {of.missing.length > 0 && (
        <p class="missing">
          {say.missing} {of.missing.map((rate) => say.rate(rate.field, rate.unit, say.files[rate.file] ?? rate.file, rate.name)).join("; ")}
        </p>
      )}
      <details class="basis">
        <summary>{say.basis}</summary>
        <ul class="texts">
          <li>{say.place(of.pieces, of.setups, of.direction.map((value) => fixed(value, 2)).join(", "))}</li>
          {of.basis.map((line) => (
            <li key={line}>{line}</li>
          ))}
        </ul>
      </details>
    </section>
  );
}

function Figure({ name, value, note, change, id }: { name: string; value: string; note: string; change: string; id: string }) {
  return (
    <div data-figure={id}>
      <dt>{name}</dt>
      <dd>
        <b>{value}</b> {change && <span class="moved">{change}</span>}
        <small class="muted">{note}</small>
      </dd>
    </div>
  );
}

/** Where the time goes, as one bar with its key. */
function Shares({ of }: { of: Estimate }) {
  const total = Math.max(of.build_time_s, 1);
  let at = 0;
  return (
    <div class="shares">
      <svg viewBox="0 0 100 4" preserveAspectRatio="none" role="img" aria-label={PARTS.map((name) => `${say.times[name]} ${spanText(of.times_s[name] ?? 0)}`).join(", ")}>
        {PARTS.map((name) => {
          const width = (100 * (of.times_s[name] ?? 0)) / total;
          const x = at;
          at += width;
          return <rect key={name} class={`share-${name}`} x={x} y={0} width={width} height={4} />;
        })}
      </svg>
      <ul aria-hidden="true">
        {PARTS.filter((name) => (of.times_s[name] ?? 0) > 0).map((name) => (
          <li key={name}>
            <i class={`swatch share-${name}`} /> {say.times[name]} {spanText(of.times_s[name] ?? 0)}
          </li>
        ))}
      </ul>
    </div>
  );
}
