"""What was measured at the machine, over the cell file: placement and tools. One document per version, whole."""

from __future__ import annotations

import math

import msgspec

from config.base import ConfigError
from config.cell import Cell, Placement, Tool

Three = tuple[float, float, float]


class ToolMeasured(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """length_mm : from the gauge point to the tip along the tool axis; wear is taken off both. diameter_mm : of a cutter, or the spot"""

    length_mm: float
    diameter_mm: float
    length_wear_mm: float = 0.0
    diameter_wear_mm: float = 0.0


class Measured(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """None, or a letter or number that is missing: as the cell file has it."""

    part_origin_mm: Three | None = None
    pivots_mm: dict[str, Three] = {}
    tools: dict[int, ToolMeasured] = {}


class MeasuredError(Exception):
    """A measurement out of its bounds. `message` is one line, `hint` says what to do."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.message, self.hint = message, hint


def applied(cell: Cell, measured: Measured) -> Cell:
    """The cell as it stands: the file's facts with what was measured in their place."""
    placement = Placement.model_validate(
        {
            **cell.placement.model_dump(),
            "pivots_mm": {**cell.placement.pivots_mm, **measured.pivots_mm},
            **({"part_origin_mm": measured.part_origin_mm} if measured.part_origin_mm is not None else {}),
        }
    )
    tools = tuple(_tool(tool, measured.tools.get(tool.number)) for tool in cell.tools)
    return cell.model_copy(update={"placement": placement, "tools": tools})


def _tool(tool: Tool, measured: ToolMeasured | None) -> Tool:
    if measured is None:
        return tool
    x, y, _ = tool.tip_mm
    diameter = measured.diameter_mm - measured.diameter_wear_mm
    radius = 0.5 * diameter if tool.kind == "ball_mill" else min(tool.corner_radius_mm, 0.5 * diameter)
    tip = (x, y, -(measured.length_mm - measured.length_wear_mm))
    return tool.model_copy(update={"tip_mm": tip, "diameter_mm": diameter, "corner_radius_mm": radius})


def standing_of(cell: Cell, measured: Measured) -> Cell:
    """The cell file's cell with an earlier measurement. Raises ConfigError where the file was changed so that it no longer fits."""
    try:
        check(cell, measured)
    except MeasuredError as error:
        line = f"{cell.name}: what was measured earlier does not fit the cell file any more: {error.message}"
        raise ConfigError(line, "put the cell file back, or give the changed cell a name of its own and measure it") from None
    return applied(cell, measured)


def check(cell: Cell, measured: Measured) -> None:
    """Raises MeasuredError for what cannot be: no such axis or tool, or farther from the cell file than its by_hand bounds. cell : the file's"""
    most = cell.by_hand.measured_max_mm
    joints = (*cell.kinematics.table, *cell.kinematics.head)
    nominal: dict[str, Three] = {str(joint.axis): cell.placement.pivots_mm.get(joint.axis, joint.point_mm) for joint in joints}
    for letter, pivot in measured.pivots_mm.items():
        if letter not in cell.letters or cell.axis(letter).kind != "rotary":
            raise MeasuredError(f"pivot of {letter}: no rotary axis of this machine", "name one that turns")
        _near(f"pivot of {letter}", math.dist(pivot, nominal[letter]), most)
    if measured.part_origin_mm is not None:
        low, high = cell.build_volume.min_mm, cell.build_volume.max_mm
        for k, (value, least, greatest) in enumerate(zip(measured.part_origin_mm, low, high, strict=True)):
            if not least <= value <= greatest:
                line = f"part origin {'xyz'[k]} {value:.3f} mm: outside {least:g} to {greatest:g} mm"
                raise MeasuredError(line, "it has to lie in the build volume")
    known = {tool.number: tool for tool in cell.tools}
    for number, one in measured.tools.items():
        if number not in known:
            raise MeasuredError(f"T{number}: no such tool", f"tools: {', '.join(f'T{other}' for other in known)}")
        _check_tool(known[number], one, most)


def _check_tool(tool: Tool, one: ToolMeasured, most: float) -> None:
    name = f"T{tool.number}"
    if not all(math.isfinite(value) for value in msgspec.structs.astuple(one)):
        raise MeasuredError(f"{name}: a value is no finite number", "give numbers in mm")
    _near(f"{name} length", abs(one.length_mm + tool.tip_mm[2]), most)
    for what, wear in (("length_wear_mm", one.length_wear_mm), ("diameter_wear_mm", one.diameter_wear_mm)):
        if not 0.0 <= wear <= 1.0:
            raise MeasuredError(f"{name} {what} {wear:g} mm: outside 0 to 1 mm", "measure it, or put a new tool in")
    bound = max(0.1 * tool.diameter_mm, 0.2)
    if abs(one.diameter_mm - one.diameter_wear_mm - tool.diameter_mm) > bound:
        is_now = one.diameter_mm - one.diameter_wear_mm
        line = f"{name} diameter {is_now:g} mm: farther than {bound:g} mm from {tool.diameter_mm:g} mm of the cell file"
        raise MeasuredError(line, "measure again, or correct the cell file")


def _near(what: str, off_mm: float, most: float) -> None:
    if not off_mm <= most:
        raise MeasuredError(f"{what}: {off_mm:.3f} mm from the cell file's, at most {most:g} mm", "measure again, or correct the cell file")
