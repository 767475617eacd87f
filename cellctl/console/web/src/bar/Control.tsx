// Who has control, and the button that takes it: over from another only with a reason.
import { signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { isStale } from "../state/cell";
import { askControl, control, holder, isAbsent } from "../state/control";
import { isOperator } from "../state/session";
import { words } from "../words";

const say = words.control;
const asks = signal(false);

export function Control() {
  const off = !isOperator.value || isStale.value;
  return (
    <div class={`control-bar control-${control.value}`} role="status" aria-label={say.region}>
      <span class="control-word">
        {control.value === "ours" && say.ours}
        {control.value === "free" && say.free}
        {control.value === "other" && (
          <>
            <b>{say.otherHas(holder.value)}</b>
            {isAbsent.value && <em> {say.absent}</em>} {say.watching}
          </>
        )}
      </span>
      {control.value === "ours" && (
        <button type="button" class="control" disabled={off} onClick={() => void askControl("release", say.released)}>
          {say.release}
        </button>
      )}
      {control.value === "free" && (
        <button type="button" class="control" disabled={off} onClick={() => void askControl("take", say.taken)}>
          {say.take}
        </button>
      )}
      {control.value === "other" && (
        <button type="button" class="control" disabled={off} aria-expanded={asks.value} onClick={() => (asks.value = true)}>
          {say.takeOver}
        </button>
      )}
      {asks.value && control.value === "other" && <Question />}
    </div>
  );
}

function Question() {
  const reason = useRef<HTMLInputElement>(null);
  useEffect(() => reason.current?.focus(), []);
  const close = () => (asks.value = false);
  const take = async (event: Event) => {
    event.preventDefault();
    if (await askControl("take", reason.current?.value.trim() ?? "")) close();
  };
  return (
    <form class="question" aria-label={say.ask(holder.value)} onSubmit={(event) => void take(event)} onKeyDown={(event) => event.key === "Escape" && close()}>
      <p role="alert">{say.ask(holder.value)}</p>
      <label>
        {words.bar.reason}
        <input ref={reason} maxLength={500} required />
      </label>
      <div class="row end">
        <button type="button" class="control" onClick={close}>
          {say.leave}
        </button>
        <button type="submit" class="control sure">
          {say.takeOver}
        </button>
      </div>
    </form>
  );
}
