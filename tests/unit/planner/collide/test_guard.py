"""What the guard of a post says against geometry that is known: clamps, a wall that grows and is cut, the parked head; and against the twin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from config import load_cell
from config.cell import Cell
from planner.collide.guard import PART_MM, Guard
from planner.errors import PostError
from planner.kinematics.chain import Chain
from planner.nurbs.curve import Curve
from planner.plan import Layer, Operation, Pass, Plan, Process
from planner.post.room import table_from_build
from sim.machine.against_solids import pair_distance
from sim.machine.links import multiply, place
from sim.machine.machine import Machine

Floats = NDArray[np.float64]

CELLS = ("trunnion_tcp", "trunnion_rtu", "head_head", "head_table")
UP = np.array([0.0, 0.0, 1.0])
HEIGHT_MM, WIDTH_MM, LAYERS = 0.8, 2.0, 20
TOP_MM = HEIGHT_MM * LAYERS


def layer(index: int, *operations: Operation) -> Layer:
    bottom = np.array([0.0, 0.0, HEIGHT_MM * index, *UP])
    top = np.array([0.0, 0.0, HEIGHT_MM * (index + 1), *UP])
    return Layer(index, bottom, top, (), (), 0.0, 0.0, operations)


def wall(index: int) -> Operation:
    """One bead along y through the origin."""
    z = HEIGHT_MM * index
    tip = Curve.from_polyline(np.array([[0.0, -20.0, z], [0.0, 20.0, z]]))
    bead = Pass(tip, UP, np.array([[0.0, 10.0, 1000.0, 10.0, 10.0]]))
    return Operation(Process.DEPOSIT_CONTOUR, index, (bead,), bead_width_mm=WIDTH_MM, bead_height_mm=HEIGHT_MM)


def cut(x: float, z: float) -> Operation:
    """A side cut along y with an 8 mm cutter."""
    tip = Curve.from_polyline(np.array([[x, -30.0, z], [x, 30.0, z]]))
    passes = (Pass(tip, UP, np.array([[0.0, 10.0, 0.0, 0.0, 0.0]])),)
    return Operation(Process.MILL_SIDE, LAYERS - 1, passes, cutter_diameter_mm=8.0, spindle_rpm=3000.0)


def guard_of(cell: Cell) -> Guard:
    bounds = np.array([[-1.0, -20.0, 0.0], [1.0, 20.0, TOP_MM]])
    layers = tuple(layer(k, wall(k)) for k in range(LAYERS))
    plan = Plan("wall", "0" * 64, "", "316L", "hybrid", 0.1, np.eye(4), bounds, layers)
    return Guard(plan, cell, Chain.from_cell(cell), table_from_build(cell.placement.part_origin_mm, 0.0))


@pytest.fixture(scope="module")
def trunnion() -> Cell:
    return load_cell("trunnion_tcp")


@pytest.fixture
def walled(trunnion: Cell) -> Guard:
    guard = guard_of(trunnion)
    for k in range(LAYERS):
        guard.advance(wall(k))
    return guard


def upright(cell: Cell, tool: int, *tips: tuple[float, float, float]) -> Floats:
    """Joints of the trunnion's cell with the tool upright, its tip there in the build frame."""
    joints = np.zeros((len(tips), 5))
    joints[:, :3] = np.array(tips) + cell.placement.part_origin_mm - np.array(cell.tools[tool].tip_mm)
    return joints


def test_a_holder_over_a_clamp_is_as_far_from_it_as_the_heights_say(trunnion: Cell) -> None:
    guard, cutter = guard_of(trunnion), trunnion.tools[1]
    assert trunnion.machine is not None
    clamps = trunnion.machine.clamps
    inside = 60.0 - clamps.overlap_mm - 0.5 * cutter.holder_diameter_mm
    for x, z, expected in ((60.0, -30.0, 2.0), (60.0, -35.0, -3.0), (inside - 1.5, -35.0, 1.5), (inside + 0.7, -35.0, -0.7)):
        found = guard.clearance(cutter, upright(trunnion, 1, (x, 0.0, z)), cuts=True, limit_mm=5.0)
        if found.pair(0) == ("T2 holder", "clamp 1"):
            assert found.mm[0] == pytest.approx(expected, abs=0.01)
    found = guard.clearance(cutter, upright(trunnion, 1, (inside + 0.7, 30.0, 0.0)), cuts=True, limit_mm=5.0)
    assert found.pair(0)[1] != "clamp 1" and found.mm[0] > -0.1


def test_a_nozzle_beside_a_clamp_is_as_far_from_it_as_its_cone(trunnion: Cell) -> None:
    guard, head = guard_of(trunnion), trunnion.tools[0]
    assert trunnion.machine is not None
    clamps, nozzle = trunnion.machine.clamps, head.nozzle
    wide = 0.5 * (head.holder_diameter_mm - nozzle.end_diameter_mm) / nozzle.cone_length_mm
    lower, lean = 4.0, np.arctan(wide)  # the nozzle's end is so far below the clamp's top
    at_top = 0.5 * nozzle.end_diameter_mm + lower * wide
    for side in (1.5, -1.0):
        x = 60.0 - clamps.overlap_mm - at_top - side / np.cos(lean)
        joints = upright(trunnion, 0, (x, 0.0, clamps.above_mm - nozzle.standoff_mm - lower))
        found = guard.clearance(head, joints, cuts=False, limit_mm=3.0)
        assert found.pair(0) == ("nozzle", "clamp 1") and found.mm[0] == pytest.approx(side, abs=0.01)
        assert found.place(0)[2] == pytest.approx(clamps.above_mm, abs=0.6)


def test_the_parked_head_is_higher_by_its_way_than_the_one_that_is_out(trunnion: Cell) -> None:
    guard = guard_of(trunnion)
    low = upright(trunnion, 1, (0.0, 0.0, 8.0))  # the head's focus is 60 mm beside the cutter and 20 mm below its tip
    found = guard.clearance(trunnion.tools[1], low, cuts=True, limit_mm=5.0)
    assert "nozzle" not in found.pair(0) and found.mm[0] > -0.1
    deployed = guard.clearance(trunnion.tools[0], low, cuts=False, limit_mm=5.0)
    assert deployed.pair(0) == ("nozzle", "clamp 1") and deployed.mm[0] < -6.0


def test_a_wall_stands_from_when_it_was_laid(trunnion: Cell) -> None:
    guard, head = guard_of(trunnion), trunnion.tools[0]
    end = 0.5 * head.nozzle.end_diameter_mm
    beside = upright(trunnion, 0, (end - 2.0, 0.0, 0.0))  # the nozzle's end is over the wall, 13 mm over the plate
    assert guard.clearance(head, beside, cuts=False, limit_mm=5.0).mm[0] == 5.0
    for k in range(LAYERS):
        guard.advance(wall(k))
    found = guard.clearance(head, beside, cuts=False, limit_mm=5.0)
    assert found.pair(0) == ("nozzle", "part") and guard.hits(found)[0]
    assert found.mm[0] == pytest.approx(head.nozzle.standoff_mm - TOP_MM, abs=PART_MM)
    assert abs(found.place(0)[0]) <= 0.5 * WIDTH_MM + 0.01 and found.place(0)[2] == pytest.approx(TOP_MM, abs=PART_MM)
    assert "nozzle meets part by" in found.why(0)


def test_flutes_may_be_in_the_wall_where_they_cut_and_the_holder_never(walled: Guard, trunnion: Cell) -> None:
    cutter = trunnion.tools[1]
    in_wall = upright(trunnion, 1, (3.0, 0.0, 2.0))
    assert walled.clearance(cutter, in_wall, cuts=True, limit_mm=1.0).mm[0] == 1.0
    moved = walled.clearance(cutter, in_wall, cuts=False, limit_mm=1.0)
    assert moved.pair(0) == ("T2 flutes", "part") and moved.mm[0] == pytest.approx(-2.0, abs=PART_MM)
    deep = upright(trunnion, 1, (6.0, 0.0, TOP_MM - cutter.stickout - 1.5))
    found = walled.clearance(cutter, deep, cuts=True, limit_mm=1.0)
    assert found.mm[0] <= -1.5 and found.pair(0)[0].startswith("T2")


def test_what_a_pass_cuts_is_gone_from_that_pass_on_and_what_is_left_stays(walled: Guard, trunnion: Cell) -> None:
    cutter, low = trunnion.tools[1], upright(trunnion, 1, (3.5, 0.0, 8.0))
    first, second = cut(4.5, 8.0).passes[0], cut(4.0, 8.0).passes[0]
    both = replace(cut(4.0, 8.0), passes=(first, second))
    before = len(walled.standing)
    walled.begin(both)
    depths = [walled.clearance(cutter, low, cuts=False, limit_mm=1.0, passes=[k]).mm[0] for k in (-1, 0, 1)]
    assert depths == pytest.approx([-1.5, -1.0, -0.5], abs=PART_MM)
    assert depths[0] < depths[1] <= depths[2]
    walled.begin(cut(30.0, 8.0))
    assert len(walled.standing) == before  # nothing is cut before it is run
    walled.advance(both)
    assert len(walled.standing) < before
    assert np.all(walled.standing.points[walled.standing.points[:, 2] > 8.1, 0] <= 0.01)


def test_a_thin_wall_between_two_poses_is_met_on_the_way(walled: Guard, trunnion: Cell) -> None:
    cutter = trunnion.tools[1]
    across = upright(trunnion, 1, (-40.0, 0.0, 4.0), (40.0, 0.0, 4.0))
    apart = walled.clearance(cutter, across, cuts=False, limit_mm=1.0)
    joined = walled.clearance(cutter, across, cuts=False, limit_mm=1.0, joined=[False, True])
    assert not walled.hits(apart).any()
    assert walled.hits(joined).tolist() == [False, True] and joined.pair(1) == ("T2 flutes", "part")


def test_the_least_that_was_noted_is_kept_for_each_pair_but_for_flutes_that_touch_the_part(walled: Guard, trunnion: Cell) -> None:
    head = trunnion.tools[0]
    end = 0.5 * head.nozzle.end_diameter_mm  # 13 mm over the plate; its cone is wider where the wall ends, 3 mm higher
    for beside in (4.0, 2.0, 3.0):
        joints = upright(trunnion, 0, (0.5 * WIDTH_MM + end + beside, 0.0, 0.0))
        walled.note(walled.clearance(head, joints, cuts=False, limit_mm=5.0))
    walled.note(walled.clearance(trunnion.tools[1], upright(trunnion, 1, (5.0, 0.0, 3.0)), cuts=False, limit_mm=5.0))
    (nearest,) = walled.least
    assert nearest.pair == ("nozzle", "part") and nearest.mm == pytest.approx(2.0 - 0.8, abs=PART_MM)


@pytest.mark.parametrize("name", CELLS)
def test_the_twin_measures_the_same_in_random_poses_of_every_cell(name: str) -> None:
    cell = load_cell(name)
    guard = guard_of(cell)
    placed = table_from_build(cell.placement.part_origin_mm, 0.0)
    twin = Machine(cell, None, np.linalg.inv(placed))  # type: ignore[arg-type]  # its chain is for traces only
    low, high = np.array([[axis.min, axis.max] for axis in cell.axes]).T
    middle, reach = np.clip(np.array([0.0, 0.0, -250.0, 0.0, 0.0]), low, high), np.array([40.0, 40.0, 40.0, 60.0, 180.0])
    poses = np.clip(middle + reach * np.random.default_rng(2).uniform(-1.0, 1.0, (5, 5)), low, high)
    for tool in cell.tools:
        found = guard.clearance(tool, poses, cuts=False)
        for row, joints in enumerate(poses):
            theirs = by_twin(twin, joints, tool.number, tool.kind == "deposition")
            assert found.mm[row] == pytest.approx(theirs, abs=0.02 if theirs > 0.0 else 0.05)


def by_twin(twin: Machine, joints: Floats, tool: int, is_out: bool) -> float:
    """Least distance of all pairs that the twin watches, mm."""
    world = np.zeros((len(twin.links.column), 3, 4))
    place(twin.links, joints, 1.0 if is_out else 0.0, world, np.zeros_like(world))
    poses = np.zeros((len(twin.solids), 3, 4))
    for k, body in enumerate(twin.solids):
        multiply(world[body.carrier], body.pose, poses[k])
    there = [body.tool in (0, tool) for body in twin.solids]
    pairs = [(a, b) for a, b in twin._rules.pair.tolist() if there[a] and there[b]]
    return min(pair_distance(twin.bodies, a, b, poses[a], poses[b], 0.0, np.empty(3)) for a, b in pairs)


def test_a_cell_without_bodies_watches_nothing_and_a_name_that_is_none_is_refused(trunnion: Cell) -> None:
    assert trunnion.machine is not None
    bare = guard_of(trunnion.model_copy(update={"machine": None}))
    assert not bare.is_watching and bare.clearance(trunnion.tools[1], np.zeros((2, 5)), cuts=True, limit_mm=9.0).mm.tolist() == [9.0, 9.0]
    wrong = trunnion.machine.model_copy(update={"ignore": (("ram", "mast"),)})
    with pytest.raises(PostError, match="no body mast"):
        guard_of(trunnion.model_copy(update={"machine": wrong}))
