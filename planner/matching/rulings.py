"""From matched measures to a ruled surface: both contours cut at the same places, on common knots, shapes unchanged."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.matching.outline import DIRECTION, PARAMETER, Outline
from planner.nurbs.curve import Curve
from planner.nurbs.ruled import RuledSurface

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_SAME_PLACE = 0.01  # of the mean distance of joints: joints of both contours nearer than this share one ruling
_LONGEST_TURN = np.radians(10.0)  # of a piece: within it the matching is taken as linear
_SPECK = 1e-6  # of the round: pieces shorter on both contours lie between points that are one but for rounding
_SAME_PARAMETER = 1e-9  # rounding of a parameter that went through the measure and back


def ruled_between(low: Outline, high: Outline, x_low: Floats, x_high: Floats) -> RuledSurface:
    """The ruled surface whose rulings join the matched measures.

    x_low, x_high : (k,) float, not decreasing, one round, as from `match_outlines`
    Both contours keep their shape exactly: each is cut at its own joints and at the partners of the other's, and both
    rows of Bézier pieces get the same knots. A corner may face a run of the other contour: its pieces have no length.
    Source: paper Eq. 19; Piegl & Tiller ch. 8.3.
    """
    at_low, at_high = common_joints(low, high, x_low, x_high)
    u_low, u_high = _parameters(low.curve, low, at_low), _parameters(high.curve, high, at_high)
    moves = (np.diff(u_low) > _SAME_PARAMETER) | (np.diff(u_high) > _SAME_PARAMETER)
    rows = np.append(0, np.flatnonzero(moves) + 1)
    net_low, net_high = _pieces(low.curve, u_low[rows]), _pieces(high.curve, u_high[rows])
    chord_low, chord_high = (np.linalg.norm(np.diff(net, axis=1), axis=2).sum(axis=1) for net in (net_low, net_high))
    width = chord_low / chord_low.sum() + chord_high / chord_high.sum()
    kept = width > _SPECK
    net_low, net_high, width = _closed_up(net_low[kept]), _closed_up(net_high[kept]), width[kept]
    breaks = np.concatenate([[0.0], np.cumsum(width)])
    breaks /= breaks[-1]
    knots = np.concatenate([[0.0], np.repeat(breaks, 3), [1.0]])
    return RuledSurface(_chained(net_low, knots), _chained(net_high, knots))


def common_joints(low: Outline, high: Outline, x_low: Floats, x_high: Floats) -> tuple[Floats, Floats]:
    """Measures on both outlines, (k,) each, over one round, between which pieces run: joints of either and partners."""
    along = x_low + x_high
    own, other = _marks(low, float(x_low[0])), _marks(high, float(x_high[0]))
    place = np.concatenate([np.interp(own, x_low, along), np.interp(other, x_high, along)])
    is_own = np.arange(len(place)) < len(own)
    order = np.lexsort([~is_own, place])
    place, is_own = place[order], is_own[order]
    exact = np.concatenate([own, other])[order]
    near = _SAME_PLACE * 2.0 / max(len(own), len(other))
    rows, partner = pair_neighbours(place, is_own, near)
    at_low = np.where(is_own[rows], exact[rows], np.interp(place[rows], along, x_low))
    at_high = np.where(is_own[rows], np.interp(place[rows], along, x_high), exact[rows])
    paired = partner >= 0
    at_low[paired] = np.where(is_own[rows], exact[rows], exact[partner])[paired]
    at_high[paired] = np.where(is_own[rows], exact[partner], exact[rows])[paired]
    at_low = _kept_between(at_low, is_own[rows] | paired)
    at_high = _kept_between(at_high, ~is_own[rows] | paired)
    at_low, at_high = np.append(at_low, at_low[0] + 1.0), np.append(at_high, at_high[0] + 1.0)
    return _filled(low, high, (at_low, at_high), (x_low, x_high))


def _marks(outline: Outline, start: float) -> Floats:
    """Measures from start to start + 1 of the curve's joints, at corners of both sides of the turn; increasing."""
    u = outline.curve.breaks[:-1]
    marks = np.unique(np.concatenate([outline.measure(u, True), outline.measure(u + (u == 0.0), False) % 1.0]))
    return np.sort(marks + np.ceil(start - marks))


@njit(cache=True)
def pair_neighbours(place: Floats, is_own: Flags, near: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Sorted marks of two kinds, neighbours of different kind within `near` of each other made one.

    Returns the rows that stay, and for each the row that it took in (-1: none), (k,) int64 each.
    """
    count = place.shape[0]
    rows = np.empty(count, np.int64)
    partner = np.full(count, -1, np.int64)
    kept = 0
    i = 0
    while i < count:
        rows[kept] = i
        if i + 1 < count and place[i + 1] - place[i] <= near and is_own[i] != is_own[i + 1]:
            partner[kept] = i + 1
            i += 1
        kept += 1
        i += 1
    return rows[:kept], partner[:kept]


def _kept_between(values: Floats, exact: Flags) -> Floats:
    """Values made not decreasing without moving the exact ones."""
    floor = np.maximum.accumulate(np.where(exact, values, -np.inf))
    ceiling = np.minimum.accumulate(np.where(exact, values, np.inf)[::-1])[::-1]
    return np.asarray(np.maximum.accumulate(np.clip(values, floor, ceiling)))


def _filled(
    low: Outline, high: Outline, joints: tuple[Floats, Floats], path: tuple[Floats, Floats]
) -> tuple[Floats, Floats]:
    """Joints added on the path where a piece turns far, so that the matching inside pieces is nearly linear."""
    turn = np.maximum(np.abs(np.diff(low.at(joints[0])[:, DIRECTION])), np.abs(np.diff(high.at(joints[1])[:, DIRECTION])))
    parts = np.maximum(np.ceil(turn / _LONGEST_TURN), 1).astype(np.intp)
    if (parts == 1).all():
        return joints
    piece = np.repeat(np.arange(len(parts)), parts)
    step = np.arange(len(piece)) - np.repeat(np.cumsum(parts) - parts, parts)
    share = step / parts[piece]
    along = joints[0] + joints[1]
    place = along[piece] + share * np.diff(along)[piece]
    whole = path[0] + path[1]
    on_path = [np.interp(place, np.concatenate([whole, whole[1:] + 2.0]), np.concatenate([x, x[1:] + 1.0])) for x in path]
    filled = [
        np.append(
            np.where(step == 0, ends[:-1][piece], np.clip(inner, ends[:-1][piece], ends[1:][piece])), ends[-1]
        )
        for ends, inner in zip(joints, on_path, strict=True)
    ]
    return np.maximum.accumulate(filled[0]), np.maximum.accumulate(filled[1])


def _parameters(curve: Curve, outline: Outline, x: Floats) -> Floats:
    """Parameters (k,), not decreasing over one round (above 1 after the seam)."""
    u = _at_joint(curve, outline.at(x)[:, PARAMETER]) % 1.0 + np.floor(x)
    u = u + np.cumsum(np.concatenate([[False], np.diff(u) < -0.5]))
    u = u - np.cumsum(np.concatenate([[False], np.diff(u) > 1.0 - _SAME_PARAMETER]))
    u = np.maximum.accumulate(u)
    u[-1] = u[0] + 1.0
    return np.asarray(np.minimum(u, u[-1]))


def _at_joint(curve: Curve, u: Floats) -> Floats:
    """Parameters (k,) in 0 ... 1, those within rounding of a joint of the curve exactly there."""
    breaks = curve.breaks
    index = np.clip(np.searchsorted(breaks, u), 1, len(breaks) - 1)
    nearest = np.where(u - breaks[index - 1] < breaks[index] - u, breaks[index - 1], breaks[index])
    return np.asarray(np.where(np.abs(u - nearest) <= _SAME_PARAMETER, nearest, u))


def _pieces(curve: Curve, u: Floats) -> Floats:
    """(k - 1, 4, d) float: the Bézier points of the closed cubic between parameters, exact where no joint lies inside."""
    start = _at_joint(curve, u[:-1] % 1.0) % 1.0
    stop = _at_joint(curve, u[1:] % 1.0)
    stop[stop == 0.0] = 1.0
    third = (np.diff(u) / 3.0)[:, None]
    first, last = curve.evaluate(start), curve.evaluate(stop)
    ahead, behind = curve.derivatives(start, 1)[1], curve.derivatives(stop, 1, "left")[1]
    net = np.stack([first, first + third * ahead, last - third * behind, last], axis=1)
    still = np.diff(u) <= _SAME_PARAMETER
    net[still] = first[still, None, :]
    return net


def _closed_up(net: Floats) -> Floats:
    """The pieces with every end moved to the start of the next: over specks that were left out."""
    net[:-1, 3] = net[1:, 0]
    net[-1, 3] = net[0, 0]
    return net


def _chained(net: Floats, knots: Floats) -> Curve:
    """The curve of Bézier pieces (k, 4, d) that join, on the given knots."""
    return Curve(3, knots, np.vstack([net[:, :3].reshape(-1, net.shape[2]), net[-1:, 3]]))
