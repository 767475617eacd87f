"""What an operation does to the part as it stands: points of the beads that it lays, poses of the cutter that it cuts with."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from planner.collide.points import surface_points
from planner.mesh.load import load
from planner.nurbs.curve import Curve
from planner.plan import Layer, Operation, Pass, Plan, Process
from planner.process import block_allowance_mm
from planner.recipe import Recipe

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_PITCH_MM = 1.0  # along beads, walls and cutter's ways: a cutter of 4 mm leaves crests of 0.06 mm
_CHORD_MM = 0.05
_MOST_POINTS = 120_000  # of a block: they lie 2 mm apart in one of 100 x 100 x 100 mm
_TURN_RAD = 0.02  # of the axis between two poses of a cutter
FINISHED_MM = 0.3
"""How deep points of the part's own walls may be in the flutes: less is the rounding of curves, more is cut away on purpose."""


def bead_points(operation: Operation, up: Floats) -> Floats:
    """(n, 3) float, mm, build frame: crest of the beads of a deposition, and both sides where it is no fill between others.

    up : (3,) float, unit, in which the layer grows
    """
    crest, half = operation.bead_height_mm * up, 0.5 * operation.bead_width_mm
    found = []
    for item in operation.passes:
        if item.is_link or not (item.setpoints[:, 2] > 0.0).any():
            continue
        points, arcs = _spread(_polyline(item.tip), _PITCH_MM)
        row = np.searchsorted(item.setpoints[:, 0], arcs + 1e-6, side="right") - 1
        ahead = np.gradient(points, axis=0) if len(points) > 1 else np.zeros_like(points)
        across = np.cross(up, ahead)
        across *= half / np.maximum(np.linalg.norm(across, axis=1), 1e-9)[:, None]
        lit = item.setpoints[row, 2] > 0.0
        middle = points + 0.5 * crest
        found.append((points + crest)[lit])
        if operation.process is not Process.DEPOSIT_FILL:
            found += [(middle + across)[lit], (middle - across)[lit]]
    return np.vstack(found) if found else np.empty((0, 3))


def wall_points(layer: Layer) -> Floats:
    """(n, 3) float, mm: of the part's own surface in a layer, build frame."""
    curves: Iterable[Curve] = (
        [curve for wall in layer.walls for curve in (wall.bottom, wall.top)]
        if layer.walls
        else [contour.curve for contour in layer.contours]
    )
    found = [_spread(_polyline(curve), _PITCH_MM)[0] for curve in curves]
    return np.vstack(found) if found else np.empty((0, 3))


def stock_points(plan: Plan, recipe: Recipe) -> Floats:
    """(n, 3) float, mm, build frame: of what a part is milled from: all through a block, on the surface of a stock that is given.

    Nothing where the part is deposited.  Raises InputError if the stock cannot be read.
    """
    if plan.process != "mill":
        return np.empty((0, 3))
    if recipe.stock is not None:
        return surface_points(load(plan.stock_file or recipe.stock).transformed(plan.build_from_part), _PITCH_MM)
    allowance = block_allowance_mm(recipe) or 0.0
    low, high = np.array(plan.bounds, dtype=np.float64)
    low, high = low - [allowance, allowance, 0.0], high + allowance
    pitch = max(_PITCH_MM, float(np.prod(high - low) / _MOST_POINTS) ** (1.0 / 3.0))
    sides = [np.linspace(low[k], high[k], int(np.ceil((high[k] - low[k]) / pitch)) + 1) for k in range(3)]
    return np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)


def cutter_poses(passes: Iterable[Pass]) -> tuple[Floats, Ints]:
    """Tip (mm) and axis of a cutter along all passes that are not rapid, (n, 6) float, and which pass each is of, (n,)."""
    poses, numbers = [np.empty((0, 6))], [np.empty(0, dtype=np.int64)]
    for number, item in enumerate(passes):
        if item.rapid:
            continue
        u = np.unique(np.concatenate([_parameters(item.tip), item.axis.breaks if isinstance(item.axis, Curve) else []]))
        tips = item.tip.evaluate(u)
        if isinstance(item.axis, Curve):
            axes = item.axis.evaluate(u)
            axes = axes / np.linalg.norm(axes, axis=1)[:, None]
        else:
            axes = np.broadcast_to(np.asarray(item.axis) / np.linalg.norm(item.axis), (len(u), 3))
        way = np.linalg.norm(np.diff(tips, axis=0), axis=1) / _PITCH_MM
        turn = np.linalg.norm(np.diff(axes, axis=0), axis=1) / _TURN_RAD
        both, _ = _spread(np.hstack([tips, axes]), 1.0, np.maximum(way, turn))
        both[:, 3:] /= np.linalg.norm(both[:, 3:], axis=1)[:, None]
        poses.append(both)
        numbers.append(np.full(len(both), number))
    return np.vstack(poses), np.concatenate(numbers)


def _parameters(curve: Curve) -> Floats:
    """(k,) parameters whose chords stay within _CHORD_MM."""
    if curve.degree == 1 and curve.weights is None:
        return np.asarray(curve.knots[1:-1], dtype=np.float64)
    return np.asarray(curve.sample(_CHORD_MM), dtype=np.float64)


def _polyline(curve: Curve) -> Floats:
    """(k, 3) float, mm: points of a curve whose chords stay within _CHORD_MM."""
    if curve.degree == 1 and curve.weights is None:
        return np.asarray(curve.control_points, dtype=np.float64)
    return np.asarray(curve.evaluate(curve.sample(_CHORD_MM)))


def _spread(corners: Floats, pitch: float, lengths: Floats | None = None) -> tuple[Floats, Floats]:
    """Points (n, d) on a polyline (k, d), no farther apart than the pitch, corners included, and how far along each is (n,).

    lengths : (k - 1,) of its pieces; None: their own
    """
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1) if lengths is None else lengths
    parts = np.maximum(np.ceil(lengths / pitch - 1e-9), 1.0).astype(np.int64)
    piece = np.repeat(np.arange(len(parts)), parts)
    share = (np.arange(len(piece)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[piece]
    points = corners[piece] + share[:, None] * (corners[piece + 1] - corners[piece])
    begin = np.cumsum(lengths) - lengths
    arcs = begin[piece] + share * lengths[piece]
    return np.vstack([points, corners[-1:]]), np.append(arcs, lengths.sum())
