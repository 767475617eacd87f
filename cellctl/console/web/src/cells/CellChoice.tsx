// Which cell a job is for: this page's, another by name, or any that fits. Not asked where there is one.
import { fleet, hereCell, isShared } from "../state/fleet";
import { words } from "../words";

const say = words.cells;
export const ANY = "any";

/** In a form: a select named `cell`. */
export function CellChoice() {
  if (!isShared.value) return null;
  return (
    <label>
      {say.jobFor}
      <select name="cell">
        <option value={hereCell.value}>{say.thisCell(hereCell.value)}</option>
        <option value={ANY}>{say.any}</option>
        {(fleet.value?.cells ?? [])
          .filter(({ cell }) => cell !== hereCell.value)
          .map(({ cell }) => (
            <option key={cell} value={cell}>
              {cell}
            </option>
          ))}
      </select>
    </label>
  );
}

/** What a form says of the cell, for the request. */
export function cellOf(form: FormData): { cell?: string } {
  const cell = String(form.get("cell") ?? "");
  return cell ? { cell } : {};
}
