"""How far the inner Bézier points lie along the tangents: equal speed (paper Eq. 5) or matched curvature."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.nurbs.segments import Chords

Floats = NDArray[np.float64]

_NEWTON_STEPS = 25
_CONVERGED = 1e-8  # share of the chord
_HANDLE_RANGE = (0.15, 0.7)  # share of the chord outside which a handle belongs to another branch of the solution
_SMOOTH_CHANGE = 0.5  # largest share by which curvature may differ between the ends of a piece for both to be matched


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


def matched_curvature(chords: Chords, tangent_start: Floats, tangent_end: Floats) -> tuple[Floats, Floats]:
    """Handle lengths (S,), (S,) that reproduce the data's curvature at both ends; equal speed where that fails.

    With a = P3 - P0, P1 = P0 + d0 T0, P2 = P3 - d1 T3:
    1.5 k0 d0² = T0 x a - d1 (T0 x T3), 1.5 k1 d1² = a x T3 - d0 (T0 x T3), Newton from |a|/3. Their difference is
    nearly singular: where Newton finds no small root, or curvature changes fast, d0 = d1 from their sum. A piece keeps
    equal speed where it touches a corner or open end, and where curvature changes sign.
    Source: de Boor, Höllig, Sabin, High accuracy geometric Hermite interpolation, CAGD 4 (1987).
    """
    vectors = chords.vectors
    length = np.linalg.norm(vectors, axis=1)
    third = equal_speed(vectors, tangent_start, tangent_end) / 3.0
    normal, curvature_end = _curvature_at_ends(chords)
    smooth = (chords.follows >= 0) & (chords.precedes >= 0)
    before = np.where(smooth, chords.precedes, 0)
    k0, k1 = curvature_end[before], curvature_end
    sense = np.where(np.einsum("ij,ij->i", normal[before], normal) < 0.0, -1.0, 1.0)
    k0 = k0 * sense
    cross_start = _signed(tangent_start, vectors, normal)
    cross_end = _signed(vectors, tangent_end, normal)
    cross_both = _signed(tangent_start, tangent_end, normal)
    d0, d1 = length / 3.0, length / 3.0
    change = np.full(len(length), np.inf)
    with np.errstate(all="ignore"):
        for _ in range(_NEWTON_STEPS):
            first = 1.5 * k0 * d0**2 - cross_start + d1 * cross_both
            second = 1.5 * k1 * d1**2 - cross_end + d0 * cross_both
            a, b = 3.0 * k0 * d0, 3.0 * k1 * d1
            determinant = a * b - cross_both**2
            step0 = (first * b - second * cross_both) / determinant
            step1 = (second * a - first * cross_both) / determinant
            d0, d1 = d0 - step0, d1 - step1
            change = np.maximum(np.abs(step0), np.abs(step1))
        good = smooth & (k0 * k1 > 0.0) & (change <= _CONVERGED * length)
        good &= np.abs(k0 - k1) <= _SMOOTH_CHANGE * np.maximum(np.abs(k0), np.abs(k1))
        for handle in (d0, d1):
            good &= (handle > _HANDLE_RANGE[0] * length) & (handle < _HANDLE_RANGE[1] * length)
        even = _even_handle(k0 + k1, cross_start + cross_end, cross_both)
        fair = (
            ~good & smooth & (k0 * k1 > 0.0) & (even > _HANDLE_RANGE[0] * length) & (even < _HANDLE_RANGE[1] * length)
        )
    third = np.where(fair, even, third)
    return np.where(good, d0, third), np.where(good, d1, third)


def _even_handle(bend: Floats, cross: Floats, cross_both: Floats) -> Floats:
    """The positive root of 1.5 bend d² + 2 cross_both d - cross = 0: both equations' sum with d0 = d1 = d."""
    root = np.sqrt(cross_both**2 + 1.5 * bend * cross)
    return np.asarray(cross / (cross_both + np.copysign(root, cross_both)))


def _curvature_at_ends(chords: Chords) -> tuple[Floats, Floats]:
    """Unit normal of the osculating plane (S, 3) and signed curvature (S,) at every chord's end.

    From five points: the circles through three neighbours each (before, around and after the point) give three
    values, each exact on a circle; kappa is taken as quadratic in arc length s with these as its divided differences,
    for which kappa = 1, s, s² give 1, (s0+s1+s2)/3 and (sum of si sj, i <= j)/6. Fourth order. 0 where there are no
    five smooth points.
    """
    own = np.arange(len(chords.start))
    after = chords.follows
    beyond = np.where(after >= 0, after[after], -1)
    known = (chords.precedes >= 0) & (after >= 0) & (beyond >= 0)
    before, after, beyond = (np.where(known, rows, own) for rows in (chords.precedes, after, beyond))
    vectors = _in_space(chords.vectors)
    length = np.linalg.norm(vectors, axis=1)
    follower = np.where(chords.follows >= 0, chords.follows, own)
    third_side = np.linalg.norm(vectors + vectors[follower], axis=1)
    product = np.maximum(length * length[follower] * third_side, 1e-300)
    circle = 2.0 * np.cross(vectors, vectors[follower]) / product[:, None]
    bend = np.linalg.norm(circle, axis=1)
    reach = length * (1.0 + (bend * length) ** 2 / 24.0)
    zero = np.zeros(len(own))
    places = [-reach[own] - reach[before], -reach[own], zero, reach[after], reach[after] + reach[beyond]]
    system = np.empty((len(own), 3, 3))
    for row in range(3):
        a, b, c = places[row : row + 3]
        system[:, row] = np.column_stack(
            [zero + 1.0, (a + b + c) / 3.0, (a * a + b * b + c * c + a * b + b * c + c * a) / 6.0]
        )
    scale = np.maximum(reach, 1e-300)
    system[:, :, 1] /= scale[:, None]
    system[:, :, 2] /= scale[:, None] ** 2
    system[~known] = np.eye(3)
    values = np.stack([circle[before], circle[own], circle[after]], axis=1)
    turning = np.linalg.solve(system, values)[:, 0]
    flat = np.broadcast_to([0.0, 0.0, 1.0], turning.shape)
    size = np.linalg.norm(turning, axis=1)[:, None]
    normal = np.where(size > 0.0, turning / np.where(size > 0.0, size, 1.0), flat)
    if chords.points.shape[1] == 2:
        normal = np.array(flat)
    return normal, np.where(known, np.einsum("ij,ij->i", turning, normal), 0.0)


def _in_space(vectors: Floats) -> Floats:
    return vectors if vectors.shape[1] == 3 else np.column_stack([vectors, np.zeros(len(vectors))])


def _signed(first: Floats, second: Floats, normal: Floats) -> Floats:
    return np.asarray(np.einsum("ij,ij->i", np.cross(_in_space(first), _in_space(second)), normal))
