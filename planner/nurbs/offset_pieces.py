"""Few arcs and cubics for a stretch of an offset curve, each within a tolerance of it."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.offset_trace import offset_jet

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

_PROBES = 8  # per piece, between its ends
_WIDEST = 1.75  # rad that one piece may turn
_ARC_SHARE = 0.1  # of the tolerance: what passes as an arc is an arc
_ARC_RAD = 2e-3  # by which an arc's end tangents may miss the offset's
_LEAST_MM = 1e-4  # shorter pieces are not divided
_DEPTH = 16  # halvings of a stretch; one that needs more runs back on itself and is none
_NEWTON_STEPS = 20
_STRAIGHT_MM = 1e-9  # by which a line may bend
_FOOT_STEPS = 4
_BESIDE = 0.01  # of the tolerance, both squared: a probe whose foot is that near adds nothing to its distance
_GOOD_SHARE = 0.1  # of the tolerance: equal handles that fit as well as this are kept


@njit(cache=True, error_model="numpy", nogil=True)
def _probe(
    table: Floats, is_corner: Mask, begin: int, low: int, count: int, start: float, end: float, left: float, rows: Floats
) -> None:  # pragma: no cover
    """Places, tangents, speeds and curvatures at even steps from start to end: rows (n, 6).

    Parameters count pieces from `begin` on, round the loop of `count` pieces that begins at `low`.
    """
    last = len(rows) - 1
    for k in range(last + 1):
        g = start + (end - start) * k / last
        number = int(np.floor(g))
        if k == last and number == g and number > start:
            number -= 1
        piece = low + (begin - low + number) % count
        x, y, tx, ty, v, bend = offset_jet(table, is_corner, piece, min(max(g - number, 0.0), 1.0), left)
        rows[k, 0], rows[k, 1], rows[k, 2], rows[k, 3], rows[k, 4], rows[k, 5] = x, y, tx, ty, v, bend


@njit(cache=True, error_model="numpy", nogil=True)
def _turning(rows: Floats) -> float:  # pragma: no cover
    """Absolute turning along the probes, rad."""
    total = 0.0
    for k in range(len(rows) - 1):
        cross = rows[k, 2] * rows[k + 1, 3] - rows[k, 3] * rows[k + 1, 2]
        total += abs(np.arctan2(cross, rows[k, 2] * rows[k + 1, 2] + rows[k, 3] * rows[k + 1, 3]))
    return total


@njit(cache=True, error_model="numpy", nogil=True)
def _arc(rows: Floats, tolerance: float, net: Floats) -> bool:  # pragma: no cover
    """The circular arc through the ends, as a rational cubic, if all probes lie on it."""
    ax, ay = rows[-1, 0] - rows[0, 0], rows[-1, 1] - rows[0, 1]
    chord = np.hypot(ax, ay)
    before = np.arctan2(rows[0, 2] * ay - rows[0, 3] * ax, rows[0, 2] * ax + rows[0, 3] * ay)
    after = np.arctan2(ax * rows[-1, 3] - ay * rows[-1, 2], ax * rows[-1, 2] + ay * rows[-1, 3])
    half = 0.5 * (before + after)
    if abs(before - after) > 2.0 * _ARC_RAD or abs(half) > 0.55 * _WIDEST or chord < 1e-9:
        return False
    if abs(half) * chord < 0.1 * tolerance:
        for k in range(1, len(rows) - 1):
            if abs((rows[k, 0] - rows[0, 0]) * ay - (rows[k, 1] - rows[0, 1]) * ax) > tolerance * chord:
                return False
        for k in range(4):
            net[k, 0], net[k, 1], net[k, 2] = rows[0, 0] + ax * k / 3.0, rows[0, 1] + ay * k / 3.0, 1.0
        return True
    radius = 0.5 * chord / np.sin(half)
    cx = 0.5 * (rows[0, 0] + rows[-1, 0]) - ay / chord * radius * np.cos(half)
    cy = 0.5 * (rows[0, 1] + rows[-1, 1]) + ax / chord * radius * np.cos(half)
    for k in range(1, len(rows) - 1):
        if abs(np.hypot(rows[k, 0] - cx, rows[k, 1] - cy) - abs(radius)) > tolerance:
            return False
    weight, sag = np.cos(half), 0.5 * np.tan(half)
    mx, my = 0.5 * (rows[0, 0] + rows[-1, 0]) + ay * sag, 0.5 * (rows[0, 1] + rows[-1, 1]) - ax * sag
    inner = (1.0 + 2.0 * weight) / 3.0
    for end, row in ((0, 0), (3, len(rows) - 1)):
        net[end, 0], net[end, 1], net[end, 2] = rows[row, 0], rows[row, 1], 1.0
        near = 1 if end == 0 else 2
        net[near, 0] = (rows[row, 0] + 2.0 * weight * mx) / (1.0 + 2.0 * weight)
        net[near, 1] = (rows[row, 1] + 2.0 * weight * my) / (1.0 + 2.0 * weight)
        net[near, 2] = inner
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def _even_handles(rows: Floats) -> float:  # pragma: no cover
    """A third of the speed that is equal at both ends and in the middle, mm. Source: paper Eqs. 5-7 as corrected."""
    ax, ay = rows[-1, 0] - rows[0, 0], rows[-1, 1] - rows[0, 1]
    sx, sy = rows[0, 2] + rows[-1, 2], rows[0, 3] + rows[-1, 3]
    square, along, length2 = 16.0 - sx * sx - sy * sy, ax * sx + ay * sy, ax * ax + ay * ay
    return float(2.0 * (np.sqrt(along**2 + square * length2) - along) / square)


@njit(cache=True, error_model="numpy", nogil=True)
def _matched_handles(rows: Floats) -> tuple[float, float]:  # pragma: no cover
    """Handles that reproduce the curvature at both ends, mm; negative where there are none.

    Source: de Boor, Höllig, Sabin, High accuracy geometric Hermite interpolation, CAGD 4 (1987).
    """
    ax, ay = rows[-1, 0] - rows[0, 0], rows[-1, 1] - rows[0, 1]
    k0, k1 = rows[0, 5], rows[-1, 5]
    begin = rows[0, 2] * ay - rows[0, 3] * ax
    end = ax * rows[-1, 3] - ay * rows[-1, 2]
    both = rows[0, 2] * rows[-1, 3] - rows[0, 3] * rows[-1, 2]
    length = np.hypot(ax, ay)
    d0 = d1 = length / 3.0
    for _ in range(_NEWTON_STEPS):
        first = 1.5 * k0 * d0 * d0 - begin + d1 * both
        second = 1.5 * k1 * d1 * d1 - end + d0 * both
        a, b = 3.0 * k0 * d0, 3.0 * k1 * d1
        determinant = a * b - both * both
        if determinant == 0.0:
            return -1.0, -1.0
        step0, step1 = (first * b - second * both) / determinant, (second * a - first * both) / determinant
        d0, d1 = d0 - step0, d1 - step1
        if abs(step0) + abs(step1) < 1e-12 * length:
            if 0.1 * length < d0 < length and 0.1 * length < d1 < length:
                return d0, d1
            return -1.0, -1.0
    return -1.0, -1.0


@njit(cache=True, error_model="numpy", nogil=True)
def _cubic(rows: Floats, d0: float, d1: float, net: Floats) -> None:  # pragma: no cover
    net[:, 2] = 1.0
    for axis in range(2):
        net[0, axis], net[3, axis] = rows[0, axis], rows[-1, axis]
        net[1, axis] = rows[0, axis] + d0 * rows[0, 2 + axis]
        net[2, axis] = rows[-1, axis] - d1 * rows[-1, 2 + axis]


@njit(cache=True, error_model="numpy", nogil=True)
def _misses(rows: Floats, net: Floats, tolerance: float) -> float:  # pragma: no cover
    """Largest distance of the probes from a polynomial cubic, mm; the first beyond the tolerance if there is one."""
    worst, reach, length = 0.0, 0.0, 0.0
    for k in range(1, len(rows)):
        length += np.hypot(rows[k, 0] - rows[k - 1, 0], rows[k, 1] - rows[k - 1, 1])
    ax, ay = net[1, 0] - net[0, 0], net[1, 1] - net[0, 1]
    bx, by = net[2, 0] - net[1, 0], net[2, 1] - net[1, 1]
    cx, cy = net[3, 0] - net[2, 0], net[3, 1] - net[2, 1]
    for k in range(1, len(rows) - 1):
        reach += np.hypot(rows[k, 0] - rows[k - 1, 0], rows[k, 1] - rows[k - 1, 1])
        t, away = reach / length, 0.0
        for _ in range(_FOOT_STEPS):
            r = 1.0 - t
            b0, b1, b2, b3 = r * r * r, 3.0 * r * r * t, 3.0 * r * t * t, t * t * t
            gx = rows[k, 0] - b0 * net[0, 0] - b1 * net[1, 0] - b2 * net[2, 0] - b3 * net[3, 0]
            gy = rows[k, 1] - b0 * net[0, 1] - b1 * net[1, 1] - b2 * net[2, 1] - b3 * net[3, 1]
            c0, c1, c2 = 3.0 * r * r, 6.0 * r * t, 3.0 * t * t
            dx, dy = c0 * ax + c1 * bx + c2 * cx, c0 * ay + c1 * by + c2 * cy
            square = max(dx * dx + dy * dy, 1e-300)
            along = gx * dx + gy * dy
            away = gx * gx + gy * gy
            if along * along <= _BESIDE * tolerance * tolerance * square:
                break
            t = min(max(t + along / square, 0.0), 1.0)
        worst = max(worst, np.sqrt(away))
        if worst > tolerance:
            break
    return worst


@njit(cache=True, error_model="numpy", nogil=True)
def _one_piece(rows: Floats, tolerance: float, arcs: bool, net: Floats) -> bool:  # pragma: no cover
    """The arc, or the better cubic, through the probes' ends; whether all probes lie within the tolerance of it."""
    if _turning(rows) > _WIDEST:
        return False
    if _arc(rows, _ARC_SHARE * tolerance, net) and (arcs or net[1, 2] == 1.0):
        return True
    even = _even_handles(rows)
    _cubic(rows, even, even, net)
    worst = _misses(rows, net, tolerance)
    if worst <= _GOOD_SHARE * tolerance:
        return True
    d0, d1 = _matched_handles(rows)
    if d0 > 0.0:
        other = np.empty((4, 3))
        _cubic(rows, d0, d1, other)
        matched = _misses(rows, other, tolerance)
        if matched < worst:
            net[:], worst = other, matched
    return worst <= tolerance


@njit(cache=True, error_model="numpy", nogil=True)
def _is_line(table: Floats, piece: int) -> bool:  # pragma: no cover
    """Whether a piece of the source is straight and evenly run: its offset is a line between its ends' offsets."""
    bends = abs(table[piece, 1, 2])
    for k in range(2, table.shape[1]):
        bends += abs(table[piece, k, 0]) + abs(table[piece, k, 1]) + abs(table[piece, k, 2])
    return bool(bends <= _STRAIGHT_MM)


@njit(cache=True, error_model="numpy", nogil=True)
def fit_stretch(
    table: Floats, is_corner: Mask, begins: Mask, low: int, high: int, row: Floats, left: float, tolerance: float, arcs: bool
) -> tuple[Floats, bool]:  # pragma: no cover
    """Pieces (m, 4, 3) for one stretch, control points x, y and weight, halved until they fit; whether all do.

    row : of `trace_ring`   low, high : its loop's pieces   left : distance to the left, mm   tolerance : mm
    arcs : make arcs rational; else cubics.
    """
    begin, count = int(row[0]), high - low
    start, end = row[1], (int(row[2]) - begin) % count + row[3]
    if end <= start:
        end += count
    nets = np.empty((64, 4, 3))
    found, good = 0, True
    rows, few = np.empty((_PROBES + 2, 6)), np.empty((2, 6))
    ends = np.empty(_DEPTH + 2)
    at = start
    while at < end:
        stop = int(np.floor(at)) + 1.0
        while stop < end and not begins[low + (begin - low + int(stop)) % count]:
            stop += 1.0
        ends[0], depth = min(stop, end), 1
        while depth:
            if found == len(nets):
                nets = np.concatenate((nets, np.empty_like(nets)))
            number = int(np.floor(at))
            piece = low + (begin - low + number) % count
            exact = ends[depth - 1] <= number + 1.0 and (_is_line(table, piece) if not is_corner[piece] else arcs)
            probes = few if exact else rows
            _probe(table, is_corner, begin, low, count, at, ends[depth - 1], left, probes)
            fits = _one_piece(probes, tolerance, arcs, nets[found])
            chord = np.hypot(probes[-1, 0] - probes[0, 0], probes[-1, 1] - probes[0, 1])
            short = chord < _LEAST_MM and _turning(probes) < _WIDEST
            if not fits and not short:
                if depth > _DEPTH:
                    return nets[:found], False
                ends[depth] = 0.5 * (at + ends[depth - 1])
                depth += 1
                continue
            good = good and (fits or short)
            found, depth = found + 1, depth - 1
            at = ends[depth]
    return nets[:found], good


@njit(cache=True, error_model="numpy", nogil=True)
def fit_stretches(
    table: Floats, is_corner: Mask, begins: Mask, first_piece: Ints, loop: Ints, rows: Floats, left: Floats,
    tolerance: float, arcs: bool,
) -> tuple[Floats, Ints, Mask]:  # pragma: no cover  # fmt: skip
    """Pieces of many stretches: (m, 4, 3), first piece of each stretch (s+1,), whether all its pieces fit (s,).

    rows : (s, 6) of `trace_rings`   left : (s,) float, mm.
    """
    count = len(rows)
    nets = np.empty((4 * count + 64, 4, 3))
    begin = np.zeros(count + 1, dtype=np.int64)
    fits = np.zeros(count, dtype=np.bool_)
    for k in range(count):
        own = loop[int(rows[k, 0])]
        found, fits[k] = fit_stretch(
            table, is_corner, begins, first_piece[own], first_piece[own + 1], rows[k], left[k], tolerance, arcs
        )
        begin[k + 1] = begin[k] + len(found)
        while begin[k + 1] > len(nets):
            nets = np.concatenate((nets, np.empty_like(nets)))
        nets[begin[k] : begin[k + 1]] = found
    return nets[: begin[count]].copy(), begin, fits
