"""What the moves of a Program cost and keep: blocks, arcs, bytes per mm and the largest errors, per kind of operation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from planner.plan import Operation
from planner.program import LineKind, Program

LINKS = "links"


@dataclass(frozen=True)
class Built:
    """Largest distance of moves from their passes by construction, words not rounded yet: tip_mm and axis_deg."""

    tip_mm: float = 0.0
    axis_deg: float = 0.0

    def with_moves(self, tip_mm: float, axis_deg: float) -> Built:
        """The larger of these and further ones."""
        return Built(max(self.tip_mm, tip_mm), max(self.axis_deg, axis_deg))


@dataclass(frozen=True)
class Economy:
    """Lines of one kind of operation that move along passes.

    kind : the process in words, or "links"   blocks, arcs : lines   bytes : with their ends   length_mm : of the passes
    tip_mm, axis_deg : by construction, of the kind's operations
    """

    kind: str
    blocks: int
    arcs: int
    bytes: int
    length_mm: float
    tip_mm: float
    axis_deg: float

    @property
    def bytes_per_mm(self) -> float:
        """0 where nothing moves."""
        return self.bytes / self.length_mm if self.length_mm > 0.0 else 0.0

    @property
    def mm_per_block(self) -> float:
        """0 where nothing moves."""
        return self.length_mm / self.blocks if self.blocks else 0.0

    def __str__(self) -> str:
        arcs = f", {self.arcs} of them arcs" if self.arcs else ""
        return f"{self.kind}: {self.blocks} blocks{arcs}, {self.mm_per_block:.2f} mm each, {self.bytes_per_mm:.2f} bytes/mm"


def economy(program: Program, posted: Mapping[int, Operation], built: Mapping[str, Built]) -> tuple[Economy, ...]:
    """One row per kind of operation in the order of the Program, links last.

    posted : operations as posted, by number   built : errors by kind
    """
    table = program.table
    sizes = np.array([len(line) + 1 for line in program.lines], dtype=np.int64)
    length = table["arc_end_mm"] - table["arc_start_mm"]
    is_pass = (table["pass_"] >= 0) & (length > 0.0)
    rows: dict[str, list[int]] = {}
    for number, operation in posted.items():
        rows.setdefault(operation.process.value, []).append(number)
    found = [
        (kind, is_pass & (table["kind"] == LineKind.PROCESS) & np.isin(table["operation"], numbers))
        for kind, numbers in rows.items()
    ]
    found.append((LINKS, is_pass & (table["kind"] == LineKind.LINK)))
    return tuple(
        Economy(
            kind, int(here.sum()), int(np.count_nonzero(table["bulge"][here])), int(sizes[here].sum()), float(length[here].sum()),
            built.get(kind, Built()).tip_mm, built.get(kind, Built()).axis_deg,
        )
        for kind, here in found
        if here.any()
    )  # fmt: skip


def all_passes(rows: tuple[Economy, ...]) -> Economy:
    """The sum over all kinds but links."""
    own = [row for row in rows if row.kind != LINKS]
    tip, axis = max((row.tip_mm for row in own), default=0.0), max((row.axis_deg for row in own), default=0.0)
    blocks, arcs, size = sum(row.blocks for row in own), sum(row.arcs for row in own), sum(row.bytes for row in own)
    return Economy("passes", blocks, arcs, size, sum(row.length_mm for row in own), tip, axis)
