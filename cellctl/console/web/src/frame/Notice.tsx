// What could not be done.
import { dismiss, notice } from "../state/notices";
import { words } from "../words";

export function NoticeBox() {
  const now = notice.value;
  if (!now) return null;
  return (
    <div class="notice" role="alert">
      <div>
        <b>{now.title}</b>
        {now.detail && <p>{now.detail}</p>}
        {now.hint && <p class="muted">{now.hint}</p>}
      </div>
      <button type="button" class="small" onClick={dismiss}>
        {words.frame.dismiss}
      </button>
    </div>
  );
}
