"""Tangents at contour points from their neighbours (paper Eqs. 2-4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.nurbs.segments import Chords, Mask

Floats = NDArray[np.float64]

_COLLINEAR = 1e-10  # sine of an angle below which neighbouring chords count as one straight line
_CUSP = 1e-7  # share of the chords that must be left of V for it to have a direction
_STRAIGHT = 5.0  # a chord this much longer than its neighbour is a flat side, not a step along a curved one
_UNEVEN = 2.0  # an end chord this much shorter than its neighbour makes q0 = 2 q1 - q2 turn round


def five_point_tangents(chords: Chords) -> tuple[Floats, Floats, Chords]:
    """Unit tangents at both ends of every chord, and the chords with cusps taken apart.

    Closed contours look at their neighbours cyclically; runs between corners or open ends are extended by
    q0 = 2 q1 - q2, q-1 = 2 q0 - q1 and likewise at the far end. Where the denominator of Eq. 4 vanishes (straight
    runs) the weight is 1/2. A contour that reverses at a point has no tangent there: it is broken like at a corner.
    Beside a chord five times longer than the next the tangent is that chord's, as if it had been densified (Eq. 13):
    a flat side stays flat where it runs into an arc. Known tangents take the place of Eq. 4's; the free end of a
    chord whose other end is known is that of a circle.
    Returns (start (S, d) unit, end (S, d) unit, chords).
    Source: paper Eqs. 2-4; Piegl & Tiller Eqs. 9.28-9.31.
    """
    vectors = chords.vectors
    known = chords.tangents[chords.end]
    is_known = np.isfinite(known[:, 0]) & (chords.follows >= 0)
    for _ in range(2):
        joint, cusps = _joint_directions(vectors, chords)
        cusps &= ~is_known
        if not cusps.any():
            break
        chords = chords.broken_at(cusps | (chords.follows < 0))
    joint = _along_straight_sides(joint, vectors, chords)
    joint[is_known] = known[is_known]
    at_start, at_end = np.empty_like(vectors), np.empty_like(vectors)
    free_start, free_end = np.flatnonzero(chords.precedes < 0), np.flatnonzero(chords.follows < 0)
    at_start[free_start] = _end_directions(vectors, free_start, chords.follows[free_start])
    at_end[free_end] = _end_directions(vectors, free_end, chords.precedes[free_end])
    if is_known.any():
        mirrored_start = np.flatnonzero(is_known & (chords.precedes < 0))
        at_start[mirrored_start] = _mirrored(known[mirrored_start], vectors[mirrored_start])
        before = np.where(chords.precedes >= 0, chords.precedes, 0)
        mirrored_end = np.flatnonzero((chords.follows < 0) & (chords.precedes >= 0) & is_known[before])
        at_end[mirrored_end] = _mirrored(known[before[mirrored_end]], vectors[mirrored_end])
    goes_on = np.flatnonzero(chords.follows >= 0)
    at_end[goes_on] = joint[goes_on]
    at_start[chords.follows[goes_on]] = joint[goes_on]
    return _unit(at_start), _unit(at_end), chords


def _joint_directions(vectors: Floats, chords: Chords) -> tuple[Floats, Mask]:
    """V of Eq. 3 at the end of every chord that goes on, and which of them vanish.

    A flat side counts in the areas of Eq. 4 with no more than its neighbour's length, as if densified to it.
    """
    follows, precedes = chords.follows, chords.precedes
    goes_on = follows >= 0
    after = np.where(goes_on, follows, 0)
    length = _length(vectors)
    shorter, longer = np.minimum(length, length[after]), np.maximum(length, length[after])
    share = np.where(longer >= _STRAIGHT * shorter, shorter / longer, 1.0)
    area = np.where(goes_on, share * _cross_length(vectors, vectors[after]), 0.0)
    product = share * length * length[after]
    before = np.where(precedes >= 0, precedes, np.arange(len(vectors)))
    beyond = np.where(goes_on[after], after, np.arange(len(vectors)))
    area_before, area_beyond = area[before], area[beyond]
    total = area_before + area_beyond
    straight = total <= _COLLINEAR * (product[before] + product[beyond])
    weight = np.where(straight, 0.5, area_before / np.where(straight, 1.0, total))[:, None]
    directions = (1.0 - weight) * vectors + weight * vectors[after]
    reach = (1.0 - weight[:, 0]) * length + weight[:, 0] * length[after]
    cusps = goes_on & (_length(directions) <= _CUSP * reach)
    return directions, cusps


def _along_straight_sides(joint: Floats, vectors: Floats, chords: Chords) -> Floats:
    """V of Eq. 3 with the long chord's own direction wherever a chord meets a much shorter one."""
    length = _length(vectors)
    after = np.where(chords.follows >= 0, chords.follows, np.arange(len(vectors)))
    joint = np.where((length >= _STRAIGHT * length[after])[:, None], vectors, joint)
    return np.where((length[after] >= _STRAIGHT * length)[:, None], vectors[after], joint)


def _end_directions(vectors: Floats, outer: NDArray[np.intp], inner: NDArray[np.intp]) -> Floats:
    """V at the free end of the chords `outer`, from the chords `inner` on their other side (-1: none, straight).

    With q0 = 2 q1 - q2 both areas of Eq. 4 are equal, so V = 3/2 q1 - 1/2 q2. Where q2 is much longer than q1 the
    same rule by chord length (the parabola through the three points) takes its place.
    """
    has_inner = inner >= 0
    own, other = vectors[outer], vectors[np.where(has_inner, inner, 0)]
    own_length, other_length = _length(own)[:, None], _length(other)[:, None]
    printed = 1.5 * own - 0.5 * other
    own_slope = own / own_length
    parabola = own_slope - (other / other_length - own_slope) * own_length / (own_length + other_length)
    directions = np.where(other_length <= _UNEVEN * own_length, printed, parabola)
    return np.where(has_inner[:, None], directions, own)


def _mirrored(tangents: Floats, vectors: Floats) -> Floats:
    """The tangent at the other end of the circular arc over each chord."""
    share = np.einsum("ij,ij->i", tangents, vectors) / np.einsum("ij,ij->i", vectors, vectors)
    return np.asarray(2.0 * share[:, None] * vectors - tangents)


def _cross_length(first: Floats, second: Floats) -> Floats:
    if first.shape[1] == 2:
        return np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    return _length(np.cross(first, second))


def _length(vectors: Floats) -> Floats:
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / _length(vectors)[:, None])
