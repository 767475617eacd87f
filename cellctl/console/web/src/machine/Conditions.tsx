// What the laser waits for, each condition once: the safety chain, the devices, and what the job does at this moment.
import type { IoView, Permissive, Snapshot } from "../api/types";
import { dataAge, snapshot } from "../state/cell";
import { words } from "../words";
import { age } from "../words/format";

const say = words.machine;
const NEVER_S = 1e8;
const SAFETY = ["estop", "door", "chiller", "gas_pressure", "fume_extraction", "fault"];
const DEVICES = ["laser", "feeder", "dead_man"];
const LEVEL_OF: Record<string, keyof IoView> = {
  estop: "estop_ok",
  door: "door_closed",
  chiller: "chiller_ok",
  gas_pressure: "gas_pressure_ok",
  fume_extraction: "fume_extraction_ok",
};

/** met; bad: a person has to do something; waits: not met, and nothing is wrong with that */
type Standing = "met" | "bad" | "waits";
const SIGNS: Record<Standing, string> = { met: "✓", bad: "✕", waits: "○" };

export function Conditions() {
  const now = snapshot.value;
  if (!now) return null;
  const of = (names: string[]) => now.permissives.filter(({ name }) => names.includes(name));
  const moment = now.permissives.filter(({ name }) => !SAFETY.includes(name) && !DEVICES.includes(name));
  return (
    <section class="panel conditions">
      <Verdict all={now.permissives} />
      <div class="groups">
        <Group title={say.groups.safety} all={of(SAFETY)} now={now} unmet={() => "bad"} />
        <Group title={say.groups.devices} all={of(DEVICES)} now={now} unmet={(one) => (isResting(one, now) ? "waits" : "bad")} />
        <Group title={say.groups.moment} all={moment} now={now} unmet={() => "waits"} />
      </div>
      <Tick now={now} />
    </section>
  );
}

function Verdict({ all }: { all: Permissive[] }) {
  const missing = all.filter((one) => !one.ok).length;
  const may = all.length > 0 && missing === 0;
  return (
    <div class="panel-head">
      <h2>{say.permissives}</h2>
      <b class={may ? "may" : "muted"}>{all.length > 0 && (may ? `✓ ${say.allMet}` : say.missing(missing))}</b>
    </div>
  );
}

/** A laser that is there, without a fault and not enabled waits for its job. */
function isResting({ name, age_s, stale_s }: Permissive, { laser }: Snapshot): boolean {
  return name === "laser" && laser.connected && age_s < stale_s && laser.faults.length === 0 && laser.interlocks.length === 0;
}

interface GroupOf {
  title: string;
  all: Permissive[];
  now: Snapshot;
  unmet: (one: Permissive) => Standing;
}

function Group({ title, all, now, unmet }: GroupOf) {
  return (
    <div>
      <h3>{title}</h3>
      <ul>
        {all.map((one) => (
          <Condition key={one.name} one={one} label={labelOf(one, now)} standing={one.ok ? "met" : unmet(one)} />
        ))}
      </ul>
    </div>
  );
}

/** What is at a switch is told as it is: door open, door closed. */
function labelOf({ name, ok }: Permissive, { io }: Snapshot): string {
  const level = LEVEL_OF[name];
  if (name === "fault") return words.faultLevel[ok ? 0 : 1];
  const texts = level && words.interlock[level];
  if (texts) return texts[io[level] ? 0 : 1];
  if (name === "head" && io.connected) return words.head[io.head_deployed ? "deployed" : io.head_parked ? "parked" : "between"];
  return words.permissive[name] ?? name;
}

function Condition({ one, label, standing }: { one: Permissive; label: string; standing: Standing }) {
  const { name, level, why, age_s, stale_s } = one;
  const seconds = age_s + dataAge.value;
  const old = stale_s > 0 ? (age_s > NEVER_S ? say.never : age(seconds)) : "";
  const isSaid = LEVEL_OF[name] || name === "head" || name === "fault"; // by its label
  const told = isSaid ? "" : words.cell.said(standing === "bad" && why ? why : level);
  return (
    <li class={`${standing} ${stale_s > 0 && seconds > stale_s ? "old" : ""}`} title={words.cell.said(why)}>
      <i aria-hidden="true">{SIGNS[standing]}</i>
      <span>
        {label}
        <span class="hidden-word"> {one.ok ? words.ok : words.notOk}</span>
        <small>{[told, old].filter(Boolean).join(" · ")}</small>
      </span>
    </li>
  );
}

function Tick({ now: { tick } }: { now: Snapshot }) {
  return (
    <p class="tick muted">
      {say.tick}: {say.tickText(tick.jitter_p99_ms, tick.longest_ms, tick.missed, tick.scheduler)}
    </p>
  );
}
