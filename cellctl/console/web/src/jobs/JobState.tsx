// A job's state as a word with a sign and a tone.
import { words } from "../words";

const TONES: Record<string, string> = {
  waiting_for_approval: "hold",
  queued: "wait",
  running: "run",
  held: "hold",
  completed: "run",
  failed: "fault",
  aborted: "fault",
  interrupted: "fault",
  cancelled: "off",
};
const SIGNS: Record<string, string> = { run: "●", hold: "❚❚", wait: "◷", fault: "▲", off: "✕" };

/** isPast: a state that the job was in, not the one that it is in. */
export function JobState({ state, isPast = false }: { state: string; isPast?: boolean }) {
  const tone = TONES[state] ?? "wait";
  const sign = state === "completed" ? "✓" : SIGNS[tone];
  return (
    <span class={`job-state tone-${tone}`} data-state={isPast ? undefined : state}>
      <i aria-hidden="true">{sign}</i> {words.jobs.states[state] ?? state}
    </span>
  );
}
