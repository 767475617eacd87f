"""The compiled local interpolation of one contour: distinct points, runs between corners, Bézier handles, NURBS."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.handles import (
    five_point_curvatures,
    matched_handles,
    speed_handles,
    tangents_astray,
    told_handles,
)
from planner.nurbs.segments import DUPLICATE_MM
from planner.nurbs.tangents import (
    AREA,
    CUSP,
    FIRST,
    GIVEN,
    HANDLE_END,
    HANDLE_START,
    POINT_X,
    POINT_Y,
    POINT_Z,
    PRODUCT,
    QUANTITIES,
    ROW,
    TANGENT_X,
    TANGENT_Y,
    TANGENT_Z,
    TURN_X,
    TURN_Y,
    TURN_Z,
    five_point_tangents,
    free_end_tangent,
    measure_chords,
    mirrored_tangent,
)

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

LONGEST = ROW - 8  # chords of one block, which is computed with one more on both sides and their two neighbours each
_STEP = LONGEST - 4  # chords of a block that others follow, so that the last has at least five
_ROUNDING = 16.0 * 2.220446049250313e-16

TANGENT_KNOWN, CURVATURE_KNOWN = 1.0, 2.0


@njit(cache=True, error_model="numpy", nogil=True)
def distinct_points(
    points: Floats, corners: Mask, low: int, high: int, closed: bool, kept: Indices, is_corner: Mask
) -> int:  # pragma: no cover - compiled
    """How many points of a contour differ from the one before; -1 - i if point i is not finite.

    points : (N, d) float, mm   low, high : the contour's points   kept, is_corner : written, at least high - low long
    On closed contours the last points also go if they repeat the first; a dropped corner moves to the point that stays.
    """
    count, solid = 0, points.shape[1] == 3
    x, y, z = np.inf, np.inf, np.inf
    for i in range(low, high):
        a, b, c = points[i, 0], points[i, 1], points[i, 2] if solid else 0.0
        size = max(max(abs(a), abs(b)), abs(c))
        if not abs(a) + abs(b) + abs(c) < np.inf:
            return -1 - (i - low)
        corner = corners[i] if corners.size else False
        if max(max(abs(a - x), abs(b - y)), abs(c - z)) > max(DUPLICATE_MM, _ROUNDING * size):
            kept[count], is_corner[count] = i, corner
            count += 1
            x, y, z = a, b, c
        else:
            is_corner[count - 1] |= corner
    while closed and count > 1:
        reach, size = 0.0, 0.0
        for axis in range(points.shape[1]):
            last = points[kept[count - 1], axis]
            reach, size = max(reach, abs(last - points[kept[0], axis])), max(size, abs(last))
        if reach > max(DUPLICATE_MM, _ROUNDING * size):
            break
        count -= 1
        is_corner[0] |= is_corner[count]
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def _load(
    w: Floats, points: Floats, kept: Indices, total: int, first: int, chords: int, cyclic: bool, at: int, count: int
) -> None:  # pragma: no cover - compiled
    """The points of the chords at ... at + count - 1 of a run, and two neighbours on both sides.

    first : the run's first point, of `total` cyclic ones   chords : of the whole run
    """
    solid = points.shape[1] == 3
    for slot in range(count + 5):
        r = at + slot - FIRST
        if cyclic or 0 <= r <= chords:
            row = first + r
            while row < 0:
                row += total
            while row >= total:
                row -= total
            row = kept[row]
            w[POINT_X + slot] = points[row, 0]
            w[POINT_Y + slot] = points[row, 1]
            w[POINT_Z + slot] = points[row, 2] if solid else 0.0
    if cyclic:
        return
    inner = 2 if chords > 1 else 1
    for base in (POINT_X, POINT_Y, POINT_Z):
        if at == 0:  # q0 = 2 q1 - q2, q-1 = 2 q0 - q1
            q1 = w[base + 3] - w[base + 2]
            q2 = w[base + 2 + inner] - w[base + 1 + inner]
            w[base + 1] = w[base + 2] - (2.0 * q1 - q2)
            w[base] = w[base + 1] - (3.0 * q1 - 2.0 * q2)
        if at + count == chords:
            end = base + 2 + count
            q1 = w[end] - w[end - 1]
            q2 = w[end + 1 - inner] - w[end - inner]
            w[end + 1] = w[end] + (2.0 * q1 - q2)
            w[end + 2] = w[end + 1] + (3.0 * q1 - 2.0 * q2)


@njit(cache=True, error_model="numpy", nogil=True)
def _take_known(
    w: Floats, tangents: Floats, curvatures: Floats, row: int, side: int, joint: int
) -> None:  # pragma: no cover - compiled
    """Known tangent and curvature of a point in place of the estimated ones. side : 0 arriving, 1 leaving."""
    flags = 0.0
    solid = tangents.shape[2] == 3
    if tangents.shape[0] and np.isfinite(tangents[row, side, 0]):
        w[TANGENT_X + joint] = tangents[row, side, 0]
        w[TANGENT_Y + joint] = tangents[row, side, 1]
        w[TANGENT_Z + joint] = tangents[row, side, 2] if solid else 0.0
        flags += TANGENT_KNOWN
    if curvatures.shape[0] and np.isfinite(curvatures[row, side, 0]):
        tx, ty, tz = w[TANGENT_X + joint], w[TANGENT_Y + joint], w[TANGENT_Z + joint]
        x, y = curvatures[row, side, 0], curvatures[row, side, 1]
        z = curvatures[row, side, 2] if solid else 0.0
        w[TURN_X + joint] = ty * z - tz * y
        w[TURN_Y + joint] = tz * x - tx * z
        w[TURN_Z + joint] = tx * y - ty * x
        flags += CURVATURE_KNOWN
    w[GIVEN + joint] = flags


@njit(cache=True, error_model="numpy", nogil=True)
def _free_ends(w: Floats, count: int, at_start: bool, at_end: bool) -> None:  # pragma: no cover - compiled
    """Tangents, and curvatures where five points allow, at and beside the free ends of a run."""
    alone = at_start and at_end and count == 1
    if at_start:
        free_end_tangent(w, 1, 2, 3, alone)
        for base in (TURN_X, TURN_Y, TURN_Z):
            w[base + 1], w[base + 2] = 0.0, 0.0
    if at_end:
        free_end_tangent(w, count + 1, count + 1, count, alone)
        for base in (TURN_X, TURN_Y, TURN_Z):
            w[base + count + 1], w[base + count] = 0.0, 0.0


@njit(cache=True, error_model="numpy", nogil=True)
def fit_block(
    w: Floats, count: int, at_start: bool, at_end: bool, rows: Indices, tangents: Floats, curvatures: Floats,
    matched: bool,
) -> None:  # pragma: no cover - compiled  # fmt: skip
    """Tangents and handles of a block whose points are loaded.

    at_start, at_end : whether it begins and ends at a free end   rows : (count+1,) int, table rows of its points
    """
    measure_chords(w, count)
    for base in (AREA, PRODUCT):
        if at_start:
            w[base + 1] = w[base + 2]
        if at_end:
            w[base + count + 1] = w[base + count]
    five_point_tangents(w, count)
    if matched:
        five_point_curvatures(w, count)
    if at_start or at_end:
        _free_ends(w, count, at_start, at_end)
    if tangents.shape[0] or curvatures.shape[0]:
        for joint in range(1, count + 2):
            side = 0 if joint == count + 1 and at_end else 1
            _take_known(w, tangents, curvatures, rows[joint - 1], side, joint)
        if at_start and w[GIVEN + 1] % 2 == 0.0 and w[GIVEN + 2] % 2 == 1.0:
            mirrored_tangent(w, 1, 2, 2)
        if at_end and w[GIVEN + count + 1] % 2 == 0.0 and w[GIVEN + count] % 2 == 1.0:
            mirrored_tangent(w, count + 1, count + 1, count)
    speed_handles(w, count)
    if matched:
        tangents_astray(w, count)
        matched_handles(w, count)
        if curvatures.shape[0]:
            told_handles(w, count)


@njit(cache=True, error_model="numpy", nogil=True)
def _fit_run(
    w: Floats, points: Floats, kept: Indices, is_corner: Mask, total: int, first: int, chords: int, cyclic: bool,
    tangents: Floats, curvatures: Floats, matched: bool, net: Floats, widths: Floats, rows: Indices,
) -> int:  # pragma: no cover - compiled  # fmt: skip
    """Handles of one run between corners, ends, or all round; returns how many cusps it has (they become corners).

    net : (3S+1, d), widths : (3S,) float, mm   Written: P0, P1, P2 and, every third, the knot span of each chord.
    """
    cusps, at, solid = 0, 0, points.shape[1] == 3
    w[GIVEN : GIVEN + ROW] = 0.0
    while at < chords:
        count = chords - at if chords - at <= LONGEST else _STEP
        at_start, at_end = not cyclic and at == 0, not cyclic and at + count == chords
        lead = 0 if at_start else 1
        whole = count + lead if at_end else count + lead + 1
        _load(w, points, kept, total, first, chords, cyclic, at - lead, whole)
        if tangents.shape[0] or curvatures.shape[0]:
            for k in range(whole + 1):
                rows[k] = kept[(first + at - lead + k) % total]
        fit_block(w, whole, at_start, at_end, rows, tangents, curvatures, matched)
        for k in range(count):
            joint, slot = k + lead + 1, k + lead + FIRST
            c = first + at + k
            c = c if c < total else c - total
            if w[CUSP + joint] > 0.0 and w[GIVEN + joint] % 2 == 0.0 and not (at_start and k == 0):
                is_corner[c] = True
                cusps += 1
            start, end, row = w[HANDLE_START + slot], w[HANDLE_END + slot], 3 * c
            net[row, 0], net[row, 1] = w[POINT_X + slot], w[POINT_Y + slot]
            net[row + 1, 0] = w[POINT_X + slot] + start * w[TANGENT_X + joint]
            net[row + 1, 1] = w[POINT_Y + slot] + start * w[TANGENT_Y + joint]
            net[row + 2, 0] = w[POINT_X + slot + 1] - end * w[TANGENT_X + joint + 1]
            net[row + 2, 1] = w[POINT_Y + slot + 1] - end * w[TANGENT_Y + joint + 1]
            if solid:
                net[row, 2] = w[POINT_Z + slot]
                net[row + 1, 2] = w[POINT_Z + slot] + start * w[TANGENT_Z + joint]
                net[row + 2, 2] = w[POINT_Z + slot + 1] - end * w[TANGENT_Z + joint + 1]
            widths[row] = 1.5 * (start + end)
        at += count
    return cusps


@njit(cache=True, error_model="numpy", nogil=True)
def fit_contour(
    w: Floats, points: Floats, kept: Indices, is_corner: Mask, total: int, closed: bool, tangents: Floats,
    curvatures: Floats, matched: bool, net: Floats, widths: Floats, rows: Indices,
) -> None:  # pragma: no cover - compiled  # fmt: skip
    """Handles of all chords of one contour of `total` distinct points, cusps taken apart.

    A contour that reverses at a point has no tangent there: it is broken like at a corner.
    """
    for _ in range(3):
        cusps, breaks = 0, 0
        for k in range(total):
            breaks += is_corner[k]
        if closed and not breaks:
            cusps = _fit_run(
                w, points, kept, is_corner, total, 0, total, True, tangents, curvatures, matched, net, widths, rows
            )
        else:
            first = 0
            while closed and not is_corner[first]:
                first += 1
            begin, stop = first, first + total if closed else total - 1
            k = first + 1
            while k <= stop:
                if k == stop or is_corner[k % total]:
                    cusps += _fit_run(
                        w, points, kept, is_corner, total, begin % total, k - begin, False, tangents, curvatures,
                        matched, net, widths, rows,
                    )  # fmt: skip
                    begin = k
                k += 1
        if not cusps:
            break


@njit(cache=True, error_model="numpy", nogil=True)
def _finish(
    net: Floats, knots: Floats, chords: int, is_corner: Mask, keeps_joints: bool
) -> tuple[int, int]:  # pragma: no cover - compiled
    """Knots (paper Eqs. 9, 11) and, for equal speed, control points (Eq. 10) in place; returns how many of each.

    Unless all joints are kept, one where the way on is C1 (equal speed) is no control point and its knot is double;
    elsewhere it is one and triple.
    net : (3S+1, d) float, mm   The last point is given.   knots : (3S+5,) float   Widths in knots[1::3].
    """
    whole, reached, row, knot = 0.0, 0.0, 0, 1
    for c in range(chords):
        whole += knots[3 * c + 1]
    share = 1.0 / whole
    knots[0] = 0.0
    for c in range(chords):
        width, at = knots[3 * c + 1], reached * share
        knots[knot], knots[knot + 1] = at, at
        knot += 2
        if c == 0 or keeps_joints or is_corner[c]:
            knots[knot] = at
            knot += 1
        reached += width
    knots[knot : knot + 4] = 1.0
    if keeps_joints:
        return 3 * chords + 1, knot + 4
    for c in range(chords):
        first = 3 * c if c == 0 or is_corner[c] else 3 * c + 1
        for source in range(first, 3 * c + 3):
            for axis in range(net.shape[1]):
                net[row, axis] = net[source, axis]
            row += 1
    net[row] = net[3 * chords]
    return row + 1, knot + 4


@njit(cache=True, error_model="numpy", nogil=True)
def fit_all(
    points: Floats, offsets: Indices, closed: Mask, corners: Mask, tangents: Floats, curvatures: Floats, matched: bool,
    keeps_joints: bool, net: Floats, knots: Floats, sizes: Indices,
) -> tuple[int, int]:  # pragma: no cover - compiled  # fmt: skip
    """All curves of a table; returns (-1, 0), or the first contour that makes none and how many distinct points it
    has (-1 - i if its point i is not finite).

    keeps_joints : whether smooth joints stay control points (always where handles are not of equal speed)

    net : (3N+k, d), knots : (3N+5k,), sizes : (k, 2) int   Written one contour after the other.
    """
    longest = 0
    for i in range(len(closed)):
        longest = max(longest, offsets[i + 1] - offsets[i])
    w = np.zeros(QUANTITIES * ROW)
    kept, is_corner = np.empty(longest, np.int64), np.empty(longest, np.bool_)
    rows = np.empty(ROW, np.int64)
    row, knot = 0, 0
    for i in range(len(closed)):
        total = distinct_points(points, corners, offsets[i], offsets[i + 1], closed[i], kept, is_corner)
        if total < (3 if closed[i] else 2):
            return i, total
        mine, my_knots, chords = net[row:], knots[knot:], total if closed[i] else total - 1
        fit_contour(
            w, points, kept, is_corner, total, closed[i], tangents, curvatures, matched, mine, my_knots[1:], rows
        )
        mine[3 * chords] = points[kept[chords % total]]
        rows_used, knots_used = _finish(mine, my_knots, chords, is_corner, keeps_joints)
        sizes[i, 0], sizes[i, 1] = rows_used, knots_used
        row, knot = row + rows_used, knot + knots_used
    return -1, 0
