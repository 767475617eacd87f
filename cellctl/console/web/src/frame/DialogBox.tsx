// The open dialog over the page behind it, which takes neither finger nor focus as long as it is open.
import { useEffect, useRef } from "preact/hooks";
import { closeDialog, dialog, type Dialog } from "../state/dialog";

const FIRST = "[autofocus], input, select, textarea, button";

export function DialogBox() {
  const now = dialog.value;
  return now && <Box key={now.label} now={now} />;
}

function Box({ now }: { now: Dialog }) {
  const box = useRef<HTMLDivElement>(null);
  useEffect(() => (box.current?.querySelector<HTMLElement>(FIRST) ?? box.current)?.focus(), []);
  const Body = now.body;
  return (
    <div class="veil" onClick={(event) => event.target === event.currentTarget && closeDialog()}>
      <div class="dialog" role="dialog" aria-label={now.label} ref={box} tabIndex={-1} onKeyDown={(event) => event.key === "Escape" && closeDialog()}>
        <Body />
      </div>
    </div>
  );
}
