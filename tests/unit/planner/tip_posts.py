"""Programs in workpiece coordinates for the tests of five-axis controls: small Plans posted, changed and read back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from config.cell import Cell, load_cell
from planner.errors import PostError
from planner.kinematics.chain import Chain
from planner.nurbs.curve import Curve
from planner.plan import Operation, Pass, Plan, Process
from planner.post.header import About
from planner.post.reread import RereadReport
from planner.post.room import table_from_build
from planner.post.sequence import Sequencer
from planner.post.tcp import read_back, write_tcp
from planner.program import Program
from tests.unit.planner.hand_plan import FEED_MM_S, GAS, LASER_W, POWDER, UP, hybrid_plan, link, plan_of


@dataclass(frozen=True)
class Posted:
    """A program, and what it was made from."""

    program: Program
    posted: Mapping[int, Operation]
    cell: Cell
    chain: Chain

    def read(self) -> RereadReport:
        return read_back(self.program, self.posted, self.cell, self.chain)

    def with_line(self, find: Callable[[str], bool], change: Callable[[str], str], skip: int = 0) -> Posted:
        """The program with one line changed: the first, or a later one, that is found."""
        lines = list(self.program.lines)
        at = [i for i, line in enumerate(lines) if find(line)][skip]
        changed = change(lines[at])
        assert changed != lines[at]
        lines[at] = changed
        return replace(self, program=replace(self.program, lines=tuple(lines)))

    def is_noticed(self) -> bool:
        """Whether reading back fails, says what is wrong, or finds the tool outside the tolerances."""
        try:
            report = self.read()
        except PostError:
            return True
        return (
            bool(report.faults)
            or report.max_tip_mm > self.cell.chord_tolerance_mm
            or report.max_axis_deg > self.cell.axis_tolerance_deg
        )


def sequenced(plan: Plan, cell: Cell) -> Sequencer:
    """A Plan on its tape with the part turned on the table, so that no frame is another by accident."""
    placement = cell.placement.model_copy(update={"rotation_deg": 30.0})
    chain = Chain.from_cell(cell, placement)
    sequencer = Sequencer(plan, cell, chain, table_from_build(placement.part_origin_mm, placement.rotation_deg), 5.0)
    sequencer.run()
    return sequencer


def written(sequencer: Sequencer, dialect: str) -> Posted:
    """The program of a tape."""
    plan, cell = sequencer.plan, sequencer.cell
    placement = cell.placement.model_copy(update={"rotation_deg": 30.0})
    made = write_tcp(dialect, sequencer, placement, About(plan, "ab" * 32, cell, placement, dialect, cell.tools))
    work_offset = np.array([placement.work_offset.get(letter, 0.0) for letter in cell.letters])
    program = Program(
        plan.part_name, cell.name, dialect, "ab" * 32, "0" * 64, cell.sha256, 0.1, "hybrid", "316L", made.lines, made.table, made.schedule,
        made.layer_starts, cell.letters, sequencer.placed, np.eye(4), work_offset, sequencer.state.gate, (1, 2), made.duration_s,
    )  # fmt: skip
    return Posted(program, sequencer.posted, cell, sequencer.chain)


def posted(plan: Plan, dialect: str, cell: Cell) -> Posted:
    """A Plan posted."""
    return written(sequenced(plan, cell), dialect)


@cache
def _hybrid_tape(cell: str) -> Sequencer:
    return sequenced(hybrid_plan(), with_nurbs(load_cell(cell)))


def with_nurbs(cell: Cell) -> Cell:
    """The cell with a control that takes NURBS under the five-axis transformation."""
    return cell.model_copy(update={"cnc": cell.cnc.model_copy(update={"takes_nurbs": True})})


@cache
def hybrid(dialect: str, cell: str = "trunnion_tcp") -> Posted:
    """The hand-made hybrid Plan: contours, ways and a milled cone with a turning axis."""
    return written(_hybrid_tape(cell), dialect)


def mill_pass(tip: Curve, axis: Curve | None) -> Plan:
    """A Plan of one milled pass, come to from above."""
    start, end = tip.evaluate(list(tip.domain))
    first, last = (UP, UP) if axis is None else (row / np.linalg.norm(row) for row in axis.evaluate(list(axis.domain)))
    rows = np.array([[0.0, 5.0, 0.0, 0.0, 0.0], [0.4 * tip.length, 9.0, 0.0, 0.0, 0.0]])
    passes = (
        link(start + 8.0 * first, start, axis=first),
        Pass(tip, UP if axis is None else axis, rows),
        link(end, end + 8.0 * last, axis=last),
    )
    return plan_of([Operation(Process.MILL_SIDE, 0, passes, cutter_diameter_mm=8.0, spindle_rpm=3580.0)])


def bead_pass(tip: Curve) -> Plan:
    """A Plan of one deposited pass, the laser on in its middle third."""
    start, end = tip.evaluate(list(tip.domain))
    third = tip.length / 3.0
    rows = [
        [0.0, FEED_MM_S, 0.0, POWDER, GAS],
        [third, FEED_MM_S, LASER_W, POWDER, GAS],
        [2.0 * third, 8.0, 0.0, POWDER, GAS],
    ]
    passes = (link(start + 6.0 * UP, start), Pass(tip, UP, np.array(rows)), link(end, end + 6.0 * UP))
    return plan_of([Operation(Process.DEPOSIT_CONTOUR, 0, passes, bead_width_mm=2.0)])


def quarter_circle(radius: float) -> Curve:
    """An exact arc in the plane z = 5: a rational curve of degree 2. Source: Piegl & Tiller, example 7.1."""
    points = np.array([[radius, 0.0, 5.0], [radius, radius, 5.0], [0.0, radius, 5.0]])
    return Curve(2, np.array([0.0, 0, 0, 1, 1, 1]), points, np.array([1.0, np.sqrt(0.5), 1.0]))


def assert_is_the_plan(dialect: str, cell: str) -> None:
    """The hand-made job, written for a cell and read back: no faults, tip and axis within the cell's tolerances."""
    made = hybrid(dialect, cell)
    report = made.read()
    assert not report.faults
    assert report.max_tip_mm <= made.cell.chord_tolerance_mm and report.max_axis_deg <= made.cell.axis_tolerance_deg


def assert_noticed(name: str, changed: Posted) -> None:
    if not changed.is_noticed():
        pytest.fail(f"nobody noticed {name}")
