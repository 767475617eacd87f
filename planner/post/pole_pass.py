"""Passes that go too near the pole for the rotary joints to follow at their feed: led round it, within the cone that the process allows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from config.cell import Tool
from planner.kinematics.chain import Floats
from planner.kinematics.inverse import rotary_angles
from planner.kinematics.pole import round_the_pole
from planner.post.leaned import Stations, leaned_curve
from planner.post.linearise import LinearOperation
from planner.post.pass_curve import PassCurve
from planner.post.poses import PoseSolver

SHARE = 0.8
"""Of a joint's greatest speed: what the way past the pole is planned with; acceleration takes the rest."""
_TOO_FAST = 1.02  # of a joint's greatest speed, from which on a pass is led round
_PITCH_MM = 0.5
_WINDOW_DEG = 30.0  # off the pole: farther away the axis stays as planned
_SAME_ARC_MM = 1e-6


def rotary_load(curves: Sequence[PassCurve], moves: LinearOperation, solver: PoseSolver) -> Floats:
    """(passes,) float: greatest speed of a rotary joint, of what it has, in each pass at its feed; 0 for links."""
    load = np.zeros(len(curves))
    columns = list(solver.pair.columns)
    fastest = np.array([solver.cell.axes[column].max_velocity for column in columns])
    rows = moves.rows
    first = np.flatnonzero(rows.is_first)
    for begin, end in zip(first, np.append(first[1:], len(rows.arc_mm)), strict=True):
        index = int(rows.pass_[begin])
        curve = curves[index]
        if curve.source.is_link or end - begin < 2:
            continue
        arcs = rows.arc_mm[begin:end]
        at = np.searchsorted(curve.set_point_arcs, arcs[:-1] + _SAME_ARC_MM, side="right") - 1
        turn = np.abs(np.diff(moves.poses.joints[begin:end, columns], axis=0))
        way = np.maximum(np.diff(arcs), _SAME_ARC_MM)
        speed = turn / way[:, None] * curve.source.setpoints[at, 1, None]
        load[index] = float((speed / fastest).max())
    return load


def is_too_fast(load: Floats) -> bool:
    """Whether a pass asks more of a rotary joint than it has."""
    return bool((load > _TOO_FAST).any())


def led_round(
    curves: Sequence[PassCurve], load: Floats, solver: PoseSolver, placed: Floats, tool: Tool, cone_deg: float
) -> list[PassCurve]:
    """The same passes, those too fast led round the pole where they come near it; begin and end of each keep their axes.

    load : (passes,) float, of `rotary_load`   cone_deg : greatest lean off the planned axis
    """
    return [
        _led(curve, solver, placed, tool, cone_deg) if load[index] > _TOO_FAST else curve for index, curve in enumerate(curves)
    ]


def _led(curve: PassCurve, solver: PoseSolver, placed: Floats, tool: Tool, cone_deg: float) -> PassCurve:
    stations = Stations.along(curve, _PITCH_MM)
    axes = np.array(curve.axes(stations.parameter))
    pair = solver.pair
    near = rotary_angles(pair, axes, float(np.deg2rad(_WINDOW_DEG))).is_free
    if not near.any():
        return curve
    at = np.searchsorted(curve.set_point_arcs, stations.arc_mm[:-1] + _SAME_ARC_MM, side="right") - 1
    seconds = np.diff(stations.arc_mm) / curve.source.setpoints[at.clip(0), 1]
    fastest = np.array([solver.cell.axes[column].max_velocity for column in pair.columns])
    steps = SHARE * np.maximum(seconds, 1e-6)[:, None] * fastest
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(np.int64)))
    for begin, end in edges.reshape(-1, 2):
        low, high = max(int(begin) - 1, 0), min(int(end) + 1, len(axes))
        if high - low > 2:
            axes[low:high] = round_the_pole(pair, axes[low:high], steps[low : high - 1], cone_deg)
    return leaned_curve(curve, stations, axes, placed, tool)
