"""How deep a cutter on its passes comes into what must stand: least signed distance of the swept cutter to the target's facets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.collide.cutting_end import CuttingEnd, supports
from planner.mesh.mesh import Mesh
from planner.mesh.nearest import LEAF, FacetTree
from planner.nurbs.curve import Curve
from planner.plan import Pass

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SLACK_MM = 1e-3
"""The least distance found is at most this much above the true one, of the straight steps that stand for a pass."""
_CHORD_MM = 2e-3  # between a pass and the straight steps that stand for it
_FINE_MM = 0.05  # depth from which gouges are looked for: where only deeper ones matter, slack and chord are as much coarser
_TURN_RAD = np.radians(1.0)  # of the axis within a step: what it is off from straight turning is 1e-3 mm at 25 mm from the tip
_MOST_CELLS = 20000  # looked at for one facet in one step
_STACK = 256


@dataclass(frozen=True, eq=False)
class Target:
    """What must stand: facets in a tree.  spare_mm : (m,) float   how deep the cutter may come into each facet of `tree.order`."""

    tree: FacetTree
    spare_mm: Floats

    @classmethod
    def of(cls, mesh: Mesh, spare_mm: Floats | None = None) -> Target:
        """A mesh, mm, build frame.  spare_mm : (m,) float, for each of its facets; none: 0"""
        tree = FacetTree(mesh)
        spare = np.zeros(len(mesh.facets)) if spare_mm is None else np.asarray(spare_mm, dtype=np.float64)
        return cls(tree, np.ascontiguousarray(spare[tree.order]))


@dataclass(frozen=True, eq=False)
class Gouges:
    """Of each pass, in order.

    least_mm : (n,) float   least signed distance of the swept cutter to the target, less than 0: how deep it comes into it;
        never more than the distance looked to   floor_mm : (n,) float   a bound that it is surely not below
    place : (n, 3) float, mm   where on the target; NaN where nothing is nearer than looked for
    """

    least_mm: Floats
    floor_mm: Floats
    place: Floats


def gouge(passes: Sequence[Pass], cutter: CuttingEnd, target: Target | Mesh, *, look_mm: float = 0.05) -> Gouges:
    """Least signed distance of a swept cutter to a target, pass by pass.

    look_mm : distances above this are given as this; a negative one asks for deeper gouges only, and is fast
    Each pass is taken as straight steps within 2e-3 mm and 1 degree of it (coarser where only deep gouges are asked for). Over
    a facet and a step the distance is convex, so a tangent plane bounds it from below: facets and steps are halved until the
    bound is within `SLACK_MM` of the least found.
    """
    made = target if isinstance(target, Target) else Target.of(target)
    fine = max(1.0, -look_mm / _FINE_MM)
    steps = [steps_of(one, fine * _CHORD_MM) for one in passes]
    first = np.concatenate([[0], np.cumsum([len(rows) for rows in steps])]).astype(np.int64)
    rows = np.vstack(steps) if steps else np.empty((0, 12))
    found = _least(rows, first, cutter.figures, made.tree.corners, made.tree.boxes, made.spare_mm, look_mm, fine * SLACK_MM)
    floor = np.minimum(found[:, 4], found[:, 0]) - fine * (SLACK_MM + _CHORD_MM)
    return Gouges(found[:, 0].copy(), floor, np.where(found[:, :1] < look_mm, found[:, 1:4], np.nan))


def steps_of(one: Pass, chord_mm: float) -> Floats:
    """(k, 12) float: straight steps within a chord of a pass: tip at start and end, mm, unit axis at start and end."""
    u = one.tip.breaks if one.tip.degree == 1 and one.tip.weights is None else one.tip.sample(chord_mm)
    if not isinstance(one.axis, Curve):
        tips = one.tip.evaluate(u)
        axes = np.broadcast_to(one.axis / np.linalg.norm(one.axis), tips.shape)
    else:
        u = np.unique(np.concatenate([u, one.axis.breaks]))
        axes = _unit(one.axis.evaluate(u))
        turn = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(np.diff(axes, axis=0), axis=1), 1.0))
        parts = np.maximum(np.ceil(turn / _TURN_RAD), 1.0).astype(np.int64)
        if (parts > 1).any():
            own = np.repeat(np.arange(len(parts)), parts)
            share = (np.arange(len(own)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[own]
            u = np.append(u[own] + share * np.diff(u)[own], u[-1])
            axes = _unit(one.axis.evaluate(u))
        tips = one.tip.evaluate(u)
    return np.ascontiguousarray(np.hstack([tips[:-1], tips[1:], axes[:-1], axes[1:]]))


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])


@njit(cache=True)
def _least(
    steps: Floats,
    first: Ints,
    cutter: tuple[float, float, float],
    corners: Floats,
    boxes: Floats,
    spare: Floats,
    look: float,
    slack: float,
) -> Floats:  # pragma: no cover
    """(passes, 5) float: least distance, its place (3), and the least bound of what was not looked at to the end."""
    found = np.empty((len(first) - 1, 5))
    best = np.empty(5)
    cells, bounds = np.empty((_STACK, 11)), np.empty(_STACK)
    nodes = np.empty(128, np.int64)
    low, high = np.empty(3), np.empty(3)
    leaves = len(boxes) // 2
    for n in range(len(first) - 1):
        best[0], best[4] = look, np.inf
        for s in range(first[n], first[n + 1]):
            step = steps[s]
            _box_of(step, cutter, low, high)
            count = 1
            nodes[0] = 1
            while count:
                count -= 1
                node = nodes[count]
                if not _overlap(boxes[node], low, high, best[0]):
                    continue
                if node < leaves:
                    nodes[count], nodes[count + 1] = 2 * node, 2 * node + 1
                    count += 2
                    continue
                for f in range((node - leaves) * LEAF, min((node - leaves + 1) * LEAF, len(corners))):
                    _look_at(corners[f], spare[f], step, cutter, slack, best, cells, bounds)
        found[n] = best
    return found


@njit(cache=True)
def _box_of(step: Floats, cutter: tuple[float, float, float], low: Floats, high: Floats) -> None:  # pragma: no cover
    """Box around a cutter on a step, mm."""
    for i in range(3):
        ends = (step[i], step[3 + i], step[i] + cutter[2] * step[6 + i], step[3 + i] + cutter[2] * step[9 + i])
        low[i], high[i] = min(ends) - cutter[0], max(ends) + cutter[0]


@njit(cache=True)
def _overlap(box: Floats, low: Floats, high: Floats, grow: float) -> bool:  # pragma: no cover
    apart = False
    for i in range(3):
        apart = apart or box[0, i] > high[i] + grow or box[1, i] < low[i] - grow
    return not apart


@njit(cache=True)
def _look_at(
    facet: Floats,
    spare: float,
    step: Floats,
    cutter: tuple[float, float, float],
    slack: float,
    best: Floats,
    cells: Floats,
    bounds: Floats,
) -> None:  # pragma: no cover
    """The least distance over one facet and one step, if it is below the best so far: that, and its place, in `best`."""
    planes = np.empty((3, 5))
    for k in range(3):
        for i in range(3):
            cells[0, 3 * k + i] = facet[k, i]
    cells[0, 9], cells[0, 10] = 0.0, 1.0
    bounds[0] = -np.inf
    count, looked = 1, 0
    while count:
        count -= 1
        cell = cells[count]
        if bounds[count] >= best[0] - slack:
            continue
        looked += 1
        if looked > _MOST_CELLS or count + 2 >= _STACK:
            best[4] = min(best[4], bounds[count])
            continue
        x = (cell[0] + cell[3] + cell[6]) / 3.0
        y = (cell[1] + cell[4] + cell[7]) / 3.0
        z = (cell[2] + cell[5] + cell[8]) / 3.0
        value = supports(x, y, z, 0.5 * (cell[9] + cell[10]), step, cutter, planes) + spare
        if value < best[0]:
            best[0], best[1], best[2], best[3] = value, x, y, z
        bound = -np.inf
        in_time = False
        for j in range(3):
            by_place = 0.0
            for k in range(3):
                way = planes[j, 1] * (cell[3 * k] - x) + planes[j, 2] * (cell[3 * k + 1] - y) + planes[j, 3] * (cell[3 * k + 2] - z)
                by_place = min(by_place, way)
            by_time = 0.5 * abs(planes[j, 4]) * (cell[10] - cell[9])
            from_plane = planes[j, 0] + spare + by_place - by_time
            bound = max(bound, from_plane)
            if j == 0:
                in_time = -by_place < by_time
        if bound >= best[0] - slack:
            continue
        _halve(cells, count, in_time, planes[0])
        bounds[count] = bounds[count + 1] = bound
        count += 2


@njit(cache=True)
def _halve(cells: Floats, at: int, in_time: bool, plane: Floats) -> None:  # pragma: no cover
    """A cell of the stack becomes two: halves of the time, or of the facet across the side along which the plane rises most."""
    cells[at + 1] = cells[at]
    if in_time:
        middle = 0.5 * (cells[at, 9] + cells[at, 10])
        cells[at, 10], cells[at + 1, 9] = middle, middle
        return
    most, a = -1.0, 0
    for k in range(3):
        b = 3 * ((k + 1) % 3)
        rise = 0.0
        for i in range(3):
            rise += plane[1 + i] * (cells[at, b + i] - cells[at, 3 * k + i])
        if abs(rise) > most:
            most, a = abs(rise), k
    b = (a + 1) % 3
    for i in range(3):
        middle = 0.5 * (cells[at, 3 * a + i] + cells[at, 3 * b + i])
        cells[at, 3 * b + i] = middle
        cells[at + 1, 3 * a + i] = middle
