"""How far the inner Bézier points lie along the tangents: equal speed (paper Eq. 5) or matched curvature, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.tangents import (
    ASTRAY,
    BEND_X,
    BEND_Y,
    BEND_Z,
    CHORD_X,
    CHORD_Y,
    CHORD_Z,
    FITS,
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

_NEWTON_STEPS = 4
_CONVERGED = 1e-8  # share of the chord
_HANDLE_LOW, _HANDLE_HIGH = 0.2, 0.55  # share of the chord outside which a handle is of another branch of the solution
_SURE = 1.0 / 36.0  # square of 1/6: by 12 the central differences are as long as the chord, 2 is for safety
_SMOOTH = 0.02  # how much of the square of curvature's second difference the change must exceed
_TINY = 1e-300


@njit(cache=True, error_model="numpy", nogil=True)
def _speed(square: float, along: float, length2: float) -> float:  # pragma: no cover - compiled
    """The positive root of square alpha² + 12 along alpha - 36 length2 = 0, without cancellation."""
    root = np.sqrt(along * along + square * length2)
    forward = 6.0 * length2 / (root + max(along, 0.0))
    return float(forward if along >= 0.0 else 6.0 * (root - along) / square)


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
def tangents_astray(w: Floats, count: int) -> None:  # pragma: no cover - compiled
    """ASTRAY = |T x V|² of the joints 1 ... count + 1 of a block, mm²: how far tangents may be wrong.

    w, count : as `tangents.measure_chords`, after the tangents   V = 7 (q1 + q2) - q0 - q3, twelve times the derivative
    by the point's number to fourth order. On points evenly (or smoothly) spaced along a smooth curve T and V agree;
    noise, uneven spacing, jumps of curvature and too few points part them.
    """
    for j in range(count + 1):
        x = 7.0 * (w[CHORD_X + j + 1] + w[CHORD_X + j + 2]) - w[CHORD_X + j] - w[CHORD_X + j + 3]
        y = 7.0 * (w[CHORD_Y + j + 1] + w[CHORD_Y + j + 2]) - w[CHORD_Y + j] - w[CHORD_Y + j + 3]
        z = 7.0 * (w[CHORD_Z + j + 1] + w[CHORD_Z + j + 2]) - w[CHORD_Z + j] - w[CHORD_Z + j + 3]
        tx, ty, tz = w[TANGENT_X + j + 1], w[TANGENT_Y + j + 1], w[TANGENT_Z + j + 1]
        x, y, z = ty * z - tz * y, tz * x - tx * z, tx * y - ty * x
        w[ASTRAY + j + 1] = x * x + y * y + z * z


@njit(cache=True, error_model="numpy", nogil=True)
def matched_handles(w: Floats, count: int) -> None:  # pragma: no cover - compiled
    """Handles of the chords 2 ... count + 1 that reproduce the curvature, where that is sure to be nearer to the curve.

    w, count : as `tangents.measure_chords`, after `speed_handles` and `tangents_astray`.
    With a = P3 - P0, P1 = P0 + d T0, P2 = P3 - d T3 the sum of the conditions at both ends,
    1.5 (k0 + k1) d² = T0 x a + a x T3 - 2 d (T0 x T3), has one positive root d. (Their difference, for d0 and d1 apart,
    is nearly singular: with estimated curvatures it makes the curve worse.) Cross products are taken along the sum b
    of both binormals.
    A piece and both its neighbours must change by more at the middle than (1) tangents that are as wrong as they
    disagree with central differences would move it, and (2) unresolved curvature would, which falls like the square of
    its second difference. Otherwise (uneven points, inflections, curvature that jumps, coarse or noisy points) the
    equal speed stands. Tangents that were given are believed: there only the signs and the range of handles decide.
    Source: de Boor, Hoellig, Sabin, High accuracy geometric Hermite interpolation, CAGD 4 (1987).
    """
    for j in range(count):
        length = w[LENGTH + j + 2]
        ax, ay, az = w[CHORD_X + j + 2], w[CHORD_Y + j + 2], w[CHORD_Z + j + 2]
        tx, ty, tz = w[TANGENT_X + j + 1], w[TANGENT_Y + j + 1], w[TANGENT_Z + j + 1]
        ux, uy, uz = w[TANGENT_X + j + 2], w[TANGENT_Y + j + 2], w[TANGENT_Z + j + 2]
        nx, ny, nz = w[TURN_X + j + 1], w[TURN_Y + j + 1], w[TURN_Z + j + 1]
        mx, my, mz = w[TURN_X + j + 2], w[TURN_Y + j + 2], w[TURN_Z + j + 2]
        bx, by, bz = nx + mx, ny + my, nz + mz
        square = bx * bx + by * by + bz * bz
        dx, dy, dz = tx - ux, ty - uy, tz - uz
        cross = (dy * az - dz * ay) * bx + (dz * ax - dx * az) * by + (dx * ay - dy * ax) * bz
        both = length * ((ty * uz - tz * uy) * bx + (tz * ux - tx * uz) * by + (tx * uy - ty * ux) * bz)
        root = np.sqrt(max(both * both + 1.5 * length * length * square * cross, 0.0))
        even = length * cross / max(both + root, _TINY)
        change = 0.375 * (even - w[HANDLE_START + j + 2]) * cross
        x = w[BEND_X + j] - w[BEND_X + j + 1] - w[BEND_X + j + 2] + w[BEND_X + j + 3]
        y = w[BEND_Y + j] - w[BEND_Y + j + 1] - w[BEND_Y + j + 2] + w[BEND_Y + j + 3]
        z = w[BEND_Z + j] - w[BEND_Z + j + 1] - w[BEND_Z + j + 2] + w[BEND_Z + j + 3]
        astray = max(w[ASTRAY + j + 1], w[ASTRAY + j + 2])
        fits = (nx * bx + ny * by + nz * bz > 0.0) & (mx * bx + my * by + mz * bz > 0.0)
        fits &= (even > _HANDLE_LOW * length) & (even < _HANDLE_HIGH * length)
        told = (w[GIVEN + j + 1] % 2.0 == 1.0) & (w[GIVEN + j + 2] % 2.0 == 1.0)
        fits &= told | (abs(change) > _SMOOTH * length * length * length * (x * x + y * y + z * z))
        fits &= told | (change * change > _SURE * length * length * astray * square)
        w[FITS + j + 2] = 1.0 if fits else 0.0
        w[HANDLE_END + j + 2] = even
    w[FITS + 1], w[FITS + count + 2] = 1.0, 1.0
    for j in range(count):
        fits = w[FITS + j + 1] * w[FITS + j + 2] * w[FITS + j + 3] > 0.0
        third = w[HANDLE_END + j + 2] if fits else w[HANDLE_START + j + 2]
        w[HANDLE_START + j + 2] = third
        w[HANDLE_END + j + 2] = third


@njit(cache=True, error_model="numpy", nogil=True)
def told_handles(w: Floats, count: int) -> None:  # pragma: no cover - compiled
    """Handles of the chords 2 ... count + 1 where both curvatures are given; elsewhere they stay as they are.

    w, count : as `tangents.measure_chords`, after `matched_handles`.
    1.5 k0 d0² = T0 x a - d1 (T0 x T3), 1.5 k1 d1² = a x T3 - d0 (T0 x T3), Newton from the d0 = d1 that solve their
    sum, which stand where Newton finds no root near by.
    Source: de Boor, Hoellig, Sabin, High accuracy geometric Hermite interpolation, CAGD 4 (1987).
    """
    for j in range(count):
        if w[GIVEN + j + 1] < 2.0 or w[GIVEN + j + 2] < 2.0:
            continue
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
        cross = cross0 + cross1
        even = cross / max(both + np.sqrt(max(both * both + (k0 + k1) * cross, 0.0)), _TINY)
        if not (k0 > 0.0 and k1 > 0.0 and _HANDLE_LOW < even < _HANDLE_HIGH):
            continue
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
        if not (change <= _CONVERGED and min(d0, d1) > _HANDLE_LOW and max(d0, d1) < _HANDLE_HIGH):
            d0, d1 = even, even
        w[HANDLE_START + j + 2] = d0 * length
        w[HANDLE_END + j + 2] = d1 * length
