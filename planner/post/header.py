"""What a program says about itself: the comment lines at its head and before each operation."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from config.cell import Cell, Placement, Tool
from planner.kinematics.chain import Floats
from planner.plan import Operation, Plan

_UNFIT = re.compile(r"[^ -~]|[()\[\]{};%!?~]")
"""What ends a comment somewhere, or what a firmware takes out of the line as a command of its own (! ? ~ at grbl)."""
_LONGEST = 72
_HASH_DIGITS = 12


@dataclass(frozen=True)
class About:
    """What the header tells.

    plan_sha256 : of the plan file's content   tools : those that are used   remarks : lines of the dialect
    """

    plan: Plan
    plan_sha256: str
    cell: Cell
    placement: Placement
    dialect: str
    tools: Sequence[Tool]
    remarks: Sequence[str] = ()


def remark(text: str) -> str:
    """One comment as RS274/NGC takes it: ( … ), plain characters, at most 72."""
    return f"({_UNFIT.sub('_', text)[: _LONGEST - 2].rstrip()})"


def header_texts(about: About, low: Floats, high: Floats, duration_s: float) -> list[str]:
    """What stands at the head, one text per line, plain.

    low, high : (5,) float, machine coordinates that the program uses   duration_s : predicted
    """
    plan, cell, placed = about.plan, about.cell, about.placement
    x, y, z = placed.part_origin_mm
    offset = " ".join(f"{letter}{placed.work_offset.get(letter, 0.0):g}" for letter in cell.letters)
    lines = [
        f"part {plan.part_name}, plan {about.plan_sha256[:_HASH_DIGITS]}, {plan.material} {plan.process}",
        f"cell {cell.name}, {about.dialect}, within {cell.chord_tolerance_mm:g} mm {cell.axis_tolerance_deg:g} deg",
        f"part at X{x:g} Y{y:g} Z{z:g} turned {placed.rotation_deg:g}, G54 {offset}",
    ]
    lines += [f"T{tool.number} {tool.name}" for tool in about.tools]
    lines += [
        f"{axis.letter} {least:.1f} to {most:.1f} of {axis.min:g} to {axis.max:g}"
        for axis, least, most in zip(cell.axes, low, high, strict=True)
    ]
    lines += about.remarks
    operations = sum(bool(operation.passes) for operation in plan.operations)
    lines.append(f"{len(plan.layers)} layers, {operations} operations, about {_time(duration_s)}")
    return lines


def operation_text(number: int, operation: Operation, tool: int) -> str:
    """The line before an operation, plain."""
    return f"layer {operation.layer} op {number} {operation.process.value} T{tool}"


def _time(seconds: float) -> str:
    minutes = round(seconds / 60.0)
    return (
        f"{minutes // 60} h {minutes % 60} min"
        if minutes >= 60
        else f"{minutes} min"
        if minutes
        else f"{seconds:.0f} s"
    )
