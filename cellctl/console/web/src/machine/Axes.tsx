// Axes in machine and work coordinates, and homing.
import { useRef } from "preact/hooks";
import { command, isStale, pending, snapshot } from "../state/cell";
import { facts } from "../state/plan";
import { mayCommand, whyNot } from "../state/control";
import { words } from "../words";
import { fixed } from "../words/format";

const say = words.machine;

export function Axes() {
  const cnc = snapshot.value?.cnc;
  const letters = facts.value?.axes.map((axis) => axis.letter) ?? Object.keys(cnc?.machine ?? {});
  const unit = (letter: string) => (facts.value?.axes.find((axis) => axis.letter === letter)?.kind === "rotary" ? "°" : "mm");
  return (
    <section class="panel axes">
      <h2>{say.axes}</h2>
      <table>
        <thead>
          <tr>
            <th />
            <th>{say.machinePosition}</th>
            <th>{say.workPosition}</th>
            <th />
          </tr>
        </thead>
        <tbody>
          {letters.map((letter) => (
            <tr key={letter}>
              <th scope="row">{letter}</th>
              <td class="number">{fixed(cnc?.machine[letter], 3)}</td>
              <td class="number strong">{fixed(cnc?.work[letter], 3)}</td>
              <td class="unit">{unit(letter)}</td>
            </tr>
          ))}
        </tbody>
      </table>
      <Homing />
    </section>
  );
}

function Homing() {
  const state = snapshot.value?.state ?? "";
  const suspect = snapshot.value?.position ?? "";
  if (state !== "UNHOMED" && state !== "HOMING") return suspect && state === "IDLE" ? <Suspect why={suspect} /> : null;
  const off = !mayCommand.value || isStale.value || state === "HOMING";
  return (
    <div class="row">
      <button type="button" class="control" title={whyNot.value} disabled={off || pending.value.has("home")} onClick={() => void command("home", say.homeBecause)}>
        {say.home}
      </button>
      <button type="button" class="control" title={whyNot.value} disabled={off || pending.value.has("unlock")} onClick={() => void command("unlock", say.unlockBecause)}>
        {say.unlock}
      </button>
    </div>
  );
}

/** The position is not to be trusted: home, or vouch for it with a reason. */
function Suspect({ why }: { why: string }) {
  const reason = useRef<HTMLInputElement>(null);
  const off = !mayCommand.value || isStale.value;
  const confirm = (event: Event) => {
    event.preventDefault();
    void command("confirm_position", reason.current?.value.trim() ?? "");
  };
  return (
    <form class="suspect" onSubmit={confirm}>
      <p role="alert">{say.suspect(why)}</p>
      <div class="row">
        <button type="button" class="control" title={whyNot.value} disabled={off} onClick={() => void command("home", say.homeBecause)}>
          {say.home}
        </button>
        <input ref={reason} maxLength={500} required placeholder={say.confirmReason} aria-label={say.confirmReason} />
        <button type="submit" class="control" title={whyNot.value} disabled={off}>
          {say.confirm}
        </button>
      </div>
    </form>
  );
}
