"""Chords of a stretch of contour points and the tangents at its points (paper Eqs. 2-4), compiled.

A block is a flat table of ROW slots per quantity. Slots 0 and 1 and the two behind the last point hold the neighbours
that the formulas look at: the next points of the contour, or those by which a free end is extended. Joint j lies
between the chords j and j + 1. Quantities lie at fixed distances, what is computed before what it is computed from:
so the compiler knows that no loop reads what it wrote, and uses vector instructions.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ROW = 128  # slots of one quantity: the whole table stays in the first-level cache
FIRST = 2  # slot of the first chord of the stretch
LONGEST = ROW - 8  # chords of one block, four more where a run ends soon after

HANDLE_START, HANDLE_END, FITS = 0, ROW, 2 * ROW
TURN_X, TURN_Y, TURN_Z, GIVEN = 3 * ROW, 4 * ROW, 5 * ROW, 6 * ROW
ASTRAY = 7 * ROW
TANGENT_X, TANGENT_Y, TANGENT_Z, CUSP = 8 * ROW, 9 * ROW, 10 * ROW, 11 * ROW
BEND_X, BEND_Y, BEND_Z, AREA, PRODUCT = 12 * ROW, 13 * ROW, 14 * ROW, 15 * ROW, 16 * ROW
CHORD_X, CHORD_Y, CHORD_Z, LENGTH = 17 * ROW, 18 * ROW, 19 * ROW, 20 * ROW
POINT_X, POINT_Y, POINT_Z = 21 * ROW, 22 * ROW, 23 * ROW
QUANTITIES = 24

COLLINEAR = 1e-10  # sine of an angle below which neighbouring chords count as one straight line
CUSP_SHARE = 1e-7  # share of the chords that must be left of V for it to have a direction
STRAIGHT = 5.0  # a chord this much longer than its neighbour is a flat side, not a step along a curved one
UNEVEN = 2.0  # an end chord this much shorter than its neighbour makes q0 = 2 q1 - q2 turn round
_TINY = 1e-300


@njit(cache=True, error_model="numpy", nogil=True)
def measure_chords(w: Floats, count: int) -> None:  # pragma: no cover - compiled
    """The q of paper Eq. 2 with their lengths, and at every joint the circle through three points.

    w : (QUANTITIES * ROW,) float, mm   POINT_* are given; CHORD_*, LENGTH, BEND_*, AREA, PRODUCT are written.
    count : chords of the stretch   BEND is the curvature times the unit normal of the circle's plane, 1/mm.
    A flat side counts in the AREA of Eq. 4 with no more than its neighbour's length, as if densified to it.
    """
    for j in range(count + 4):
        x = w[POINT_X + j + 1] - w[POINT_X + j]
        y = w[POINT_Y + j + 1] - w[POINT_Y + j]
        z = w[POINT_Z + j + 1] - w[POINT_Z + j]
        w[CHORD_X + j] = x
        w[CHORD_Y + j] = y
        w[CHORD_Z + j] = z
        w[LENGTH + j] = np.sqrt(x * x + y * y + z * z)
    for j in range(count + 3):
        ax, ay, az, a = w[CHORD_X + j], w[CHORD_Y + j], w[CHORD_Z + j], w[LENGTH + j]
        bx, by, bz, b = w[CHORD_X + j + 1], w[CHORD_Y + j + 1], w[CHORD_Z + j + 1], w[LENGTH + j + 1]
        cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        sx, sy, sz = ax + bx, ay + by, az + bz
        longer, shorter = max(a, b), min(a, b)
        share = shorter / max(longer, _TINY) if longer >= STRAIGHT * shorter else 1.0
        w[AREA + j] = share * np.sqrt(cx * cx + cy * cy + cz * cz)
        w[PRODUCT + j] = share * a * b
        scale = 2.0 / max(a * b * np.sqrt(sx * sx + sy * sy + sz * sz), _TINY)
        w[BEND_X + j] = scale * cx
        w[BEND_Y + j] = scale * cy
        w[BEND_Z + j] = scale * cz


@njit(cache=True, error_model="numpy", nogil=True)
def five_point_tangents(w: Floats, count: int) -> None:  # pragma: no cover - compiled
    """Unit tangents at the joints 1 ... count + 1 of a block, and where they have no direction.

    w, count : as `measure_chords`, which comes before   TANGENT_* and CUSP (1 or 0) are written.
    Where the denominator of Eq. 4 vanishes (straight runs) the weight is 1/2. Beside a chord five times longer than
    the next the tangent is that chord's, as if it had been densified (Eq. 13): a flat side stays flat where it runs
    into an arc.
    Source: paper Eqs. 3, 4; Piegl & Tiller Eqs. 9.28-9.31.
    """
    for j in range(count + 1):
        a, b = w[LENGTH + j + 1], w[LENGTH + j + 2]
        total = w[AREA + j] + w[AREA + j + 2]
        straight = total <= COLLINEAR * (w[PRODUCT + j] + w[PRODUCT + j + 2])
        share = w[AREA + j] / (1.0 if straight else total)
        share = 0.5 if straight else share
        rest = 1.0 - share
        floor = CUSP_SHARE * (rest * a + share * b)
        before, after = a >= STRAIGHT * b, b >= STRAIGHT * a
        x = rest * w[CHORD_X + j + 1] + share * w[CHORD_X + j + 2]
        y = rest * w[CHORD_Y + j + 1] + share * w[CHORD_Y + j + 2]
        z = rest * w[CHORD_Z + j + 1] + share * w[CHORD_Z + j + 2]
        is_cusp = x * x + y * y + z * z <= floor * floor
        rest = 1.0 if before else (0.0 if after else rest)
        share = 0.0 if before else (1.0 if after else share)
        x = rest * w[CHORD_X + j + 1] + share * w[CHORD_X + j + 2]
        y = rest * w[CHORD_Y + j + 1] + share * w[CHORD_Y + j + 2]
        z = rest * w[CHORD_Z + j + 1] + share * w[CHORD_Z + j + 2]
        scale = 1.0 / max(np.sqrt(x * x + y * y + z * z), _TINY)
        w[TANGENT_X + j + 1] = scale * x
        w[TANGENT_Y + j + 1] = scale * y
        w[TANGENT_Z + j + 1] = scale * z
        w[CUSP + j + 1] = 1.0 if is_cusp else 0.0


@njit(cache=True, error_model="numpy", nogil=True)
def free_end_tangent(w: Floats, joint: int, own: int, other: int, is_alone: bool) -> None:  # pragma: no cover
    """The tangent at a free end: joint `joint`, chord `own` there, `other` the next inwards.

    With q0 = 2 q1 - q2 both areas of Eq. 4 are equal, so V = 3/2 q1 - 1/2 q2. Where q2 is much longer than q1 the
    same rule by chord length (the parabola through the three points) takes its place.
    """
    a, b = w[LENGTH + own], w[LENGTH + other]
    mine, theirs = 1.5, -0.5
    if b > UNEVEN * a:
        mine, theirs = 1.0 / a + 1.0 / (a + b), -a / (b * (a + b))
    if is_alone:
        mine, theirs = 1.0, 0.0
    x = mine * w[CHORD_X + own] + theirs * w[CHORD_X + other]
    y = mine * w[CHORD_Y + own] + theirs * w[CHORD_Y + other]
    z = mine * w[CHORD_Z + own] + theirs * w[CHORD_Z + other]
    scale = 1.0 / np.sqrt(x * x + y * y + z * z)
    w[TANGENT_X + joint], w[TANGENT_Y + joint], w[TANGENT_Z + joint] = scale * x, scale * y, scale * z


@njit(cache=True, error_model="numpy", nogil=True)
def mirrored_tangent(w: Floats, joint: int, chord: int, known: int) -> None:  # pragma: no cover - compiled
    """The tangent at one end of the circular arc over a chord whose tangent at the joint `known` is given."""
    x, y, z = w[CHORD_X + chord], w[CHORD_Y + chord], w[CHORD_Z + chord]
    tx, ty, tz = w[TANGENT_X + known], w[TANGENT_Y + known], w[TANGENT_Z + known]
    twice = 2.0 * (tx * x + ty * y + tz * z) / (x * x + y * y + z * z)
    w[TANGENT_X + joint] = twice * x - tx
    w[TANGENT_Y + joint] = twice * y - ty
    w[TANGENT_Z + joint] = twice * z - tz
