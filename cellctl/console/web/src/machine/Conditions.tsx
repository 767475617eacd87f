// Conditions for the laser, interlocks, the age of every device's readings, and the safety tick.
import type { IoView, Permissive, Snapshot } from "../api/types";
import { dataAge, snapshot, STALE_S } from "../state/cell";
import { words } from "../words";
import { age } from "../words/format";

const say = words.machine;
const NEVER_S = 1e8;

export function Conditions() {
  const now = snapshot.value;
  if (!now) return null;
  return (
    <>
      <section class="panel">
        <PermissivesHead all={now.permissives} />
        <ul class="conditions">
          {now.permissives.map((one) => (
            <Condition key={one.name} ok={one.ok} label={words.permissive[one.name] ?? one.name} why={one.why} level={levelOf(one)} />
          ))}
        </ul>
      </section>
      <section class="panel">
        <h2>{say.interlocks}</h2>
        <ul class="conditions">
          {Object.entries(words.interlock).map(([name, texts]) => (
            <Interlock key={name} io={now.io} name={name as keyof IoView} texts={texts} />
          ))}
          <Head io={now.io} />
        </ul>
        <Ages now={now} />
      </section>
    </>
  );
}

function PermissivesHead({ all }: { all: Permissive[] }) {
  const missing = all.filter((one) => !one.ok).length;
  return (
    <div class="panel-head">
      <h2>{say.permissives}</h2>
      <span class="muted">{all.length > 0 && (missing === 0 ? say.allMet : say.missing(missing))}</span>
    </div>
  );
}

/** The level in words, and how old the reading behind it is; what rests on no reading has no age. */
function levelOf({ level, age_s, stale_s }: Permissive): string {
  if (stale_s <= 0) return level;
  return `${level}, ${age_s > NEVER_S ? say.never : age(age_s + dataAge.value)}`;
}

function Condition({ ok, label, why, level = "" }: { ok: boolean; label: string; why: string; level?: string }) {
  return (
    <li class={ok ? "ok" : "not-ok"} title={why}>
      <i aria-hidden="true">{ok ? "✓" : "✕"}</i>
      <span>
        {label}
        <span class="hidden-word"> {ok ? words.ok : words.notOk}</span>
        {level && <span class="level"> {level}</span>}
        {!ok && why && <small>{why}</small>}
      </span>
    </li>
  );
}

function Interlock({ io, name, texts }: { io: IoView; name: keyof IoView; texts: [string, string] }) {
  const is = Boolean(io[name]);
  return <Condition ok={is && io.connected} label={texts[is ? 0 : 1]} why="" />;
}

/** A position, neither good nor bad. */
function Head({ io }: { io: IoView }) {
  const where = io.head_deployed ? "deployed" : io.head_parked ? "parked" : "between";
  return (
    <li class="neutral">
      <i aria-hidden="true">{where === "between" ? "◌" : "●"}</i>
      <span>{words.head[where]}</span>
    </li>
  );
}

function Ages({ now }: { now: Snapshot }) {
  const devices = { laser: now.laser, feeder: now.feeder, io: now.io, cnc: now.cnc };
  const { tick } = now;
  return (
    <dl class="ages" aria-label={say.deviceAges}>
      {(Object.keys(devices) as (keyof typeof devices)[]).map((name) => {
        const { connected, age_s } = devices[name];
        const total = age_s + dataAge.value;
        const text = age_s > NEVER_S ? say.never : !connected ? say.gone : say.age(age(total));
        return (
          <div key={name} class={!connected || total > STALE_S ? "old" : ""}>
            <dt>{say.devices[name]}</dt>
            <dd>{text}</dd>
          </div>
        );
      })}
      <div>
        <dt>{say.tick}</dt>
        <dd>{say.tickText(tick.jitter_p99_ms, tick.longest_ms, tick.missed, tick.scheduler)}</dd>
      </div>
    </dl>
  );
}
