"""How far the inner Bézier points lie along the tangents: equal speed (paper Eq. 5) or matched curvature, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.tangents import (
    BEND_X,
    BEND_Y,
    BEND_Z,
    BULGE,
    CHORD_X,
    CHORD_Y,
    CHORD_Z,
    GIVEN,
    HANDLE_END,
    HANDLE_START,
    LENGTH,
    TANGENT_X,
    TANGENT_Y,
    TANGENT_Z,
    TURN_X,
    TURN_Y,
    TURN_Z,
)

Floats = NDArray[np.float64]

_NEWTON_STEPS = 3
_CONVERGED = 1e-8  # share of the chord
_HANDLE_LOW, _HANDLE_HIGH = 0.2, 0.55  # share of the chord outside which a handle is of another branch of the solution
_SMOOTH_CHANGE = 0.5  # largest share by which curvature may differ between the ends of a piece for both to be matched
_EVEN = 0.65  # a chord that much shorter than its neighbour makes tangents and quintic doubtful
_CLEARLY = 0.9  # share of equal speed's distance from the quintic that a middle may have
_USUAL = 0.05  # ten times the error of equal speed on a circle, 0.021 (k h)² of its bulge, where k = |b| / 2
_TINY = 1e-300


@njit(cache=True, error_model="numpy", nogil=True)
def _speed(square: float, along: float, length2: float) -> float:  # pragma: no cover - compiled
    """The positive root of square alpha² + 12 along alpha - 36 length2 = 0, without cancellation."""
    root = np.sqrt(along * along + square * length2)
    forward = 6.0 * length2 / (root + max(along, 0.0))
    return forward if along >= 0.0 else 6.0 * (root - along) / square


def equal_speed(chord: Floats, tangent_start: Floats, tangent_end: Floats) -> Floats:
    """The speed alpha with |C'(0)| = |C'(1/2)| = |C'(1)| of each piece: (S,) float, mm; handles are alpha / 3.

    The positive root of (16 - |S|²) alpha² + 12 (D·S) alpha - 36 |D|² = 0, S = T0 + T3, D = P3 - P0.
    chord, tangents : (S, d) float   D in mm, unit T0 and T3.
    Source: paper Eqs. 5-7 as corrected; Piegl & Tiller Eq. 9.50.
    """
    both = tangent_start + tangent_end
    square = 16.0 - np.einsum("ij,ij->i", both, both)
    along = np.einsum("ij,ij->i", chord, both)
    length2 = np.einsum("ij,ij->i", chord, chord)
    root = np.sqrt(along**2 + square * length2)
    forward = 6.0 * length2 / np.where(along >= 0.0, root + along, 1.0)
    return np.asarray(np.where(along >= 0.0, forward, 6.0 * (root - along) / square))


@njit(cache=True, error_model="numpy", nogil=True)
def speed_handles(w: Floats, count: int) -> None:  # pragma: no cover - compiled
    """HANDLE_START = HANDLE_END = alpha / 3 of the chords 2 ... count + 1 of a block (see `equal_speed`).

    w, count : as `tangents.measure_chords`.   Source: paper Eqs. 5-7 as corrected; Piegl & Tiller Eq. 9.50.
    """
    for j in range(count):
        length = w[LENGTH + j + 2]
        x = w[TANGENT_X + j + 1] + w[TANGENT_X + j + 2]
        y = w[TANGENT_Y + j + 1] + w[TANGENT_Y + j + 2]
        z = w[TANGENT_Z + j + 1] + w[TANGENT_Z + j + 2]
        along = w[CHORD_X + j + 2] * x + w[CHORD_Y + j + 2] * y + w[CHORD_Z + j + 2] * z
        third = _speed(16.0 - (x * x + y * y + z * z), along, length * length) / 3.0
        w[HANDLE_START + j + 2] = third
        w[HANDLE_END + j + 2] = third


@njit(cache=True, error_model="numpy", nogil=True)
def _quadratic_weights(
    s0: float, s1: float, s2: float, s3: float, s4: float
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Weights of the circles through (s0, s1, s2), (s1, s2, s3), (s2, s3, s4) for the curvature at s = 0.

    kappa is quadratic in arc length with the circles as its divided differences, for which kappa = 1, s, s² give
    1, (a+b+c)/3 and (a²+b²+c²+ab+bc+ca)/6.
    """
    m0, m1, m2 = (s0 + s1 + s2) / 3.0, (s1 + s2 + s3) / 3.0, (s2 + s3 + s4) / 3.0
    v0 = (s0 * (s0 + s1 + s2) + s1 * (s1 + s2) + s2 * s2) / 6.0
    v1 = (s1 * (s1 + s2 + s3) + s2 * (s2 + s3) + s3 * s3) / 6.0
    v2 = (s2 * (s2 + s3 + s4) + s3 * (s3 + s4) + s4 * s4) / 6.0
    a, b, c = m1 * v2 - m2 * v1, m2 * v0 - m0 * v2, m0 * v1 - m1 * v0
    scale = 1.0 / (a + b + c)
    return a * scale, b * scale, c * scale


@njit(cache=True, error_model="numpy", nogil=True)
def five_point_curvatures(w: Floats, count: int) -> None:  # pragma: no cover - compiled
    """TURN_* = curvature times unit binormal at the joints 1 ... count + 1 of a block, 1/mm.

    w, count : as `tangents.measure_chords`   From the circles through three neighbours each, before, around and after
    the point: each exact on a circle, together fourth order.
    Source: the quartic through five points by finite differences.
    """
    for j in range(count + 1):
        bx, by, bz = w[BEND_X + j + 1], w[BEND_Y + j + 1], w[BEND_Z + j + 1]
        bend = (bx * bx + by * by + bz * bz) / 24.0
        a, b, c, d = w[LENGTH + j], w[LENGTH + j + 1], w[LENGTH + j + 2], w[LENGTH + j + 3]
        a, b, c, d = a + a * bend * a * a, b + b * bend * b * b, c + c * bend * c * c, d + d * bend * d * d
        before, around, after = _quadratic_weights(-a - b, -b, 0.0, c, c + d)
        w[TURN_X + j + 1] = before * w[BEND_X + j] + around * bx + after * w[BEND_X + j + 2]
        w[TURN_Y + j + 1] = before * w[BEND_Y + j] + around * by + after * w[BEND_Y + j + 2]
        w[TURN_Z + j + 1] = before * w[BEND_Z + j] + around * bz + after * w[BEND_Z + j + 2]


@njit(cache=True, error_model="numpy", nogil=True)
def quintic_bulges(w: Floats, count: int) -> None:  # pragma: no cover - compiled
    """BULGE = (a x middle)·b / |a| of the quintic through six points, for the chords a = 2 ... count + 1 of a block.

    w, count : as `tangents.measure_chords`   b : the curvature binormals TURN_* of both ends, added.
    The quintic is over arc length, which each chord tells to fourth order with that curvature; middle is where half
    of the chord's arc length is reached, from the chord's own middle.
    """
    for j in range(count):
        a, b, c, d, e = w[LENGTH + j], w[LENGTH + j + 1], w[LENGTH + j + 2], w[LENGTH + j + 3], w[LENGTH + j + 4]
        nx, ny, nz = (
            w[TURN_X + j + 1] + w[TURN_X + j + 2],
            w[TURN_Y + j + 1] + w[TURN_Y + j + 2],
            w[TURN_Z + j + 1] + w[TURN_Z + j + 2],
        )
        bend = (nx * nx + ny * ny + nz * nz) / 96.0
        ax, ay, az = w[CHORD_X + j + 2], w[CHORD_Y + j + 2], w[CHORD_Z + j + 2]
        px, py, pz = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
        y1 = -(w[CHORD_X + j + 1] * px + w[CHORD_Y + j + 1] * py + w[CHORD_Z + j + 1] * pz)
        y0 = y1 - (w[CHORD_X + j] * px + w[CHORD_Y + j] * py + w[CHORD_Z + j] * pz)
        y4 = w[CHORD_X + j + 3] * px + w[CHORD_Y + j + 3] * py + w[CHORD_Z + j + 3] * pz
        y5 = y4 + w[CHORD_X + j + 4] * px + w[CHORD_Y + j + 4] * py + w[CHORD_Z + j + 4] * pz
        h = 0.5 * (c + bend * (c * c * c))
        x1, x4 = -h - (b + bend * (b * b * b)), h + (d + bend * (d * d * d))
        x0, x5 = x1 - (a + bend * (a * a * a)), x4 + (e + bend * (e * e * e))
        g = h * h
        x14, x05, x01, x45 = x1 * x4, x0 * x5, x0 - x1, x4 - x5
        x04, x15 = x0 - x4, x1 - x5
        far0 = x14 * x5 / ((x0 * x0 - g) * x01 * x04 * (x0 - x5))
        far1 = x05 * x4 / ((g - x1 * x1) * x01 * (x1 - x4) * x15)
        far4 = x05 * x1 / ((x4 * x4 - g) * x04 * (x1 - x4) * x45)
        far5 = x14 * x0 / ((g - x5 * x5) * (x0 - x5) * x15 * x45)
        w[BULGE + j + 2] = -g * (y0 * far0 + y1 * far1 + y4 * far4 + y5 * far5) / c


@njit(cache=True, error_model="numpy", nogil=True)
def matched_handles(w: Floats, count: int) -> None:  # pragma: no cover - compiled
    """Handle lengths of the chords 2 ... count + 1 that reproduce TURN_* at both ends; elsewhere they stay as they are.

    w, count : as `tangents.measure_chords`, after `speed_handles` and `quintic_bulges`.
    With a = P3 - P0, P1 = P0 + d0 T0, P2 = P3 - d1 T3:
    1.5 k0 d0² = T0 x a - d1 (T0 x T3), 1.5 k1 d1² = a x T3 - d0 (T0 x T3), Newton from the even handles d0 = d1 that
    solve their sum. Their difference is nearly singular: where Newton finds no small root the even ones stand.
    A piece takes either only where its middle then lies nearer to the quintic through six points of the data,
    or within ten times the error that equal speed makes on a circle, or where both curvatures are given; otherwise
    (uneven points, inflections, curvature that jumps, coarse or noisy points) it keeps equal speed. All cross products
    are taken along the sum of both ends' binormals.
    Source: de Boor, Höllig, Sabin, High accuracy geometric Hermite interpolation, CAGD 4 (1987).
    """
    for j in range(count):
        length = w[LENGTH + j + 2]
        ax, ay, az = w[CHORD_X + j + 2], w[CHORD_Y + j + 2], w[CHORD_Z + j + 2]
        tx, ty, tz = w[TANGENT_X + j + 1], w[TANGENT_Y + j + 1], w[TANGENT_Z + j + 1]
        ux, uy, uz = w[TANGENT_X + j + 2], w[TANGENT_Y + j + 2], w[TANGENT_Z + j + 2]
        nx, ny, nz = w[TURN_X + j + 1], w[TURN_Y + j + 1], w[TURN_Z + j + 1]
        mx, my, mz = w[TURN_X + j + 2], w[TURN_Y + j + 2], w[TURN_Z + j + 2]
        bx, by, bz = nx + mx, ny + my, nz + mz
        k0 = 1.5 * length * length * (nx * bx + ny * by + nz * bz)
        k1 = 1.5 * length * length * (mx * bx + my * by + mz * bz)
        cross0 = (ty * az - tz * ay) * bx + (tz * ax - tx * az) * by + (tx * ay - ty * ax) * bz
        cross1 = (ay * uz - az * uy) * bx + (az * ux - ax * uz) * by + (ax * uy - ay * ux) * bz
        both = length * ((ty * uz - tz * uy) * bx + (tz * ux - tx * uz) * by + (tx * uy - ty * ux) * bz)
        total, cross = k0 + k1, cross0 + cross1
        even = cross / max(both + np.sqrt(max(both * both + total * cross, 0.0)), _TINY)
        d0, d1, change = even, even, 1.0
        for _ in range(_NEWTON_STEPS):
            first = k0 * d0 * d0 - cross0 + d1 * both
            second = k1 * d1 * d1 - cross1 + d0 * both
            a, b = 2.0 * k0 * d0, 2.0 * k1 * d1
            scale = 1.0 / (a * b - both * both)
            step0 = (first * b - second * both) * scale
            step1 = (second * a - first * both) * scale
            d0, d1 = d0 - step0, d1 - step1
            change = max(abs(step0), abs(step1))
        goal, speed = w[BULGE + j + 2], w[HANDLE_START + j + 2] / length
        bulge = 0.375 * speed * cross
        usual = _USUAL * length * length * (bx * bx + by * by + bz * bz) * abs(bulge)
        before, after = w[LENGTH + j + 1], w[LENGTH + j + 3]
        told = (w[GIVEN + j + 1] >= 2.0) & (w[GIVEN + j + 2] >= 2.0)
        limit = np.inf if told else max(_CLEARLY * abs(bulge - goal), usual)
        similar = (k0 > 0.0) & (k1 > 0.0) & (abs(k0 - k1) <= _SMOOTH_CHANGE * max(k0, k1))
        similar &= told | (min(min(before, after), length) >= _EVEN * max(max(before, after), length))
        fair = similar & (even > _HANDLE_LOW) & (even < _HANDLE_HIGH) & (abs(0.375 * even * cross - goal) < limit)
        good = similar & (change <= _CONVERGED) & (min(d0, d1) > _HANDLE_LOW) & (max(d0, d1) < _HANDLE_HIGH)
        good &= abs(0.375 * (d0 * cross0 + d1 * cross1) - goal) < limit
        d0 = d0 if good else (even if fair else speed)
        d1 = d1 if good else (even if fair else speed)
        w[HANDLE_START + j + 2] = d0 * length
        w[HANDLE_END + j + 2] = d1 * length
