// HOLD, RESUME, ABORT. STOP is not here: it stands in index.html with a script of its own.
import { signal, type ReadonlySignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { command, isStale, pending, snapshot } from "../state/cell";
import { mayCommand, whyNot } from "../state/control";
import { words } from "../words";
import { Sign } from "./Signs";

const say = words.bar;
const asksAbort = signal(false);

const CAN: Record<string, readonly string[]> = {
  hold: ["PREPARING", "RUNNING", "RESUMING", "JOGGING"],
  resume: ["HELD"],
  abort: ["PREPARING", "RUNNING", "HOLDING", "HELD", "RESUMING"],
};

function can(verb: string): boolean {
  const state = snapshot.value?.state ?? "";
  return mayCommand.value && !isStale.value && !pending.value.has(verb) && (CAN[verb]?.includes(state) ?? false);
}

export function Controls() {
  return (
    <div class="controls" role="group" aria-label={say.controls}>
      <button type="button" class="control hold" title={whyNot.value} disabled={!can("hold")} onClick={() => void command("hold", say.held)}>
        <Sign name="hold" />
        {say.hold}
      </button>
      <button type="button" class="control resume" title={whyNot.value} disabled={!can("resume")} onClick={() => void command("resume", say.resumed)}>
        <Sign name="run" />
        {say.resume}
      </button>
      <button type="button" class="control abort" title={whyNot.value} disabled={!can("abort")} aria-expanded={asksAbort.value} onClick={() => (asksAbort.value = true)}>
        <Sign name="abort" />
        {say.abort}
      </button>
      {asksAbort.value && <AbortQuestion open={asksAbort} />}
    </div>
  );
}

function AbortQuestion({ open }: { open: ReadonlySignal<boolean> & { value: boolean } }) {
  const reason = useRef<HTMLInputElement>(null);
  const first = useRef<HTMLButtonElement>(null);
  useEffect(() => first.current?.focus(), []);
  const close = () => (open.value = false);
  const abort = (event: Event) => {
    event.preventDefault();
    void command("abort", reason.current?.value.trim() || say.aborted);
    close();
  };
  return (
    <form class="question" aria-label={say.abortAsk} onSubmit={abort} onKeyDown={(event) => event.key === "Escape" && close()}>
      <p role="alert">{say.abortAsk}</p>
      <label>
        {say.reason}
        <input ref={reason} maxLength={500} placeholder={say.aborted} />
      </label>
      <div class="row end">
        <button type="button" class="control" ref={first} onClick={close}>
          {say.abortNo}
        </button>
        <button type="submit" class="control abort sure" disabled={!can("abort")}>
          {say.abortYes}
        </button>
      </div>
    </form>
  );
}
