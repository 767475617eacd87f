"""What programs in workpiece coordinates are made of, and their frame."""

from __future__ import annotations

from dataclasses import dataclass

from config.cell import Cell
from planner.errors import PostError
from planner.kinematics.chain import Chain
from planner.plan import Operation
from planner.post.tape import Tape
from planner.post.tcp_pass import Floats, Frame


@dataclass(frozen=True)
class Job:
    """What the blocks are made of: the tape and its operations as posted, for a cell and a placement.

    placed : (4, 4) float, table from build   frame : workpiece from build   times : (items,) float, s, predicted for each item of the tape
    dwells : item -> s
    """

    tape: Tape
    posted: dict[int, Operation]
    cell: Cell
    chain: Chain
    placed: Floats
    frame: Frame
    times: Floats
    dwells: dict[int, float]


def frame_of(placed: Floats, cell: Cell, work_offset: Floats) -> Frame:
    """Workpiece coordinates: the table frame less the work offset of the linear axes; the turn of the part is in the numbers.

    Raises PostError if the offset turns a rotary axis: the five-axis transformation of each control takes that otherwise.
    """
    shift = placed[:3, 3].copy()
    for axis, value in zip(cell.axes, work_offset.tolist(), strict=True):
        if axis.kind == "linear":
            shift["XYZ".index(axis.letter)] -= value
        elif value != 0.0:
            raise PostError(
                f"work offset of {axis.letter} is {value:g} deg: a program in workpiece coordinates needs rotary axes without offset",
                "set it to 0 and turn the part with placement.rotation_deg",
            )
    return Frame(placed[:3, :3].copy(), shift)
