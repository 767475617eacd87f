// The name of the cell that this page is for, and the way to the others; where there is one cell, neither is needed.
import { hereCell, isShared } from "../state/fleet";
import { open } from "../state/pages";
import { base } from "../api/base";
import { words } from "../words";

const say = words.cells;

export function CellName() {
  if (!isShared.value && !base) return null;
  return (
    <button type="button" class="cell-here" aria-label={say.change(hereCell.value)} onClick={() => open("cells")}>
      <span>{hereCell.value}</span>
    </button>
  );
}
