"""Linearisation under hypothesis: the true tool stays within the tolerances of the pass, with hardly more moves than the fewest."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from config.cell import Cell, load_cell
from planner.kinematics.chain import Chain
from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.plan import Pass
from planner.post.arc_shape import arc_centres, arc_over_chord, arc_points
from planner.post.arcs import with_arcs
from planner.post.linearise import LinearOperation, linearise
from planner.post.pass_curve import PassCurve
from planner.post.poses import PoseSolver
from planner.post.tube import Tube, straight_moves, tube_about

Floats = NDArray[np.float64]

TIP_MM, AXIS_DEG = 0.01, 0.05
CELLS = ("trunnion_tcp", "head_head", "head_table")
UP = np.array([0.0, 0.0, 1.0])
SHARES = (0.0, 0.2, 0.4, 0.6, 0.8)
SEEDS = st.integers(0, 2**32 - 1)


@cache
def cell_of(name: str) -> Cell:
    return load_cell(name)


def random_pass(seed: int, turning: bool) -> PassCurve:
    """A smooth curve 20 to 60 mm wide in the table frame, with a set-point on the way, upright or with the axis leaning to all sides."""
    draw = np.random.default_rng(seed)
    count = int(draw.integers(5, 9))
    size = draw.uniform(20.0, 60.0)
    points = draw.uniform(-0.5, 0.5, (count, 3)) * size * [1.0, 1.0, 0.3 if turning else 0.0]
    tip = interpolate(points, closed=False)
    rows = np.array([[0.0, 10.0, 0.0, 0.0, 0.0], [draw.uniform(0.2, 0.8) * tip.length, 8.0, 0.0, 0.0, 0.0]])
    axis: Floats | Curve = UP
    if turning:
        lean = draw.uniform([0.05, -0.3], [0.65, 0.3], (len(tip.control_points), 2))
        axis = Curve(tip.degree, tip.knots, np.column_stack([lean, np.ones(len(lean))]))
    placed = np.eye(4)
    placed[:3, 3] = (5.0, -3.0, -400.0)
    return PassCurve(Pass(tip, axis, rows), placed, "a random pass")


def laid(name: str, curve: PassCurve) -> tuple[LinearOperation, Chain, Floats]:
    cell = cell_of(name)
    chain, tool = Chain.from_cell(cell), np.array(cell.tools[1].tip_mm)
    moves = linearise([curve], PoseSolver(chain, cell, tool), np.zeros(5), TIP_MM, AXIS_DEG)
    return moves, chain, tool


def off_dense(curve: PassCurve, moves: LinearOperation, chain: Chain, tool: Floats) -> tuple[float, float]:
    """Largest distance of the true tip from the pass, mm, and of the axis from the axis at the nearest place, deg, at five places of each move.

    The nearest place is searched on ever finer grids about where the move is.
    """
    low, high = curve.source.tip.domain
    bulge = np.zeros(len(moves.rows.arc_mm)) if moves.bulge is None else moves.bulge
    tip, axis = chain.forward(
        dense(moves.poses.joints, bulge, [chain.letters.index("X"), chain.letters.index("Y")]), tool
    )
    u = moves.rows.parameter
    near = np.concatenate([u[:-1] + share * np.diff(u) for share in SHARES])
    step = np.tile(np.diff(u), len(SHARES))
    for count in (301, 21, 21, 21):
        grid = np.clip(near[:, None] + step[:, None] * np.linspace(-1.0, 1.0, count), low, high)
        away = curve.tips(grid.ravel()).reshape(*grid.shape, 3) - tip[:, None]
        near = grid[np.arange(len(tip)), np.argmin(np.einsum("ijk,ijk->ij", away, away), axis=1)]
        step = step * 2.5 / count
    off = np.linalg.norm(curve.tips(near) - tip, axis=1)
    sine = np.linalg.norm(np.cross(curve.axes(near), axis), axis=1)
    return float(off.max()), float(np.rad2deg(np.arcsin(np.clip(sine, 0.0, 1.0)).max()))


def dense(joints: Floats, bulge: Floats, columns: list[int]) -> Floats:
    """Joints along all moves, at SHARES of each, arcs on their circles."""
    rows = []
    for share in SHARES:
        here = joints[:-1] + share * np.diff(joints, axis=0)
        bent = bulge[1:] != 0.0
        ends = joints[:-1][bent][:, columns], joints[1:][bent][:, columns]
        here[np.ix_(bent, columns)] = arc_points(*ends, bulge[1:][bent], np.full(int(bent.sum()), share))
        rows.append(here)
    return np.concatenate(rows)


@settings(max_examples=8, deadline=None)
@given(SEEDS, st.sampled_from(CELLS), st.booleans())
def test_the_true_tip_and_axis_stay_within_tolerance_of_a_random_pass_and_its_ends_are_exact(
    seed: int, name: str, turning: bool
) -> None:
    curve = random_pass(seed, turning)
    moves, chain, tool = laid(name, curve)
    off_tip, off_axis = off_dense(curve, moves, chain, tool)
    assert off_tip <= moves.tip_mm + 1e-4 <= TIP_MM
    assert off_axis <= moves.axis_deg + 1e-3 <= AXIS_DEG
    exact = curve.at_arc_length(np.array([0.0, curve.set_point_arcs[1], curve.length_mm]))
    for point in curve.tips(exact):
        assert np.linalg.norm(moves.rows.tip - point, axis=1).min() < 1e-9
    assert np.all(np.diff(moves.rows.arc_mm) > 0.0)


@pytest.mark.parametrize("name", CELLS)
def test_a_long_straight_way_before_a_turn_does_not_bow(name: str) -> None:
    """A move that ends a little turned bows by a quarter of that angle times its length: more than the tolerance of a fine cell."""
    tip = Curve.from_polyline(np.array([[30.0, 20.0, 1.0], [30.0, 60.0, 41.0], [30.0, 60.0, 42.0]]))
    lean = np.deg2rad(25.0)
    turning = np.array(
        [[np.sin(lean), 0.0, np.cos(lean)], [np.sin(lean), 0.0, np.cos(lean)], [0.0, np.sin(lean), np.cos(lean)]]
    )
    placed = np.eye(4)
    placed[:3, 3] = (5.0, -3.0, -400.0)
    rows = np.array([[0.0, 10.0, 0.0, 0.0, 0.0]])
    curve = PassCurve(Pass(tip, Curve(1, tip.knots, turning), rows), placed, "a way up that turns at its end")
    cell = cell_of(name)
    chain, tool = Chain.from_cell(cell), np.array(cell.tools[1].tip_mm)
    fine_mm = 0.3 * TIP_MM
    moves = linearise([curve], PoseSolver(chain, cell, tool), np.zeros(5), fine_mm, AXIS_DEG)
    off_tip, off_axis = off_dense(curve, moves, chain, tool)
    assert off_tip <= fine_mm and off_axis <= AXIS_DEG


@settings(max_examples=8, deadline=None)
@given(SEEDS, st.sampled_from(CELLS))
def test_arcs_stay_within_tolerance_of_a_random_planar_pass_with_what_the_firmware_adds(seed: int, name: str) -> None:
    curve = random_pass(seed, turning=False)
    straight, chain, tool = laid(name, curve)
    moves = with_arcs(straight, cell_of(name))
    assert len(moves.rows.arc_mm) <= len(straight.rows.arc_mm)
    bulge = np.zeros(len(moves.rows.arc_mm)) if moves.bulge is None else moves.bulge
    columns = [chain.letters.index("X"), chain.letters.index("Y")]
    off_tip, _ = off_dense(curve, moves, chain, tool)
    assert off_tip <= moves.tip_mm + 1e-4 and moves.tip_mm <= TIP_MM
    assert np.abs(bulge).max() <= 1.0
    others = np.delete(moves.poses.joints, columns, axis=1)
    bent = np.flatnonzero(bulge)
    assert np.array_equal(others[bent], others[bent - 1])


def fewest(path: Floats, tolerance: float, offsets: Floats) -> int:
    """Fewest moves by dynamic programming over all rows of a planar path and these offsets of vertices off it, ends exact."""
    n = len(path)
    tangent = np.gradient(path, axis=0)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]]) / np.linalg.norm(tangent, axis=1)[:, None]
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    least = np.full((n, len(offsets)), np.iinfo(np.int64).max // 2)
    zero = int(np.argmin(np.abs(offsets)))
    least[0, zero] = 0
    for i in range(n - 1):
        for a in np.flatnonzero(least[i] < n):
            start = path[i] + offsets[a] * normal[i]
            for j in range(i + 1, n):
                reached = False
                for b in range(len(offsets)):
                    if j == n - 1 and b != zero:
                        continue
                    end = path[j] + offsets[b] * normal[j]
                    share = ((way[i : j + 1] - way[i]) / (way[j] - way[i]))[:, None]
                    off = start + share * (end - start) - path[i : j + 1]
                    across = np.abs(np.einsum("ij,ij->i", off, normal[i : j + 1]))
                    if across[1:-1].max(initial=0.0) <= tolerance:
                        reached = True
                        least[j, b] = min(least[j, b], least[i, a] + 1)
                if not reached and j > i + 1:
                    break
    return int(least[n - 1, zero])


@settings(max_examples=4, deadline=None)
@given(SEEDS)
def test_straight_moves_are_hardly_more_than_the_fewest_of_a_dynamic_programme(seed: int) -> None:
    draw = np.random.default_rng(seed)
    tolerance = 0.01
    turn = np.cumsum(np.convolve(draw.normal(0.0, 0.045, 150), np.ones(12) / 4.0, mode="same"))
    path = np.concatenate([[[0.0, 0.0]], np.cumsum(0.1 * np.column_stack([np.cos(turn), np.sin(turn)]), axis=0)])
    best = fewest(path, tolerance, np.linspace(-tolerance, tolerance, 5))
    tube, pinned = free_tube(np.column_stack([path, np.zeros(len(path))]), tolerance)
    count = len(straight_moves(tube, pinned)[0]) - 1
    assert count <= 1.05 * best + 1


def free_tube(path: Floats, tolerance_mm: float) -> tuple[Tube, NDArray[np.bool_]]:
    """The tube about a path of the linear joints (n, 3), and its pinned ends."""
    joints = np.column_stack([path, np.zeros((len(path), 2))])
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    pinned = np.zeros(len(path), dtype=np.bool_)
    pinned[[0, -1]] = True
    per_joint = np.zeros((len(path), 6, 5))
    per_joint[:, [0, 1, 2], [0, 1, 2]] = 1.0
    rotary = np.array([False, False, False, True, True])
    budget = np.tile([tolerance_mm, 1.0], (len(path), 1))
    return tube_about(joints, way, pinned, per_joint, rotary, budget), pinned


@pytest.mark.parametrize("seed", (7, 28, 70, 82, 91, 92, 95, 139, 146, 184))
def test_moves_never_go_back_along_a_rough_path(seed: int) -> None:
    draw = np.random.default_rng(seed)
    rows = int(draw.integers(12, 60))
    across = 0.02 * draw.standard_normal(rows).cumsum() * draw.uniform(0.1, 1.0)
    above = 0.02 * draw.standard_normal(rows).cumsum() * draw.uniform(0.0, 1.0)
    tube, pinned = free_tube(np.column_stack([np.linspace(0.0, 10.0, rows), across, above]), 0.03)
    place, joints = straight_moves(tube, pinned)
    assert np.all(np.diff(place) > 0.0) and place[-1] == rows - 1
    assert np.array_equal(joints[-1], tube.joints[-1])


def test_a_circle_takes_half_the_moves_squared_of_one_with_its_vertices_on_it() -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 2000)
    ring = 20.0 * np.column_stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))])
    tip = interpolate(ring[:-1:20], closed=True)
    rows = np.array([[0.0, 10.0, 0.0, 0.0, 0.0]])
    placed = np.eye(4)
    placed[:3, 3] = (0.0, 0.0, -400.0)
    moves, _, _ = laid("trunnion_tcp", PassCurve(Pass(tip, UP, rows), placed, "a circle"))
    count = len(moves.rows.arc_mm) - 1
    one_sided = np.pi / np.arccos(1.0 - 0.82 * TIP_MM / 20.0)
    assert count == pytest.approx(one_sided / np.sqrt(2.0), rel=0.04)
    arced = with_arcs(moves, cell_of("trunnion_tcp"))
    assert arced.bulge is not None and len(arced.rows.arc_mm) - 1 <= 3
    length = float((np.linalg.norm(np.diff(arced.rows.tip, axis=0), axis=1) * arc_over_chord(arced.bulge[1:])).sum())
    assert length == pytest.approx(2.0 * np.pi * 20.0, rel=1e-4)


@given(st.floats(-1.0, 1.0), st.floats(0.0, 1.0))
def test_points_of_an_arc_lie_on_its_circle_at_their_share_of_its_length(bulge: float, share: float) -> None:
    start, end = np.array([[2.0, -1.0]]), np.array([[5.0, 3.0]])
    point = arc_points(start, end, np.array([bulge]), np.array([share]))
    if abs(bulge) < 1e-3:
        assert np.abs(point - (start + share * (end - start))).max() <= 2.6 * abs(bulge) + 1e-12
        return
    centre = complex(*arc_centres(start, end, np.array([bulge]))[0])
    begin = complex(*start[0]) - centre
    expected = centre + begin * np.exp(1j * share * 4.0 * np.arctan(bulge))
    assert abs(complex(*point[0]) - expected) < 1e-9
