"""Leaning the tool out of the way: a smooth change of axis along the passes of an operation, as a shortest path over leans in the cone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.cell import Tool
from planner.collide.guard import Guard
from planner.kinematics.chain import TOOL_AXIS, Floats
from planner.kinematics.inverse import linear_joints, rotary_angles
from planner.kinematics.limits import excess
from planner.kinematics.shortest import Lattice, shortest_way
from planner.post.leaned import Stations, lean_rate_deg_mm, leaned_curve
from planner.post.linearise import LinearOperation
from planner.post.pass_curve import PassCurve
from planner.post.poses import PoseSolver

Bools = NDArray[np.bool_]

_PITCH_MM = 1.0
_RATE_DEG_MM = 4.0
"""Greatest change of lean along a pass; a bead of 2.5 mm width then turns its head by at most 10 deg over its own width."""
_LINK_RATE_DEG_MM = 15.0
_RINGS, _SPOKES = 6, 12  # of candidate leans in the cone
_BESIDE_MM = 6.0  # along the passes: how much farther than the change of lean needs leans are looked at
_LEAN_S = 0.02  # cost of leaning by the whole cone at a station, squared
_CHANGE_S = 0.002  # cost of a degree's change of lean, squared
_NEAR_S = 0.05  # cost of a clearance of 0, falling to none where there is enough
_ENOUGH_MM = 1.0
_ENDS_S = 1.0  # of leaning where the operation begins or ends: it should go on from where others leave off
_POLE_DEG = 2.0  # off the pole: nearer, the spin joint would hurry
_POLE_S = 0.05
_RATE_SLACK = 1.6  # of a spline over stations against the rate between them, corners of the planned axis included


@dataclass(frozen=True)
class Bounds:
    """What leaning may do.

    cone_deg : off the planned axis   up : (3,) float, direction of the layer, table frame   limit_deg : off that, or what was planned
    margin_mm : clearance that is kept
    """

    cone_deg: float
    up: Floats
    limit_deg: float
    margin_mm: float


@dataclass(frozen=True)
class _Grid:
    """Stations of all passes in a row: their passes, places and planned axes."""

    stations: tuple[Stations, ...]
    pass_: NDArray[np.int64]
    arc_mm: Floats
    axes: Floats
    tips: Floats
    active: Bools


def leaned_clear(
    curves: Sequence[PassCurve], moves: LinearOperation, blocked: Bools, solver: PoseSolver, guard: Guard, tool: Tool, bounds: Bounds
) -> list[PassCurve] | None:
    """The passes with axes that lean out of the way where rows of the moves are blocked (n,), and come back beside; None if no way leads through.

    The change of lean is bounded along every pass, links included, and zero where two passes meet; what is not beside a blocked
    row stays as planned. The result is to be checked again: splines lie between the candidates that were looked at.
    """
    grid = _grid(curves, moves, blocked, bounds.cone_deg)
    leans = _leans(bounds.cone_deg)
    lattice, axes = _lattice(curves, grid, leans, moves, solver, guard, tool, bounds)
    if lattice is None:
        return None
    columns = list(solver.pair.columns)
    joints = moves.poses.joints[:, columns]
    low = np.maximum(np.array([solver.cell.axes[k].min for k in columns]), joints.min(axis=0) - 360.0)
    high = np.minimum(np.array([solver.cell.axes[k].max for k in columns]), joints.max(axis=0) + 360.0)
    speed = np.array([solver.cell.axes[k].max_velocity for k in columns])
    way = shortest_way(lattice, joints[0], low, high, speed)
    if not np.isfinite(way.cost) or way.cost >= 1e6:
        return None
    chosen = axes[np.arange(len(way.chosen)), way.chosen]
    leaning = way.chosen // 2 > 0
    return [_replaced(curves[k], k, grid, chosen, leaning, guard.placed, tool) for k in range(len(curves))]


def is_smooth(before: Sequence[PassCurve], after: Sequence[PassCurve]) -> bool:
    """Whether no pass that was leaned turns its axis faster along its way than leaning may, beyond what was planned."""
    for old, new in zip(before, after, strict=True):
        bound = _LINK_RATE_DEG_MM if new.source.is_link else _RATE_DEG_MM
        if new is not old and lean_rate_deg_mm(new) > _RATE_SLACK * bound + lean_rate_deg_mm(old):
            return False
    return True


def _grid(curves: Sequence[PassCurve], moves: LinearOperation, blocked: Bools, cone_deg: float) -> _Grid:
    stations = tuple(Stations.along(curve, _PITCH_MM) for curve in curves)
    pass_ = np.repeat(np.arange(len(curves)), [len(item.arc_mm) for item in stations])
    arcs = np.concatenate([item.arc_mm for item in stations])
    axes = np.vstack([curve.axes(item.parameter) for curve, item in zip(curves, stations, strict=True)])
    tips = np.vstack([curve.tips(item.parameter) for curve, item in zip(curves, stations, strict=True)])
    before = np.concatenate([[0.0], np.cumsum([curve.length_mm for curve in curves])])
    along = before[pass_] + arcs
    rows = moves.rows
    at = before[rows.pass_] + rows.arc_mm
    hit = np.flatnonzero(blocked)
    since = np.where(hit > 0, at[np.maximum(hit - 1, 0)], at[hit])  # the way to a blocked row is blocked too
    beside = _BESIDE_MM + cone_deg / _RATE_DEG_MM
    active = np.zeros(len(along), dtype=np.bool_)
    for low, high in zip(since - beside, at[hit] + beside, strict=True):
        active |= (along >= low) & (along <= high)
    return _Grid(stations, pass_, arcs, axes, tips, active)


def _leans(cone_deg: float) -> Floats:
    """(m, 2) float, deg: candidate leans; the first is none."""
    rings = cone_deg * np.arange(1, _RINGS + 1) / _RINGS
    turn = 2.0 * np.pi * np.arange(_SPOKES) / _SPOKES
    around = np.column_stack([np.cos(turn), np.sin(turn)])
    return np.vstack([np.zeros(2), (rings[:, None, None] * around).reshape(-1, 2)])


def _leaned_axes(axes: Floats, leans: Floats) -> Floats:
    """(n, m, 3): axes (n, 3) leaned by (m, 2) deg in the frame that the shortest turn from the machine's z to the axis carries along."""
    across = np.cross(np.broadcast_to(TOOL_AXIS, axes.shape), axes)
    cosine = axes[:, 2]
    factor = 1.0 / np.maximum(1.0 + cosine, 1e-6)
    first = np.column_stack([np.ones(len(axes)), np.zeros(len(axes)), np.zeros(len(axes))])
    second = np.column_stack([np.zeros(len(axes)), np.ones(len(axes)), np.zeros(len(axes))])
    frame = [
        vector * cosine[:, None]
        + np.cross(across, vector)
        + across * ((across * vector).sum(axis=1) * factor)[:, None]
        for vector in (first, second)
    ]
    size = np.deg2rad(np.linalg.norm(leans, axis=1))
    way = leans / np.maximum(np.linalg.norm(leans, axis=1, keepdims=True), 1e-12)
    aside = way[None, :, 0, None] * frame[0][:, None, :] + way[None, :, 1, None] * frame[1][:, None, :]
    leaned = np.cos(size)[None, :, None] * axes[:, None, :] + np.sin(size)[None, :, None] * aside
    return np.asarray(leaned / np.linalg.norm(leaned, axis=2, keepdims=True))


def _lattice(
    curves: Sequence[PassCurve], grid: _Grid, leans: Floats, moves: LinearOperation, solver: PoseSolver, guard: Guard, tool: Tool,
    bounds: Bounds,
) -> tuple[Lattice | None, Floats]:  # fmt: skip
    """Candidates, two branches of each lean, with what they cost; and their axes (n, 2 m, 3). None where a station has none."""
    n, m = len(grid.arc_mm), len(leans)
    axes = _leaned_axes(grid.axes, leans)
    angles = np.zeros((n, m, 2, 2))
    cost = np.full((n, m, 2), np.inf)
    cost[:, 0] = 0.0
    cost[grid.active] = 0.0
    flat = axes.reshape(-1, 3)
    found = rotary_angles(solver.pair, flat, solver.cone_rad)
    angles[:] = found.angles.reshape(n, m, 2, 2)
    stands = _standing(grid, moves, solver)
    free = found.is_free.reshape(n, m)
    angles[..., solver.pair.spin] = np.where(free[:, :, None], stands[:, None, None], angles[..., solver.pair.spin])
    cost[~found.is_reachable.reshape(n, m)] = np.inf
    up = np.clip(axes @ bounds.up, -1.0, 1.0)
    planned = np.rad2deg(np.arccos(np.clip(grid.axes @ bounds.up, -1.0, 1.0)))
    cost[np.rad2deg(np.arccos(up)) > np.maximum(bounds.limit_deg, planned)[:, None] + 1e-6] = np.inf
    share = np.linalg.norm(leans, axis=1) / max(bounds.cone_deg, 1e-9)
    off = np.rad2deg(np.arcsin(np.clip(np.linalg.norm(np.cross(axes, _spin(solver)), axis=2), 0.0, 1.0)))
    cost += (_LEAN_S * share**2 + _POLE_S * np.where(free, 0.0, np.maximum(1.0 - off / _POLE_DEG, 0.0) ** 2))[:, :, None]
    cost[[0, -1], 1:] += _ENDS_S
    _add_clearance(angles, cost, axes, grid, solver, guard, tool, bounds)
    if not np.isfinite(cost).any(axis=(1, 2)).all():
        return None, axes
    first = np.append(True, np.diff(grid.pass_) != 0)
    is_link = np.array([curve.source.is_link for curve in curves])[grid.pass_]
    gap = np.append(0.0, np.linalg.norm(np.diff(grid.tips, axis=0), axis=1))
    apart = first & (gap > 1e-3)
    step = np.where(is_link, _LINK_RATE_DEG_MM, _RATE_DEG_MM) * np.append(0.0, np.diff(grid.arc_mm))
    step = np.where(first, np.where(apart, 1e3, 1e-6), step)
    rapid = np.array([curve.source.rapid for curve in curves])[grid.pass_]
    may_unwind = first & (rapid | np.append(True, rapid[:-1]) | apart)
    lean = np.broadcast_to(np.repeat(leans, 2, axis=0), (n, 2 * m, 2))
    return (
        Lattice(angles.reshape(n, 2 * m, 2), cost.reshape(n, 2 * m), may_unwind, lean, step, _CHANGE_S),
        np.repeat(axes, 2, axis=1),
    )


def _spin(solver: PoseSolver) -> Floats:
    return (solver.pair.first, solver.pair.second)[solver.pair.spin].direction


def _standing(grid: _Grid, moves: LinearOperation, solver: PoseSolver) -> Floats:
    """(n,) deg: the spin joint as it is without leaning, at each station, in (-180, 180]."""
    rows = moves.rows
    key, at = rows.pass_ * 1e7 + rows.arc_mm, grid.pass_ * 1e7 + grid.arc_mm
    stands = np.interp(at, key, moves.poses.joints[:, solver.pair.columns[solver.pair.spin]])
    return np.asarray(stands - 360.0 * np.ceil((stands - 180.0) / 360.0))


def _add_clearance(
    angles: Floats, cost: Floats, axes: Floats, grid: _Grid, solver: PoseSolver, guard: Guard, tool: Tool, bounds: Bounds
) -> None:
    """Add to the cost (n, m, 2) of candidates beside what is blocked what they come too near to; infinite where they leave the travel."""
    stations, lean, branch = np.nonzero(np.isfinite(cost) & grid.active[:, None, None])
    joints = np.zeros((len(stations), 5))
    columns = list(solver.pair.columns)
    joints[:, columns] = angles[stations, lean, branch]
    tips = grid.tips[stations]
    if tool.kind == "ball_mill":
        tips = tips + 0.5 * tool.diameter_mm * (grid.axes[stations] - axes[stations, lean])
    joints = linear_joints(solver.chain, joints, tips, solver.tool_tip_mm)
    over = excess(solver.cell.axes, joints)
    over[:, columns] = 0.0
    fits = np.isfinite(joints).all(axis=1) & ~over.any(axis=1)
    enough = bounds.margin_mm + _ENOUGH_MM
    gap = np.full(len(joints), -np.inf)
    cuts = tool.kind != "deposition"
    seen = guard.clearance(tool, joints[fits], cuts=cuts, limit_mm=enough, passes=grid.pass_[stations[fits]])
    gap[fits] = seen.mm
    extra = _NEAR_S * np.clip((enough - gap) / _ENOUGH_MM, 0.0, 1.0)
    cost[stations, lean, branch] += np.where(gap < bounds.margin_mm, np.inf, extra)


def _replaced(
    curve: PassCurve, index: int, grid: _Grid, chosen: Floats, leaning: Bools, placed: Floats, tool: Tool
) -> PassCurve:
    """The pass with the axes chosen at its stations; itself where none leans."""
    own = grid.pass_ == index
    if not leaning[own].any():
        return curve
    return leaned_curve(curve, grid.stations[index], chosen[own], placed, tool)
