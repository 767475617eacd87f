"""What was measured at the machine takes effect: placement and tools over the cell file's, durable first, and never under a job."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgspec

from cellctl.cell.journal_rows import MEASURED
from cellctl.cell.refusal import Refused
from cellctl.cell.tip import TipFinder
from cellctl.domain.measured import Measured, MeasuredError, applied, check, standing_of
from cellctl.domain.messages import Command
from cellctl.domain.states import State
from config.cell import Cell

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller

AT_REST = frozenset({State.IDLE, State.UNHOMED, State.OFFLINE, State.FAULT, State.STOPPED})


def standing(cell: Cell, document: str | None) -> Cell:
    """The cell as an earlier process left it. document : newest of the store. Raises ConfigError for one that no longer fits the cell file."""
    if document is None:
        return cell
    return standing_of(cell, msgspec.json.decode(document, type=Measured))


async def adopt(c: Controller, command: Command) -> dict[str, Any]:
    """Let a whole new version stand. Raises Refused, StoreError."""
    if c.run is not None or c.state not in AT_REST:
        raise Refused(f"measured: not while the cell is {c.state.value}", "wait until the cell is IDLE")
    if not command.because.strip():
        raise Refused("measured: a reason is needed", "say why it was measured")
    try:
        measured = msgspec.convert(command.args.get("document"), Measured, strict=False)
        check(c.filed, measured)
        cell = applied(c.filed, measured)
    except (msgspec.ValidationError, ValueError) as error:
        raise Refused(f"measured: {str(error).splitlines()[0]}", "give part_origin_mm, pivots_mm and tools in mm") from None
    except MeasuredError as error:
        raise Refused(f"measured: {error.message}", error.hint) from None
    what, text = str(command.args.get("what", "")), msgspec.json.encode(measured).decode()
    points = msgspec.json.encode(command.args.get("points") or {}).decode()
    c.journal.write(MEASURED, (c.filed.name, c.times.unix(), command.who, command.because, what, text, points))
    await c.journal.durable()
    c.cell, c.tips = cell, TipFinder(cell)
    said = f"{what or 'placement and tools'}: adopted by {command.who}, because {command.because}"
    c.event("measured", said, {"cell_sha256": cell.sha256, "who": command.who})
    return {"state": c.state.value, "cell_sha256": cell.sha256}
