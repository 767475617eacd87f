"""Ways between passes: as low as everything stays clear, higher where something stands between, refused where nothing helps."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from config import load_cell
from config.cell import Cell
from config.machine import Solid
from planner.collide.guard import Guard
from planner.errors import ReachError
from planner.kinematics.chain import Chain
from planner.plan import Plan
from planner.post.positioning import Positioner
from planner.post.room import table_from_build
from planner.post.tape import Move, Origin, Tape

Floats = NDArray[np.float64]

FEED_MM_S = 10.0
TALL_MM = 30.0


class Bench:
    """A trunnion with a tape that stands with tool 2 at a tip of the build frame, upright."""

    def __init__(self, cell: Cell, tip: tuple[float, float, float], obstacle: Floats | None = None) -> None:
        self.cell = cell
        chain, placed = Chain.from_cell(cell), table_from_build(cell.placement.part_origin_mm, 0.0)
        plan = Plan("none", "0" * 64, "", "316L", "hybrid", 0.1, np.eye(4), np.array([[-40.0] * 3, [40.0] * 3]), ())
        self.guard = Guard(plan, cell, chain, placed)
        if obstacle is not None:
            self.guard.standing.grow(obstacle)
        self.positioner = Positioner(chain, cell, self.guard)
        self.tape = Tape(np.array([axis.home for axis in cell.axes]))
        self.positioner.retract(self.tape, Origin())
        self.to(tip)

    def to(self, tip: tuple[float, float, float], feed: float | None = None) -> NDArray[np.void]:
        """Items of the way to a tip."""
        before = self.tape.count
        target = np.zeros(5)
        target[:3] = np.array(tip) + self.cell.placement.part_origin_mm - np.array(self.cell.tools[1].tip_mm)
        self.positioner.travel(self.tape, self.cell.tools[1], target, feed, Origin(), 0)
        assert np.allclose(self.tape.joints, target)
        return self.tape.since(before)

    def heights(self, items: NDArray[np.void]) -> list[float]:
        """Of the tip over the plate at the ends of the moves."""
        return [float(z) - self.cell.placement.part_origin_mm[2] + self.cell.tools[1].tip_mm[2] for z in items["joints"][:, 2]]


@pytest.fixture(scope="module")
def trunnion() -> Cell:
    return load_cell("trunnion_tcp")


def fence(height: float) -> Floats:
    """Points of a fence along y at x = 0."""
    y, z = np.meshgrid(np.arange(-60.0, 60.1, 1.0), np.arange(0.0, height + 0.1, 1.0))
    return np.column_stack([np.zeros(y.size), y.ravel(), z.ravel()])


def test_a_way_over_nothing_is_lifted_by_the_rapid_clearance_only(trunnion: Cell) -> None:
    bench = Bench(trunnion, (-20.0, 0.0, 4.0))
    items = bench.to((20.0, 5.0, 2.0), FEED_MM_S)
    assert bench.heights(items) == pytest.approx([9.0, 7.0, 2.0])
    assert items["move"].tolist() == [Move.RAPID, Move.RAPID, Move.FEED]
    assert items["time_s"][-1] == pytest.approx(trunnion.rapid_clearance_mm / FEED_MM_S)


def test_a_way_over_a_fence_is_lifted_over_it_and_stays_clear_of_it(trunnion: Cell) -> None:
    bench = Bench(trunnion, (-20.0, 0.0, 4.0), fence(TALL_MM))
    start = bench.tape.joints
    items = bench.to((20.0, 5.0, 2.0), FEED_MM_S)
    rows = np.vstack([start, items["joints"]])
    found = bench.guard.clearance(trunnion.tools[1], rows, cuts=False, limit_mm=2.0, joined=np.arange(len(rows)) > 0)
    assert found.mm.min() > 1.0
    assert TALL_MM < max(bench.heights(items)) < 2.0 * TALL_MM
    assert (bench.positioner.low, bench.positioner.retracted) == (1, 0)


def test_where_something_stands_as_high_as_the_machine_the_way_is_refused_by_its_name(trunnion: Cell) -> None:
    assert trunnion.machine is not None
    mast = Solid(name="mast", carrier="base", shape="box", at_mm=(150.0, 0.0, 0.0), size_mm=(10.0, 900.0, 500.0))
    solids = tuple(solid for solid in trunnion.machine.solids if solid.carrier == "spindle")
    machine = trunnion.machine.model_copy(update={"solids": (*solids, mast), "ignore": ()})
    bench = Bench(trunnion.model_copy(update={"machine": machine}), (-20.0, 0.0, 4.0))
    with pytest.raises(ReachError, match=r"even fully retracted .* meets mast by .* of the part"):
        bench.to((290.0, 0.0, 4.0))


def test_a_cell_without_bodies_is_positioned_fully_retracted(trunnion: Cell) -> None:
    bench = Bench(trunnion.model_copy(update={"machine": None}), (-20.0, 0.0, 4.0))
    items = bench.to((20.0, 5.0, 2.0), FEED_MM_S)
    assert items["joints"][:2, 2].tolist() == [trunnion.axis("Z").max] * 2


def test_waiting_is_done_a_rapid_clearance_above_the_metal(trunnion: Cell) -> None:
    bench = Bench(trunnion, (-20.0, 0.0, 4.0))
    before = bench.tape.count
    bench.positioner.stand_clear(bench.tape, trunnion.tools[1], Origin())
    assert bench.heights(bench.tape.since(before)) == pytest.approx([9.0])
