"""Runs of contour points that lie on one circle or one straight line, and the exact rational pieces over them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

LINE, ARC = 0, 1
_LEAST_LINE, _LEAST_ARC = 2, 4  # chords: three points tell a line; any four that are symmetric lie on a circle, five tell
_APART = 0.25  # share of a run's mean chord below which a chord's ends are one point: they tell nothing more
_LARGEST_STEP = 0.8  # rad that an arc may turn from chord to chord: a square has its corners on a circle and is none
_QUARTER = 0.5 * math.pi


@njit(cache=True, error_model="numpy", nogil=True)
def _circle(p: Floats, q: Floats, r: Floats, out: Floats) -> bool:  # pragma: no cover - compiled
    """Centre, unit normal and radius of the circle through three points into out (7,); False if they are in line."""
    a, b = q - p, r - p
    n = np.array((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))
    n2, a2, b2 = (n * n).sum(), (a * a).sum(), (b * b).sum()
    if n2 <= 1e-18 * a2 * b2:
        return False
    v = a2 * b - b2 * a
    away = np.array((v[1] * n[2] - v[2] * n[1], v[2] * n[0] - v[0] * n[2], v[0] * n[1] - v[1] * n[0])) / (2.0 * n2)
    out[:3], out[3:6], out[6] = p + away, n / math.sqrt(n2), math.sqrt((away * away).sum())
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def _are_apart(points: Floats, i: int, j: int, least: int) -> bool:  # pragma: no cover - compiled
    """Whether at least so many chords of the points i ... j (cyclic) are not far shorter than the others."""
    n, whole, count = len(points), 0.0, 0
    for k in range(i, j):
        whole += math.sqrt(((points[(k + 1) % n] - points[k % n]) ** 2).sum())
    for k in range(i, j):
        count += ((points[(k + 1) % n] - points[k % n]) ** 2).sum() >= (_APART * whole / (j - i)) ** 2
    return bool(count >= least)


@njit(cache=True, error_model="numpy", nogil=True)
def _on_arc(points: Floats, i: int, j: int, tolerance: float, out: Floats) -> bool:  # pragma: no cover - compiled
    """Whether the points i ... j (cyclic) lie in order on one circle, its data in out."""
    n = len(points)
    last = j if j - i < n else j - (j - i) // 3
    if not _circle(points[i % n], points[(i + last) // 2 % n], points[last % n], out):
        return False
    if not _are_apart(points, i, j, _LEAST_ARC):
        return False
    before, start = np.zeros(3), True
    for k in range(i, j):
        p, q = points[k % n] - out[:3], points[(k + 1) % n] - out[:3]
        height = (q * out[3:6]).sum()
        if math.hypot(math.sqrt((q * q).sum() - min(height * height, (q * q).sum())) - out[6], height) > tolerance:
            return False
        along = q - p
        turn = (along * np.array((
            out[4] * p[2] - out[5] * p[1], out[5] * p[0] - out[3] * p[2], out[3] * p[1] - out[4] * p[0]
        ))).sum()  # fmt: skip
        if turn <= 0.0 or (along * along).sum() > (2.0 * math.sin(0.5 * _LARGEST_STEP) * out[6]) ** 2:
            return False
        if not start and (along * before).sum() <= 0.0:
            return False
        before, start = along, False
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def _on_line(points: Floats, i: int, j: int, tolerance: float) -> bool:  # pragma: no cover - compiled
    """Whether the points i ... j (cyclic) lie in order on the straight line from the first to the last."""
    n = len(points)
    along = points[j % n] - points[i % n]
    length2 = (along * along).sum()
    if length2 <= 0.0 or not _are_apart(points, i, j, _LEAST_LINE):
        return False
    reached = 0.0
    for k in range(i + 1, j):
        p = points[k % n] - points[i % n]
        share = (p * along).sum() / length2
        if share <= reached or share >= 1.0 or ((p - share * along) ** 2).sum() > tolerance * tolerance:
            return False
        reached = share
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def _reach(points: Floats, i: int, stop: int, is_arc: bool, tolerance: float, out: Floats) -> int:  # pragma: no cover
    """The farthest j <= stop to which a line or arc from i holds (i if none): doubled, then halved."""
    least = _LEAST_ARC if is_arc else _LEAST_LINE
    good, step, bad = i, least, stop + 1
    while good < stop:
        j = min(i + step, stop)
        if j - i < least:
            break
        holds = _on_arc(points, i, j, tolerance, out) if is_arc else _on_line(points, i, j, tolerance)
        if not holds:
            bad = j
            break
        good, step = j, 2 * step
    while good > i and bad - good > 1:
        j = (good + bad) // 2
        if _on_arc(points, i, j, tolerance, out) if is_arc else _on_line(points, i, j, tolerance):
            good = j
        else:
            bad = j
    return good


@njit(cache=True, error_model="numpy", nogil=True)
def find_runs(
    points: Floats, corners: Mask, closed: bool, tolerance: float, runs: Indices, shapes: Floats
) -> int:  # pragma: no cover - compiled
    """Lines and arcs of one contour, greedily from its first point, none across a corner; returns how many.

    points : (n, 3) float, mm, distinct   runs : (n, 3) int, written: first point, last point (up to n), LINE or ARC
    shapes : (n, 7) float, written: centre, unit normal (the arc turns left seen against it) and radius of an ARC
    Every point lies within the tolerance (mm). Grows as n log n.
    """
    n, count, i = len(points), 0, 0
    end = n if closed else n - 1
    out = np.zeros(7)
    if closed and n >= 2 * _LEAST_ARC and not corners.any() and _on_arc(points, 0, n, tolerance, out):
        runs[0, 0], runs[0, 1], runs[0, 2] = 0, n, ARC
        shapes[0] = out
        return 1
    stop = 0
    while i < end:
        if stop <= i:
            stop = i + 1
            while stop < end and not corners[stop]:
                stop += 1
        straight = _reach(points, i, stop, False, tolerance, out)
        round_ = _reach(points, i, stop, True, tolerance, out)
        if max(straight, round_) == i:
            i += 1
            continue
        if round_ > straight:
            _on_arc(points, i, round_, tolerance, out)
            shapes[count] = out
        runs[count, 0], runs[count, 1] = i, max(straight, round_)
        runs[count, 2] = ARC if round_ > straight else LINE
        i = runs[count, 1]
        count += 1
    return count


@dataclass(frozen=True)
class ExactPiece:
    """One line or arc of a contour, from point `first` to point `last` (up to n on a closed one).

    start, end : unit tangents there, (d,) float   length : mm
    rows, weights : (3m, d), (3m,) float   Control points of its m cubic Bézier pieces, the last point left out.
    """

    first: int
    last: int
    start: Floats
    end: Floats
    length: float
    rows: Floats
    weights: Floats


def exact_piece(points: Floats, run: Indices, shape: Floats) -> ExactPiece:
    """The line or arc of a run as `find_runs` gives them; points : (n, d) float, mm.

    An arc is cut into quarters at most, each raised from the rational quadratic; their ends are the contour's points.
    Source: Piegl & Tiller A7.1, ch. 5.5.
    """
    n, dimension = points.shape
    p, q = points[run[0] % n], points[run[1] % n]
    first, last = int(run[0]), int(run[1])
    if run[2] == LINE:
        length = float(np.linalg.norm(q - p))
        direction = (q - p) / length
        rows = np.array([p, p + (q - p) / 3.0, q - (q - p) / 3.0])
        return ExactPiece(first, last, direction, direction, length, rows, np.ones(3))
    centre, normal, radius = shape[:3], shape[3:6], float(shape[6])
    x = np.zeros(3)
    x[:dimension] = p
    x -= centre
    y = np.cross(normal, x)
    away = np.zeros(3)
    away[:dimension] = q
    away -= centre
    sweep = float(np.arctan2(away @ y, away @ x)) % (2.0 * math.pi)
    sweep = 2.0 * math.pi if (last - first == n or sweep == 0.0) else sweep
    count = max(1, math.ceil(sweep / _QUARTER - 1e-9))
    half = 0.5 * sweep / count
    angles = half * np.arange(2 * count + 1)
    ring = centre + np.cos(angles)[:, None] * x + np.sin(angles)[:, None] * y
    ring[1::2] += (1.0 / math.cos(half) - 1.0) * (ring[1::2] - centre)
    ring = ring[:, :dimension]
    ring[0], ring[-1] = p, q
    w = math.cos(half)
    rows = np.empty((count, 3, dimension))
    rows[:, 0] = ring[:-1:2]
    rows[:, 1] = (ring[:-1:2] + 2.0 * w * ring[1::2]) / (1.0 + 2.0 * w)
    rows[:, 2] = (ring[2::2] + 2.0 * w * ring[1::2]) / (1.0 + 2.0 * w)
    weights = np.tile([1.0, (1.0 + 2.0 * w) / 3.0, (1.0 + 2.0 * w) / 3.0], count)
    turned = y * math.cos(sweep) - x * math.sin(sweep)
    return ExactPiece(
        first, last, (y / radius)[:dimension], (turned / np.linalg.norm(turned))[:dimension], radius * sweep,
        rows.reshape(-1, dimension), weights,
    )  # fmt: skip
