"""The machine as it really stands: what its cell file believes, with the differences that `simulation` gives it to be found by measuring."""

from __future__ import annotations

from config import Cell


def really(cell: Cell) -> Cell:
    """The cell that the simulated plant moves by. Proofs do not use it: they know what was measured, and nothing else."""
    facts = cell.simulation
    pivots = {**cell.placement.pivots_mm, **facts.real_pivots_mm}
    top = cell.plate.top_mm if facts.real_plate_top_mm is None else facts.real_plate_top_mm
    tools = tuple(tool.model_copy(update={"tip_mm": facts.real_tips_mm.get(tool.number, tool.tip_mm)}) for tool in cell.tools)
    return cell.model_copy(
        update={
            "placement": cell.placement.model_copy(update={"pivots_mm": pivots}),
            "plate": cell.plate.model_copy(update={"top_mm": top}),
            "tools": tools,
        }
    )
