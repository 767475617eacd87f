// Who has control, and the button that takes it: over from another only with a reason.
import { useRef } from "preact/hooks";
import { isStale } from "../state/cell";
import { askControl, control, holder, isAbsent } from "../state/control";
import { closeDialog, openDialog } from "../state/dialog";
import { isOperator } from "../state/session";
import { words } from "../words";

const say = words.control;

const BUTTONS = {
  ours: { text: say.release, press: () => void askControl("release", say.released) },
  free: { text: say.take, press: () => void askControl("take", say.taken) },
  other: { text: say.takeOver, press: () => openDialog(say.ask(holder.value), Question) },
};

export function Control() {
  const button = BUTTONS[control.value];
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
      <button type="button" class="control" disabled={!isOperator.value || isStale.value} onClick={button.press}>
        {button.text}
      </button>
    </div>
  );
}

function Question() {
  const reason = useRef<HTMLInputElement>(null);
  const take = async (event: Event) => {
    event.preventDefault();
    if (await askControl("take", reason.current?.value.trim() ?? "")) closeDialog();
  };
  return (
    <form class="question" onSubmit={(event) => void take(event)}>
      <p>{say.ask(holder.value)}</p>
      <label>
        {words.bar.reason}
        <input ref={reason} maxLength={500} required />
      </label>
      <div class="row end">
        <button type="button" class="control" onClick={closeDialog}>
          {say.leave}
        </button>
        <button type="submit" class="control sure" disabled={control.value !== "other"}>
          {say.takeOver}
        </button>
      </div>
    </form>
  );
}
