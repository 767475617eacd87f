// What the cell tells, in the language of the page as far as it has words for it; otherwise in the cell's own.
import type { Alarm } from "../api/types";
import { words } from "../words";

/** What the cell adds to an alarm's fixed words: all behind the first colon, everything if there is none. */
function detailOf(cause: string): string {
  const at = cause.indexOf(": ");
  return at < 0 ? cause : cause.slice(at + 2);
}

/** Cause and remedy of an alarm, by its code. */
export function alarmWords({ code, cause, remedy }: Pick<Alarm, "code" | "cause" | "remedy">): { cause: string; remedy: string } {
  const known = words.cell.alarms[code];
  if (!known) return { cause, remedy };
  const detail = known[0] === "{detail}" ? cause : detailOf(cause);
  return { cause: known[0].replace("{detail}", () => detail), remedy: known[1].replace("{remedy}", () => remedy) };
}
