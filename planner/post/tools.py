"""Which tool of the cell does an operation."""

from __future__ import annotations

from config.cell import Cell, Tool
from planner.errors import PostError
from planner.plan import Operation, Process

_SAME_DIAMETER_MM = 0.01
_CUTTERS: dict[Process, tuple[str, ...]] = {
    Process.MILL_FACE: ("end_mill", "bull_nose"),
    Process.MILL_SIDE: ("end_mill", "bull_nose", "ball_mill"),
    Process.MILL_SCALLOP: ("ball_mill",),
}


def tool_for(operation: Operation, cell: Cell) -> Tool:
    """The cell's deposition head, or its cutter of the operation's diameter.

    Raises PostError that lists what is there.
    """
    if operation.process.is_deposit:
        heads = [tool for tool in cell.tools if tool.kind == "deposition"]
        if not heads:
            raise PostError(
                f"cell {cell.name} has no deposition head; it has {_listed(cell)}",
                "add one to [[tools]] of the cell file",
            )
        return heads[0]
    kinds = _CUTTERS[operation.process]
    wanted = operation.cutter_diameter_mm
    for kind in kinds:
        for tool in cell.tools:
            if tool.kind == kind and abs(tool.diameter_mm - wanted) <= _SAME_DIAMETER_MM:
                return _checked(tool, operation)
    raise PostError(
        f"{operation.process}, layer {operation.layer}: no {' or '.join(kinds)} of {wanted:g} mm in cell {cell.name}; it has {_listed(cell)}",
        "set cutter_diameter_mm in the recipe to one that is there, or add the tool to the cell file",
    )


def tools_for(operation: Operation, cell: Cell) -> list[Tool]:
    """What may do an operation: first `tool_for`, then others of its kind and diameter, those that stick out less first.

    Raises PostError that lists what is there.
    """
    first = tool_for(operation, cell)
    others = [
        tool
        for tool in cell.tools
        if tool.number != first.number
        and tool.kind == first.kind
        and abs(tool.diameter_mm - first.diameter_mm) <= _SAME_DIAMETER_MM
        and tool.corner_radius_mm == first.corner_radius_mm
        and (operation.process.is_deposit or operation.spindle_rpm <= tool.max_rpm)
    ]
    return [first, *sorted(others, key=lambda tool: (tool.stickout, tool.number))]


def _checked(tool: Tool, operation: Operation) -> Tool:
    if not operation.spindle_rpm > 0.0:
        raise PostError(
            f"{operation.process}, layer {operation.layer}: the spindle would stand (0 1/min asked)",
            "plan the part again",
        )
    if operation.spindle_rpm > tool.max_rpm:
        raise PostError(
            f"{operation.process}, layer {operation.layer}: {operation.spindle_rpm:g} 1/min asked, tool {tool.number} allows {tool.max_rpm:g}",
            "lower the material's cutting speed or take a larger cutter",
        )
    return tool


def _listed(cell: Cell) -> str:
    return ", ".join(f"tool {tool.number} {tool.kind} {tool.diameter_mm:g} mm" for tool in cell.tools)
