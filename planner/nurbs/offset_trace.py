"""Which stretches of the source an offset polygon's ring stands for, and where exactly they meet."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.offset_source import jet

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Place = tuple[int, float]

_SAME_WAY = 1.5  # rad of turning between two places that are one: a way that comes back to its start turns by pi or more
_LOOK = 64  # sides between two places that may be one
_NEAR = 8  # and between the middles of neighbouring edges, seldom more than two
_AHEAD = 16  # sides that are tried first where an edge belongs to another part of the source
_NEWTON_STEPS = 40
_MEET_MM = 1e-9
_FLAT = 1e-7  # sine of the angle at which two stretches meet, below which the place is not found
_DROP_MM = 1e-5  # shorter stretches are left out


@njit(cache=True, error_model="numpy", nogil=True)
def offset_jet(
    table: Floats, is_corner: Mask, piece: int, t: float, left: float
) -> tuple[float, float, float, float, float, float]:  # pragma: no cover
    """Place, unit tangent, speed and curvature of the offset curve: x, y, tx, ty, v, kappa.

    left : the distance to the source's left (negative: right), mm. v < 0 where the offset runs backward: there the
    source bends more than the distance allows, and v (1 - left kappa) dt is never part of the result.
    """
    if is_corner[piece]:
        turn = table[piece, 1, 1]
        angle = table[piece, 1, 0] + turn * t
        nx, ny = np.cos(angle), np.sin(angle)
        x, y = table[piece, 0, 0] + left * nx, table[piece, 0, 1] + left * ny
        return x, y, ny, -nx, -left * turn, -1.0 / left
    x, y, dx, dy, ddx, ddy = jet(table, piece, t)
    speed = max(np.hypot(dx, dy), 1e-300)
    tx, ty = dx / speed, dy / speed
    bend = (dx * ddy - dy * ddx) / speed**3
    share = 1.0 - left * bend
    return x - left * ty, y + left * tx, tx, ty, speed * share, bend / (share if share != 0.0 else 1e-300)


@njit(cache=True, error_model="numpy", nogil=True)
def _share(points: Floats, after: Ints, side: int, x: float, y: float) -> tuple[float, float]:  # pragma: no cover
    """Where on a side the point nearest to (x, y) lies, 0 ... 1, and its distance, mm."""
    end = after[side]
    ax, ay = points[side, 0], points[side, 1]
    ux, uy = points[end, 0] - ax, points[end, 1] - ay
    length2 = max(ux * ux + uy * uy, 1e-300)
    share = min(max(((x - ax) * ux + (y - ay) * uy) / length2, 0.0), 1.0)
    dx, dy = x - ax - share * ux, y - ay - share * uy
    return share, np.sqrt(dx * dx + dy * dy)


@njit(cache=True, error_model="numpy", nogil=True)
def _settle(
    points: Floats, after: Ints, before: Ints, is_point: Mask, side: int, x: float, y: float
) -> tuple[int, float, float]:  # pragma: no cover
    """Downhill from a side to the nearest point of the source round there: side, share, distance."""
    if is_point[side]:
        side = after[side]
    share, away = _share(points, after, side, x, y)
    for _ in range(4 * _LOOK):
        if 0.0 < share < 1.0:
            break
        forward = share >= 1.0
        other = after[side] if forward else before[side]
        corner = -1
        if is_point[other]:
            corner = other
            other = after[other] if forward else before[other]
        there, distance = _share(points, after, other, x, y)
        if (there <= 0.0) if forward else (there >= 1.0):
            if corner >= 0:
                return corner, 0.0, away
            break
        side, share, away = other, there, distance
    return side, share, away


@njit(cache=True, error_model="numpy", nogil=True)
def _runs_along(points: Floats, after: Ints, side: int, ux: float, uy: float) -> bool:  # pragma: no cover
    """Whether a side runs more along a direction than against it; a corner does."""
    end = after[side]
    return bool((points[end, 0] - points[side, 0]) * ux + (points[end, 1] - points[side, 1]) * uy >= 0.0)


@njit(cache=True, error_model="numpy", nogil=True)
def _scan(
    points: Floats, after: Ints, is_point: Mask, low: int, high: int, x: float, y: float, ux: float, uy: float
) -> int:  # pragma: no cover
    """The side nearest to (x, y) of those from low to high that run along (ux, uy)."""
    best, found = np.inf, low
    for side in range(low, high):
        if not is_point[side] and _runs_along(points, after, side, ux, uy):
            _, away = _share(points, after, side, x, y)
            if away < best:
                best, found = away, side
    return found


@njit(cache=True, error_model="numpy", nogil=True)
def _scan_ahead(
    points: Floats, after: Ints, is_point: Mask, side: int, x: float, y: float, ux: float, uy: float, reach: float,
    slack: float,
) -> int:  # pragma: no cover  # fmt: skip
    """The first of the next sides along (ux, uy) that is as far from (x, y) as the offset is; -1 where none is."""
    for _ in range(_AHEAD):
        side = after[side]
        if not is_point[side] and _runs_along(points, after, side, ux, uy):
            share, away = _share(points, after, side, x, y)
            if 0.0 < share < 1.0 and abs(away - reach) <= slack:
                return side
    return -1


@njit(cache=True, error_model="numpy", nogil=True)
def _place(
    table: Floats, is_corner: Mask, piece: Ints, low: Floats, high: Floats, side: int, share: float,
    x: float, y: float, left: float,
) -> float:  # pragma: no cover  # fmt: skip
    """The parameter on its piece of a place on a side; on a corner, of the direction from it."""
    p = piece[side]
    if not is_corner[p]:
        return float(low[side] + share * (high[side] - low[side]))
    sense = 1.0 if left > 0.0 else -1.0
    angle = np.arctan2(sense * (y - table[p, 0, 1]), sense * (x - table[p, 0, 0])) - table[p, 1, 0]
    turn = table[p, 1, 1]
    middle = 0.5 * turn
    angle = middle + (angle - middle + np.pi) % (2.0 * np.pi) - np.pi
    return float(min(max(angle / turn, 0.0), 1.0))


@njit(cache=True, error_model="numpy", nogil=True)
def _is_one(
    table: Floats, is_corner: Mask, piece: Ints, low: Floats, high: Floats, after: Ints, left: float,
    side: int, t: float, goal: int, goal_t: float,
) -> bool:  # pragma: no cover  # fmt: skip
    """Whether the offset runs from one place on to another without turning back or about."""
    turn = 0.0
    for _ in range(_LOOK):
        end = goal_t if side == goal else high[side]
        if end > t:
            for k in range(3):
                at = t + 0.5 * k * (end - t)
                _, _, _, _, v, bend = offset_jet(table, is_corner, piece[side], at, left)
                if v <= 0.0:
                    return False
                if k == 1:
                    turn += abs(v * bend) * (end - t)
        if turn > _SAME_WAY:
            return False
        if side == goal:
            return True
        side = after[side]
        t = low[side]
    return False


@njit(cache=True, error_model="numpy", nogil=True)
def _is_joined(
    table: Floats, is_corner: Mask, piece: Ints, low: Floats, high: Floats, after: Ints, left: float,
    side: int, t: float, other: int, other_t: float,
) -> bool:  # pragma: no cover  # fmt: skip
    """Whether the offset runs from one place to the other, or from the other to the one, as `_is_one`."""
    return _is_one(table, is_corner, piece, low, high, after, left, side, t, other, other_t) or _is_one(
        table, is_corner, piece, low, high, after, left, other, other_t, side, t
    )


@njit(cache=True, error_model="numpy", nogil=True)
def _forward(
    table: Floats, is_corner: Mask, piece: int, t: float, step: float, left: float, low: int, high: int
) -> tuple[int, float]:  # pragma: no cover
    """The place a step (mm, any sign) farther along the offset, not beyond where it turns back."""
    for _ in range(_LOOK):
        _, _, _, _, v, _ = offset_jet(table, is_corner, piece, t, left)
        if v <= 0.0:
            return piece, t
        aim = t + step / v
        if 0.0 <= aim <= 1.0:
            return piece, aim
        if aim > 1.0:
            step -= (1.0 - t) * v
            other, start = (piece + 1 if piece + 1 < high else low), 0.0
        else:
            step += t * v
            other, start = (piece - 1 if piece > low else high - 1), 1.0
        _, _, _, _, v, _ = offset_jet(table, is_corner, other, start, left)
        if v <= 0.0:
            return piece, 1.0 - start
        piece, t = other, start
    return piece, t


@njit(cache=True, error_model="numpy", nogil=True)
def _meet(
    table: Floats, is_corner: Mask, left: float, p: int, t: float, p_low: int, p_high: int,
    q: int, s: float, q_low: int, q_high: int,
) -> tuple[int, float, int, float, bool]:  # pragma: no cover  # fmt: skip
    """Where two stretches of the offset cross, from places near it. Newton by lengths along both."""
    for _ in range(_NEWTON_STEPS):
        x, y, tx, ty, _, _ = offset_jet(table, is_corner, p, t, left)
        u, v, ux, uy, _, _ = offset_jet(table, is_corner, q, s, left)
        gx, gy = u - x, v - y
        if np.hypot(gx, gy) <= _MEET_MM:
            return p, t, q, s, True
        sine = tx * uy - ty * ux
        if abs(sine) < _FLAT:
            break
        most = 2.0 * abs(left)
        first = min(max((gx * uy - gy * ux) / sine, -most), most)
        second = min(max((gx * ty - gy * tx) / sine, -most), most)
        p, t = _forward(table, is_corner, p, t, first, left, p_low, p_high)
        q, s = _forward(table, is_corner, q, s, second, left, q_low, q_high)
    return p, t, q, s, False


@njit(cache=True, error_model="numpy", nogil=True)
def _sides_along(
    points: Floats, after: Ints, before: Ints, is_point: Mask, ring: Floats, span: tuple[int, int], left: float,
    slack: float,
) -> Ints:  # pragma: no cover  # fmt: skip
    """The side that every edge of a ring is the offset of, found from the edge's middle: (n,) int."""
    count, reach = len(ring), abs(left)
    sides = np.empty(count, dtype=np.int64)
    side, known = 0, False
    for k in range(count):
        j = k + 1 if k + 1 < count else 0
        x, y = 0.5 * (ring[k, 0] + ring[j, 0]), 0.5 * (ring[k, 1] + ring[j, 1])
        ux, uy = ring[j, 0] - ring[k, 0], ring[j, 1] - ring[k, 1]
        found, away = side, np.inf
        if known:
            found, _, away = _settle(points, after, before, is_point, side, x, y)
        if abs(away - reach) > slack or not _runs_along(points, after, found, ux, uy):
            ahead = _scan_ahead(points, after, is_point, side, x, y, ux, uy, reach, slack) if known else -1
            if ahead < 0:
                ahead = _scan(points, after, is_point, span[0], span[1], x, y, ux, uy)
            found, _, _ = _settle(points, after, before, is_point, ahead, x, y)
        side, known = found, True
        sides[k] = side
    return sides


@njit(cache=True, error_model="numpy", nogil=True)
def _runs_on(limits: Floats, after: Ints, left: float, side: int, goal: int) -> bool:  # pragma: no cover
    """Whether the offset runs on from one side to another near it, all sides of the way whole, none turned back."""
    turn = 0.0
    for _ in range(_NEAR):
        if left * limits[side, 0] >= 1.0 or left * limits[side, 1] >= 1.0:
            return False
        if side == goal:
            return True
        turn += limits[side, 2]
        if turn > _SAME_WAY:
            return False
        side = after[side]
    return False


@njit(cache=True, error_model="numpy", nogil=True)
def _foot(
    source: tuple[Floats, Mask, Mask, Floats, Ints, Floats, Floats, Ints, Ints, float], side: int, x: float, y: float
) -> Place:  # pragma: no cover
    """The side and parameter of the source's nearest place to (x, y) downhill from a side."""
    table, is_corner, is_point, points, piece, low, high, after, before, left = source
    found, share, _ = _settle(points, after, before, is_point, side, x, y)
    return found, _place(table, is_corner, piece, low, high, found, share, x, y, left)


@njit(cache=True, error_model="numpy", nogil=True)
def trace_ring(
    table: Floats, is_corner: Mask, points: Floats, piece: Ints, low: Floats, high: Floats, after: Ints, before: Ints,
    loop: Ints, first_piece: Ints, limits: Floats, ring: Floats, span: tuple[int, int], left: float, slack: float,
) -> tuple[Floats, bool]:  # pragma: no cover  # fmt: skip
    """The stretches of one ring in order: rows first piece, its parameter, last piece, its parameter, length (mm),
    distance (mm) of its end from the ring's vertex there.

    limits : (S, 3) of `Sides`   ring : (n, 2) float, mm, the material on its left   span : its set's sides
    left : distance to the left, mm
    slack : mm, of the polygons. A ring that is one whole loop gives one row that ends where it begins.
    Returns the rows and whether all their meeting points were found.
    """
    is_point = is_corner[piece]
    along = _sides_along(points, after, before, is_point, ring, span, left, slack)
    count, length, found, good = len(ring), 0.0, 0, True
    rows = np.zeros((count + 1, 6))
    for k in range(count):
        other = k + 1 if k + 1 < count else 0
        x, y = ring[other]
        length += np.sqrt((x - ring[k, 0]) ** 2 + (y - ring[k, 1]) ** 2)
        if _runs_on(limits, after, left, along[k], along[other]):
            continue
        far = ring[other + 1 if other + 1 < count else 0]
        feet = (table, is_corner, is_point, points, piece, low, high, after, before, left)
        a, t = _foot(feet, along[k], 0.5 * (x + ring[k, 0]), 0.5 * (y + ring[k, 1]))
        b, s = _foot(feet, along[other], 0.5 * (x + far[0]), 0.5 * (y + far[1]))
        if _is_joined(table, is_corner, piece, low, high, after, left, a, t, b, s):
            continue
        c, v = _foot(feet, along[k], x, y)
        d, w = _foot(feet, along[other], x, y)
        if not _is_joined(table, is_corner, piece, low, high, after, left, c, v, d, w):
            a, t, b, s = c, v, d, w
        own, next_loop = loop[piece[a]], loop[piece[b]]
        p, t, q, s, met = _meet(
            table, is_corner, left, piece[a], t, first_piece[own], first_piece[own + 1],
            piece[b], s, first_piece[next_loop], first_piece[next_loop + 1],
        )  # fmt: skip
        good = good and met
        px, py, _, _, _, _ = offset_jet(table, is_corner, p, t, left)
        rows[found, 2], rows[found, 3], rows[found, 4], rows[found, 5] = p, t, length, np.hypot(px - x, py - y)
        rows[found + 1, 0], rows[found + 1, 1] = q, s
        found, length = found + 1, 0.0
    if found == 0:
        start = first_piece[loop[piece[along[0]]]]
        rows[0, 0], rows[0, 2], rows[0, 4] = start, start, length
        return rows[:1], True
    rows[0, 0], rows[0, 1] = rows[found, 0], rows[found, 1]
    rows[0, 4] += length
    return rows[:found], good


@njit(cache=True, error_model="numpy", nogil=True)
def trace_rings(
    table: Floats, is_corner: Mask, points: Floats, piece: Ints, low: Floats, high: Floats, after: Ints, before: Ints,
    loop: Ints, first_piece: Ints, limits: Floats, path: Floats, first: Ints, spans: Ints, left: Floats, slack: float,
) -> tuple[Floats, Ints, Mask]:  # pragma: no cover  # fmt: skip
    """The stretches of many rings: rows (m, 6) as of `trace_ring`, first row of each ring (r+1,), whether it is whole (r,).

    path : (n, 2) float, mm, all rings' points   first : (r+1,) int   spans : (r, 2) int, the sides of each ring's set
    left : (r,) float, mm, distance to the left of each ring's source.
    """
    count = len(first) - 1
    rows = np.empty((len(path) + count, 6))
    begin = np.zeros(count + 1, dtype=np.int64)
    whole = np.zeros(count, dtype=np.bool_)
    for k in range(count):
        found, whole[k] = trace_ring(
            table, is_corner, points, piece, low, high, after, before, loop, first_piece, limits,
            path[first[k] : first[k + 1]], (spans[k, 0], spans[k, 1]), left[k], slack,
        )  # fmt: skip
        begin[k + 1] = begin[k] + len(found)
        rows[begin[k] : begin[k + 1]] = found
    return rows[: begin[count]].copy(), begin, whole
