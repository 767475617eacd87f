"""Distance of two convex shapes (Gilbert, Johnson, Keerthi 1988; sub-distances after Ericson, Real-Time Collision Detection, ch. 5)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.machine.shapes import support

Array = NDArray[np.float64]

GAP_MM = 1e-4  # the distance is exact to this
ROUNDS = 128
DIRECTIONS = 192  # tried for the least way out of an overlap, before the best are followed down
FOLLOWED = 3
FIRST_TURN, FINEST_TURN = 0.1, 1e-4  # rad
TURNS = 60  # of one way down, at most
GOLDEN_ANGLE = 2.399963229728653


@njit(cache=True, nogil=True)
def turned(pose: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A direction through a (3, 4) pose."""
    return (
        pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z,
        pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z,
        pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z,
    )


@njit(cache=True, nogil=True)
def turned_back(pose: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A direction through the inverse of a (3, 4) pose."""
    return (
        pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z,
        pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z,
        pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z,
    )


@njit(cache=True, nogil=True)
def apart(
    kind_a: int, size_a: Array, a0: int, a1: int, kind_b: int, size_b: Array, b0: int, b1: int,
    vertices: Array, pose: Array, d: Array, out: Array,
) -> None:  # fmt: skip
    """Farthest point of A along d minus that of B against d, into out[0:3]; A's own point into out[3:6]. pose : (3, 4), A's frame from B's."""
    ax, ay, az = support(kind_a, size_a, vertices, a0, a1, d[0], d[1], d[2])
    ex, ey, ez = turned_back(pose, -d[0], -d[1], -d[2])
    px, py, pz = support(kind_b, size_b, vertices, b0, b1, ex, ey, ez)
    bx, by, bz = turned(pose, px, py, pz)
    out[0], out[1], out[2] = ax - bx - pose[0, 3], ay - by - pose[1, 3], az - bz - pose[2, 3]
    out[3], out[4], out[5] = ax, ay, az


@njit(cache=True, nogil=True)
def _dot(a: Array, b: Array) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@njit(cache=True, nogil=True)
def _towards(points: Array, i: int, j: int, k: int) -> float:
    """The way from i to j times the way from k to the origin."""
    return -float(
        (points[j, 0] - points[i, 0]) * points[k, 0] + (points[j, 1] - points[i, 1]) * points[k, 1] + (points[j, 2] - points[i, 2]) * points[k, 2]
    )


@njit(cache=True, nogil=True)
def _size2(points: Array, weights: Array) -> float:
    """Squared distance from the origin of the weighted mean of four points."""
    total = 0.0
    for d in range(3):
        mean = weights[0] * points[0, d] + weights[1] * points[1, d] + weights[2] * points[2, d] + weights[3] * points[3, d]
        total += mean * mean
    return total


@njit(cache=True, nogil=True)
def _segment(points: Array, weights: Array, i: int, j: int) -> None:
    """Weights of the point of the segment ij that is nearest to the origin."""
    ahead, behind = _towards(points, i, j, i), _towards(points, i, j, j)
    share = min(1.0, max(0.0, ahead / (ahead - behind))) if ahead > behind else 0.0
    weights[i], weights[j] = 1.0 - share, share


@njit(cache=True, nogil=True)
def _triangle(points: Array, weights: Array, i: int, j: int, k: int) -> None:
    """Weights of the point of the triangle ijk that is nearest to the origin; the other weights become 0."""
    d1, d2 = _towards(points, i, j, i), _towards(points, i, k, i)
    d3, d4 = _towards(points, i, j, j), _towards(points, i, k, j)
    d5, d6 = _towards(points, i, j, k), _towards(points, i, k, k)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    weights[:] = 0.0
    if va > 0.0 and vb > 0.0 and vc > 0.0:
        total = va + vb + vc
        weights[i], weights[j], weights[k] = va / total, vb / total, vc / total
        return
    best = np.inf
    trial, kept = np.zeros(4), np.zeros(4)
    for side in range(3):
        p = j if side == 1 else i
        q = j if side == 0 else k
        trial[:] = 0.0
        _segment(points, trial, p, q)
        size2 = _size2(points, trial)
        if size2 < best:
            best = size2
            kept[:] = trial
    weights[:] = kept


@njit(cache=True, nogil=True)
def _is_beyond(points: Array, i: int, j: int, k: int, other: int) -> bool:
    """Whether the origin and the fourth corner lie on different sides of the face ijk (or all in one plane)."""
    ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
    bx, by, bz = points[j, 0] - ax, points[j, 1] - ay, points[j, 2] - az
    cx, cy, cz = points[k, 0] - ax, points[k, 1] - ay, points[k, 2] - az
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    here = -(ax * nx + ay * ny + az * nz)
    there = (points[other, 0] - ax) * nx + (points[other, 1] - ay) * ny + (points[other, 2] - az) * nz
    return bool(here * there <= 0.0)


@njit(cache=True, nogil=True)
def _nearest(points: Array, count: int, weights: Array) -> bool:
    """Weights (4,) of the simplex' point nearest to the origin; True if the origin is inside a tetrahedron."""
    weights[:] = 0.0
    if count == 1:
        weights[0] = 1.0
    elif count == 2:
        _segment(points, weights, count - 2, count - 1)
    elif count == 3:
        _triangle(points, weights, count - 3, count - 2, count - 1)
    else:
        best = np.inf
        trial = np.zeros(4)
        for face in range(4):
            i, j, k = (face + 1) % 4, (face + 2) % 4, (face + 3) % 4
            if not _is_beyond(points, i, j, k, face):
                continue
            _triangle(points, trial, i, j, k)
            size2 = _size2(points, trial)
            if size2 < best:
                best = size2
                weights[:] = trial
        return bool(best == np.inf)
    return False


@njit(cache=True, nogil=True)
def _keep(points: Array, weights: Array, count: int, v: Array, at: Array) -> int:
    """Drop the corners without weight; v and at become the weighted means. -> corners that stay"""
    kept = 0
    v[:] = 0.0
    at[:] = 0.0
    for n in range(count):
        if weights[n] > 0.0:
            for d in range(6):
                points[kept, d] = points[n, d]
            for d in range(3):
                v[d] += weights[n] * points[n, d]
                at[d] += weights[n] * points[n, 3 + d]
            kept += 1
    for n in range(kept, 4):
        weights[n] = 0.0
        for d in range(6):
            points[n, d] = 0.0
    return kept


@njit(cache=True, nogil=True)
def distance(
    kind_a: int, size_a: Array, a0: int, a1: int, kind_b: int, size_b: Array, b0: int, b1: int,
    vertices: Array, pose: Array, enough: float, at: Array,
) -> float:  # fmt: skip
    """Distance of two convex shapes, mm, 0 when they overlap; never more than the true one, and at most GAP_MM less.

    kind, size, first and last vertex of A and of B; pose : (3, 4)   A's frame from B's
    enough : mm   Stops at a lower bound above this.
    at : (3,)   Gets the point of A that is nearest, A's frame.
    """
    points = np.zeros((4, 6))
    weights = np.zeros(4)
    v = np.array([-pose[0, 3], -pose[1, 3], -pose[2, 3]])
    if _dot(v, v) == 0.0:
        v[0] = 1.0
    count = 0
    new, away = np.zeros(6), np.zeros(3)
    bound = 0.0
    before = np.inf
    for _ in range(ROUNDS):
        for d in range(3):
            away[d] = -v[d]
        apart(kind_a, size_a, a0, a1, kind_b, size_b, b0, b1, vertices, pose, away, new)
        length = np.sqrt(_dot(v, v))
        bound = max(bound, _dot(v, new) / length)
        if count and (length - bound <= GAP_MM or length >= before - 1e-13):
            break
        before = length if count else np.inf
        if bound > enough:
            for d in range(3):
                at[d] = new[3 + d]
            return float(bound)
        for d in range(6):
            points[count, d] = new[d]
        count += 1
        if _nearest(points, count, weights):
            return 0.0
        count = _keep(points, weights, count, v, at)
        if _dot(v, v) < 1e-16:
            return 0.0
    return max(0.0, bound)


@njit(cache=True, nogil=True)
def overlap(
    kind_a: int, size_a: Array, a0: int, a1: int, kind_b: int, size_b: Array, b0: int, b1: int,
    vertices: Array, pose: Array, allowed: float, at: Array,
) -> float:  # fmt: skip
    """How deep two convex shapes are in each other: the least way that parts them, mm (0 or less: they are apart).

    allowed : mm   Any way not longer than this will do.
    The way is sought over directions spread evenly, and followed down from the best ones. at : (3,)   Gets the deepest point, A's frame.
    """
    ways, tried = np.empty((DIRECTIONS + 12, 3)), np.empty(DIRECTIONS + 12)
    out, way, trial, kept = np.zeros(6), np.zeros(3), np.zeros(3), np.zeros(3)
    _directions(pose, ways)
    for n in range(len(ways)):
        apart(kind_a, size_a, a0, a1, kind_b, size_b, b0, b1, vertices, pose, ways[n], out)
        tried[n] = _dot(ways[n], out)
    best = np.inf
    followed = FOLLOWED if tried.min() > allowed else 1
    for _ in range(followed):
        start = int(np.argmin(tried))
        way[:] = ways[start]
        depth, turn = tried[start], FIRST_TURN if followed > 1 else 0.0
        tried[start] = np.inf
        for _ in range(TURNS):
            if turn < FINEST_TURN:
                break
            before = depth
            for axis in range(6):
                trial[:] = way
                trial[axis // 2] += turn * (1.0 - 2.0 * (axis % 2))
                length = np.sqrt(_dot(trial, trial))
                for d in range(3):
                    trial[d] /= length
                apart(kind_a, size_a, a0, a1, kind_b, size_b, b0, b1, vertices, pose, trial, out)
                here = _dot(trial, out)
                if here < depth:
                    depth = here
                    way[:] = trial
            if depth == before:
                turn *= 0.5
        if depth < best:
            best = depth
            kept[:] = way
    _deepest(kind_a, size_a, a0, a1, kind_b, size_b, b0, b1, vertices, pose, kept, at)
    return float(best)


@njit(cache=True, nogil=True)
def _deepest(
    kind_a: int, size_a: Array, a0: int, a1: int, kind_b: int, size_b: Array, b0: int, b1: int,
    vertices: Array, pose: Array, way: Array, at: Array,
) -> None:  # fmt: skip
    """The deepest point along the least way out, A's frame: of the shape whose point there is the more certain (a corner against a face)."""
    found, trial, out = np.zeros((4, 6)), np.zeros(3), np.zeros(6)
    for n in range(4):
        for d in range(3):
            trial[d] = way[d] + (FINEST_TURN if n == d or (n == 3) else 0.0) - 0.5 * FINEST_TURN
        apart(kind_a, size_a, a0, a1, kind_b, size_b, b0, b1, vertices, pose, trial, out)
        for d in range(3):
            found[n, d], found[n, 3 + d] = out[3 + d], out[3 + d] - out[d]
    spread_a, spread_b = 0.0, 0.0
    for d in range(3):
        spread_a += found[:, d].max() - found[:, d].min()
        spread_b += found[:, 3 + d].max() - found[:, 3 + d].min()
    first = 0 if spread_a <= spread_b else 3
    for d in range(3):
        at[d] = found[:, first + d].mean()


@njit(cache=True, nogil=True)
def _directions(pose: Array, ways: Array) -> None:
    """Unit vectors spread evenly, and both ways along the axes of the two frames."""
    even = len(ways) - 12
    for n in range(even):
        z = 1.0 - (2.0 * n + 1.0) / even
        across = np.sqrt(1.0 - z * z)
        ways[n, 0], ways[n, 1], ways[n, 2] = np.cos(n * GOLDEN_ANGLE) * across, np.sin(n * GOLDEN_ANGLE) * across, z
    for n in range(6):
        axis, sign = n // 2, 1.0 - 2.0 * (n % 2)
        for d in range(3):
            ways[even + n, d] = sign if d == axis else 0.0
            ways[even + 6 + n, d] = sign * pose[d, axis]
