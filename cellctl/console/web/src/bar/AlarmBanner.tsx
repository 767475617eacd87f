// What is latched: cause, remedy and RESET.
import { useRef } from "preact/hooks";
import { command, isStale, pending, snapshot } from "../state/cell";
import { isLatched } from "../state/meaning";
import { isOperator } from "../state/session";
import { words } from "../words/en";
import { clock } from "../words/format";
import { Sign } from "./Signs";

const say = words.alarms;

export function AlarmBanner() {
  const now = snapshot.value;
  if (!now || (now.alarms.length === 0 && !isLatched.value)) return null;
  const [first, ...others] = now.alarms;
  return (
    <section class="alarms" role="alert" aria-label={say.region}>
      <Sign name="fault" />
      <div class="alarm-words">
        <strong>{first?.cause ?? say.stopped}</strong>
        <span>
          <b>{say.remedy}:</b> {first?.remedy ?? say.stoppedRemedy}
        </span>
        {first && (
          <small>
            {say.since(clock(first.at))} · {first.code}
            {others.length > 0 && ` · ${say.more(others.length)}: ${others.map((alarm) => alarm.cause).join("; ")}`}
          </small>
        )}
      </div>
      {isLatched.value && <Reset />}
    </section>
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
      <button type="submit" class="control reset-button" disabled={!isOperator.value || isStale.value || pending.value.has("reset")}>
        <Sign name="reset" />
        {say.reset}
      </button>
    </form>
  );
}
