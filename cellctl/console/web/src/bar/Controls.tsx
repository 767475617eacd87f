// HOLD, RESUME, ABORT. STOP is not here: it stands in index.html with a script of its own.
import { useRef } from "preact/hooks";
import { command, isStale, pending, snapshot } from "../state/cell";
import { mayCommand, whyNot } from "../state/control";
import { closeDialog, openDialog } from "../state/dialog";
import { words } from "../words";
import { Sign } from "./Signs";

const say = words.bar;

const CAN: Record<string, readonly string[]> = {
  hold: ["PREPARING", "RUNNING", "RESUMING", "JOGGING", "PURGING"],
  resume: ["HELD"],
  abort: ["PREPARING", "RUNNING", "HOLDING", "HELD", "RESUMING"],
};

function can(verb: string): boolean {
  const state = snapshot.value?.state ?? "";
  return mayCommand.value && !isStale.value && !pending.value.has(verb) && (CAN[verb]?.includes(state) ?? false);
}

/** Hold if there is anything to be held. */
export function hold(): void {
  if (can("hold")) void command("hold", say.held);
}

export function Controls() {
  return (
    <div class="controls" role="group" aria-label={say.controls}>
      <button type="button" class="control hold" title={whyNot.value} aria-keyshortcuts="F8" disabled={!can("hold")} onClick={hold}>
        <Sign name="hold" />
        {say.hold}
      </button>
      <button type="button" class="control resume" title={whyNot.value} disabled={!can("resume")} onClick={() => void command("resume", say.resumed)}>
        <Sign name="run" />
        {say.resume}
      </button>
      <button type="button" class="control abort" title={whyNot.value} disabled={!can("abort")} aria-haspopup="dialog" onClick={() => openDialog(say.abortAsk, AbortQuestion)}>
        <Sign name="abort" />
        {say.abort}
      </button>
    </div>
  );
}

function AbortQuestion() {
  const reason = useRef<HTMLInputElement>(null);
  const abort = (event: Event) => {
    event.preventDefault();
    void command("abort", reason.current?.value.trim() || say.aborted);
    closeDialog();
  };
  return (
    <form class="question" onSubmit={abort}>
      <p>{say.abortAsk}</p>
      <label>
        {say.reason}
        <input ref={reason} maxLength={500} placeholder={say.aborted} />
      </label>
      <div class="row end">
        <button type="button" class="control" autofocus onClick={closeDialog}>
          {say.abortNo}
        </button>
        <button type="submit" class="control abort sure" disabled={!can("abort")}>
          {say.abortYes}
        </button>
      </div>
    </form>
  );
}
