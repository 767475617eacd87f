// What is latched: cause, remedy and RESET.
import { useRef } from "preact/hooks";
import { command, isStale, pending, snapshot } from "../state/cell";
import { isLatched } from "../state/meaning";
import { mayCommand, whyNot } from "../state/control";
import { alarmWords } from "../state/told";
import { words } from "../words";
import { clock } from "../words/format";
import { Sign } from "./Signs";

const say = words.alarms;

export function AlarmBanner() {
  const now = snapshot.value;
  if (!now || (now.alarms.length === 0 && !isLatched.value)) return null;
  return (
    <section class="alarm-banner" role="alert" aria-label={say.region}>
      <Sign name="fault" />
      <div class="alarm-words">
        {now.alarms.length === 0 && <Words cause={say.stopped} remedy={say.stoppedRemedy} since="" />}
        {now.alarms.map((alarm) => (
          <Words key={`${alarm.id} ${alarm.code}`} {...alarmWords(alarm)} since={`${say.since(clock(alarm.at))} · ${alarm.code}`} />
        ))}
      </div>
      {isLatched.value && <Reset />}
    </section>
  );
}

/** The first alarm is written large: it is the one that counts, the others mostly follow from it. */
function Words({ cause, remedy, since }: { cause: string; remedy: string; since: string }) {
  return (
    <div class="alarm">
      <strong>{cause}</strong>
      <span>
        <b>{say.remedy}:</b> {remedy} {since && <small>({since})</small>}
      </span>
    </div>
  );
}

function Reset() {
  const reason = useRef<HTMLInputElement>(null);
  const reset = (event: Event) => {
    event.preventDefault();
    void command("reset", reason.current?.value.trim() || say.resetBecause);
  };
  return (
    <form class="reset" onSubmit={reset}>
      <input ref={reason} maxLength={500} placeholder={words.bar.reason} aria-label={words.bar.reason} />
      <button type="submit" class="control reset-button" title={whyNot.value} disabled={!mayCommand.value || isStale.value || pending.value.has("reset")}>
        <Sign name="reset" />
        {say.reset}
      </button>
    </form>
  );
}
