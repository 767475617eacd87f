"""Stretches of many passes made blocks at once: polylines, and polynomial NURBS without corners, whose tool axis stands."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.curve import Curve
from planner.plan import Pass
from planner.post.pass_curve import PassCurve
from planner.post.tcp_blocks import BLOCK_DTYPE, What
from planner.post.tcp_pass import Frame, Spline

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_SAME_ARC_MM = 1e-6
_SAME_KNOT = 1e-6  # of the domain: a cut nearer to a knot than this is made there
_STRAIGHT_MM = 1e-6  # what poles of a straight way lie off it through rounding
_SPAN_DIGITS = 6  # decimals of knots, in a parameter that is the arc length in mm


@dataclass(frozen=True)
class _Part:
    """Stretches of one pass, numbered from `serial`: between arc lengths edges (k + 1,), mm, at feeds (k,), mm/min; item : of the tape."""

    serial: int
    item: int
    source: Pass
    edges: Floats
    feeds: Floats


@dataclass
class Batch:
    """Stretches in any order; `blocks` gives their rows and the serial number of the stretch of each.

    frame : workpiece from build   degrees : of NURBS that go out as such
    """

    frame: Frame
    degrees: tuple[int, ...]
    _lines: list[_Part] = field(default_factory=list)
    _splines: list[_Part] = field(default_factory=list)

    def takes(self, source: Pass) -> bool:
        """Whether a pass can be made here."""
        tip = source.tip
        if isinstance(source.axis, Curve) or tip.weights is not None:
            return False
        p = tip.degree
        inner = tip.knots[p + 1 : -p - 1]
        has_corner = bool(np.any(inner[p - 1 :] == inner[: max(len(inner) - p + 1, 0)]))
        if p == 1:
            return True
        return p in self.degrees and not source.rapid and not has_corner and not is_straight(tip.control_points)

    def add(self, serial: int, item: int, source: Pass, edges: Floats, feeds: Floats) -> None:
        """Stretches of one pass between arc lengths (k + 1,), numbered from serial, at feeds (k,); item : of the tape, its first move."""
        (self._lines if source.tip.degree == 1 else self._splines).append(_Part(serial, item, source, edges, feeds))

    def blocks(self) -> tuple[NDArray[np.void], Ints]:
        """(n,) BLOCK_DTYPE without time and joints, and (n,) serial numbers."""
        made = [make(parts, self.frame) for make, parts in ((_lines, self._lines), (_splines, self._splines)) if parts]
        if not made:
            return np.zeros(0, BLOCK_DTYPE), np.zeros(0, dtype=np.int64)
        return np.concatenate([rows for rows, _ in made]), np.concatenate([serials for _, serials in made])


def _lines(parts: list[_Part], frame: Frame) -> tuple[NDArray[np.void], Ints]:
    """Straight moves: to every corner, and to the end of every stretch."""
    sizes = [len(part.source.tip.control_points) for part in parts]
    corners = frame.points(np.concatenate([part.source.tip.control_points for part in parts]))
    corner_of = np.repeat(np.arange(len(parts)), sizes)
    reached = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    reached -= reached[np.append(0, np.cumsum(sizes))[:-1]][corner_of]
    far = 1.0 + float(reached.max())
    place = far * corner_of + reached
    cut_of = np.repeat(np.arange(len(parts)), [len(part.edges) for part in parts])
    cuts = far * cut_of + np.concatenate([part.edges for part in parts])
    follows = np.diff(cut_of) == 0
    begins, ends = cuts[:-1][follows], cuts[1:][follows]
    after = np.searchsorted(begins, place, side="right") - 1
    inside = (place > begins[after] + _SAME_ARC_MM) & (place < ends[after] - _SAME_ARC_MM)
    stops = np.concatenate([place[inside], ends])
    stretch = np.concatenate([after[inside], np.arange(len(ends))])
    order = np.lexsort((stops, stretch))
    stops, stretch = stops[order], stretch[order]
    of = cut_of[:-1][follows][stretch]
    rows = np.zeros(len(stops), BLOCK_DTYPE)
    for k in range(3):
        rows["tip"][:, k] = np.interp(stops, place, corners[:, k])
    rows["arc_end_mm"] = stops - far * of
    first = np.append(True, np.diff(stretch) != 0)
    rows["arc_start_mm"] = np.where(first, begins[stretch] - far * of, np.append(0.0, rows["arc_end_mm"][:-1]))
    rows["what"] = np.where(np.array([part.source.rapid for part in parts])[of], What.RAPID, What.LINE)
    rows["axis"] = _axes(parts, frame)[of]
    rows["tip_end"], rows["axis_end"] = rows["tip"], rows["axis"]
    rows["feed_mm_min"] = np.concatenate([part.feeds for part in parts])[stretch]
    rows["item"] = np.array([part.item for part in parts])[of]
    return rows, np.concatenate([part.serial + np.arange(len(part.feeds)) for part in parts])[stretch]


def _axes(parts: list[_Part], frame: Frame) -> Floats:
    """(parts, 3) unit vectors, workpiece."""
    axes = np.array([part.source.axis for part in parts], dtype=np.float64).reshape(-1, 3)
    return frame.vectors(axes / np.linalg.norm(axes, axis=1, keepdims=True))


def _splines(parts: list[_Part], frame: Frame) -> tuple[NDArray[np.void], Ints]:
    """A START and as many POLEs as the NURBS of each stretch has besides the first."""
    tips = [part.source.tip for part in parts]
    knots = [
        _clamped(tip.knots, tip.degree, u0, u1)
        for part, tip in zip(parts, tips, strict=True)
        for u0, u1 in _stretches(tip, part.edges)
    ]
    sizes = [len(part.feeds) for part in parts]
    of = np.repeat(np.arange(len(parts)), sizes)
    degree = np.array([tip.degree for tip in tips])[of]
    count = np.array([len(values) for values in knots]) - degree - 1
    stretch = np.repeat(np.arange(len(knots)), count)
    poles, points, params = _poles(
        np.concatenate(knots),
        _starts([len(values) for values in knots]),
        degree,
        of,
        np.concatenate([tip.knots for tip in tips]),
        _starts([len(tip.knots) for tip in tips]),
        frame.points(np.concatenate([tip.control_points for tip in tips])),
        _starts([len(tip.control_points) for tip in tips]),
    )
    part_of = of[stretch]
    ends = np.searchsorted(part_of, np.arange(len(parts) + 1))
    reached = np.concatenate(
        [tip.arc_length(params[a:b]) for tip, a, b in zip(tips, ends[:-1].tolist(), ends[1:].tolist(), strict=True)]
    )
    rows = np.zeros(len(stretch), BLOCK_DTYPE)
    first = np.append(True, np.diff(stretch) != 0)
    rows["what"] = np.where(first, What.START, What.POLE)
    rows["tip"], rows["tip_end"] = poles, points
    rows["axis"] = rows["axis_end"] = _axes(parts, frame)[part_of]
    rows["arc_end_mm"] = reached
    rows["arc_start_mm"] = np.where(first, reached, np.append(0.0, reached[:-1]))
    rows["feed_mm_min"] = np.concatenate([part.feeds for part in parts])[stretch]
    rows["weight"], rows["degree"] = 1.0, degree[stretch]
    begin, end = _starts(count)[:-1], _starts(count)[1:] - 1
    scale = (reached[end] - reached[begin]) / (params[end] - params[begin])
    along = np.round((params - params[begin][stretch]) * scale[stretch], _SPAN_DIGITS)
    rows["span"] = np.where(first, 0.0, np.diff(along, prepend=0.0))
    rows["item"] = np.array([part.item for part in parts])[part_of]
    serials = np.concatenate([part.serial + np.arange(len(part.feeds)) for part in parts])
    return rows, serials[stretch]


def _starts(sizes: Sequence[int] | Ints) -> Ints:
    return np.append(0, np.cumsum(sizes)).astype(np.int64)


def _stretches(tip: Curve, edges: Floats) -> list[tuple[float, float]]:
    """Parameters at which stretches begin and end; a cut next to a knot is made at the knot."""
    low, high = tip.domain
    u = np.array([low, high])
    if len(edges) > 2 or edges[0] > _SAME_ARC_MM or tip.length - edges[-1] > _SAME_ARC_MM:
        u = tip.at_arc_length(np.minimum(edges, tip.length))
        after = np.searchsorted(tip.knots, u).clip(1, len(tip.knots) - 1)
        before, behind = tip.knots[after - 1], tip.knots[after]
        near = np.where(u - before < behind - u, before, behind)
        u = np.where(np.abs(near - u) <= _SAME_KNOT * (high - low), near, u)
    return list(itertools.pairwise(u.tolist()))


def _clamped(knots: Floats, degree: int, start: float, end: float) -> Floats:
    inner = knots[np.searchsorted(knots, start, side="right") : np.searchsorted(knots, end)]
    return np.concatenate([np.full(degree + 1, start), inner, np.full(degree + 1, end)])


def spline_blocks(item: Spline, curve: PassCurve, feed: float) -> NDArray[np.void]:
    """START and POLE blocks of one NURBS; block i ends, on the curve, at knot p + i."""
    p, count = item.degree, len(item.poles)
    if item.is_axis_constant and is_straight(item.poles):
        return _line(item, curve, feed)
    blocks = np.zeros(count, BLOCK_DTYPE)
    at = item.knots[np.minimum(np.arange(count) + p, count)]
    tips, axes, reached = curve.tips(at), curve.axes(at), curve.arc_length(at)
    blocks["what"] = What.POLE
    blocks["what"][0] = What.START
    blocks["tip"], blocks["axis"] = item.poles, item.axes
    blocks["tip_end"], blocks["axis_end"] = tips, axes
    blocks["arc_end_mm"] = reached
    blocks["arc_start_mm"] = np.append(reached[0], reached[:-1])
    blocks["feed_mm_min"], blocks["weight"], blocks["degree"] = feed, item.weights, p
    blocks["turns"] = not item.is_axis_constant
    scale = (reached[-1] - reached[0]) / (item.knots[-1] - item.knots[0])
    knots = np.round((at - item.knots[0]) * scale, _SPAN_DIGITS)
    blocks["span"] = np.diff(knots, prepend=0.0)
    return blocks


def _line(item: Spline, curve: PassCurve, feed: float) -> NDArray[np.void]:
    """The LINE block of a NURBS that goes straight."""
    row = np.zeros(1, BLOCK_DTYPE)
    ends = item.knots[[0, -1]]
    row["what"] = What.LINE
    row["tip"] = row["tip_end"] = curve.tips(ends[1:])
    row["axis"] = row["axis_end"] = curve.axes(ends[1:])
    row["arc_start_mm"], row["arc_end_mm"] = curve.arc_length(ends)
    row["feed_mm_min"] = feed
    return row


def is_straight(poles: Floats) -> bool:
    """Whether poles (n, 3), mm, lie on the way from the first to the last, in this order."""
    chord = poles[-1] - poles[0]
    length = float(np.sqrt(chord @ chord))
    if length <= _STRAIGHT_MM:
        return False
    along = (poles - poles[0]) @ (chord / length)
    off = poles - poles[0] - along[:, None] * (chord / length)
    return bool(np.abs(off).max() <= _STRAIGHT_MM and np.all(np.diff(along) >= -_STRAIGHT_MM))


@njit(cache=True)
def _poles(
    knots: Floats, knot_at: Ints, degree: Ints, of: Ints, own: Floats, own_at: Ints, points: Floats, point_at: Ints
) -> tuple[Floats, Floats, Floats]:
    """Poles of stretches on their own clamped knots, points of the curves at knots p + i, and those knots.

    Pole i is the blossom of the polynomial of any piece that it reaches at knots i + 1 to i + p. Source: Farin, Curves and Surfaces for CAGD, 8.7.
    """
    total = len(knots) - int((degree + 1).sum())
    poles, tips, params = np.empty((total, 3)), np.empty((total, 3)), np.empty(total)
    at = np.empty(3)
    row = 0
    for part in range(len(of)):
        p, curve = degree[part], of[part]
        t = knots[knot_at[part] : knot_at[part + 1]]
        source = own[own_at[curve] : own_at[curve + 1]]
        here = points[point_at[curve] : point_at[curve + 1]]
        n = len(t) - p - 1
        for i in range(n):
            j = i + p // 2
            for step in range(p + 1):
                j = i + (p // 2 + step) % (p + 1)
                if p <= j < n and t[j] < t[j + 1]:
                    break
            middle = 0.5 * (t[j] + t[j + 1])
            span = np.searchsorted(source, middle, side="right") - 1
            _blossom(source, here, p, span, t[i + 1 : i + 1 + p], poles[row])
            u = t[min(i + p, n)]
            span = min(max(np.searchsorted(source, u, side="right") - 1, p), len(here) - 1)
            at[:] = u
            _blossom(source, here, p, span, at[:p], tips[row])
            params[row] = u
            row += 1
    return poles, tips, params


@njit(cache=True)
def _blossom(knots: Floats, points: Floats, p: int, span: int, u: Floats, out: Floats) -> None:
    """The polar form of the piece from knot `span` on at u (p,)."""
    level = points[span - p : span + 1].copy()
    for r in range(1, p + 1):
        for j in range(p, r - 1, -1):
            low, high = knots[span - p + j], knots[span + 1 + j - r]
            share = (u[r - 1] - low) / (high - low)
            for k in range(3):
                level[j, k] = (1.0 - share) * level[j - 1, k] + share * level[j, k]
    for k in range(3):
        out[k] = level[p, k]
