"""From where a Program is resumed: a line and how much of it is done, the begin of a layer, or that of an operation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planner.errors import ResumeError
from planner.program import LineKind, Program


@dataclass(frozen=True)
class ResumePoint:
    """One of three: made by `at`, `of_layer` or `of_operation`.

    line : index of a line (N-word less 1)   fraction : of it that is done, 0 to 1   layer, operation : as in the Program's table
    """

    line: int | None = None
    fraction: float = 0.0
    layer: int | None = None
    operation: int | None = None

    @classmethod
    def at(cls, line: int, fraction: float = 0.0) -> ResumePoint:
        """Where metal ended: so much of a line (index from 0) is done."""
        return cls(line=int(line), fraction=float(fraction))

    @classmethod
    def of_layer(cls, layer: int) -> ResumePoint:
        """The begin of a layer."""
        return cls(layer=int(layer))

    @classmethod
    def of_operation(cls, operation: int) -> ResumePoint:
        """The begin of an operation, by its number over the whole Plan."""
        return cls(operation=int(operation))

    def found_in(self, program: Program) -> tuple[int, float]:
        """Index of the line and the fraction of it that is done, less than 1.

        Raises ResumeError, one line: what was asked, and what there is.
        """
        if self.layer is not None:
            return _first(program, "layer", self.layer), 0.0
        if self.operation is not None:
            return _first(program, "operation", self.operation), 0.0
        count = len(program.table)
        if self.line is None or not 0 <= self.line < count:
            raise ResumeError(
                f"line {self.line}: the program has lines 0 to {count - 1}",
                "name a line of this program, counted from 0",
            )
        if not (math.isfinite(self.fraction) and 0.0 <= self.fraction <= 1.0):
            raise ResumeError(
                f"fraction {self.fraction:g} of line {self.line}: 0 to 1 is possible",
                "say how much of the line is done",
            )
        if self.fraction < 1.0:
            return self.line, self.fraction
        if self.line + 1 == count:
            raise ResumeError(
                "the program is done: nothing is left behind its last line", "post the part again to make another one"
            )
        return self.line + 1, 0.0


def _first(program: Program, name: str, number: int) -> int:
    table = program.table
    does = (table["kind"] == LineKind.PROCESS) & (table["pass_"] >= 0)
    known = np.unique(table[name][does])
    if number not in known:
        there = f"{known[0]} to {known[-1]}" if known.size else "none"
        raise ResumeError(
            f"{name} {number}: the program has no such {name} with passes; there is {there}",
            f"choose one of these as the {name}",
        )
    return int(np.argmax(table[name] == number))
