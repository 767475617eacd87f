"""The chords between contour points, and which chord follows which smoothly: many contours in one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import FitError

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

DUPLICATE_MM = 1e-9  # points closer than this are one point: far below what an STL's float32 can tell at 1 mm


@dataclass(frozen=True)
class Chords:
    """All chords of all contours, in order.

    points   : (N, d) float, mm   The distinct points of all contours, one contour after the other.
    start    : (S,) int           Index of each chord's first point.
    end      : (S,) int           Index of its last point.
    follows  : (S,) int           The chord that goes on smoothly from its end, or -1 at corners and open ends.
    precedes : (S,) int           The chord from which its start goes on smoothly, or -1.
    contour  : (S,) int           The contour that it belongs to.
    tangents : (N, d) float       Known unit tangents at the points, NaN where they are not known.
    """

    points: Floats
    start: Indices
    end: Indices
    follows: Indices
    precedes: Indices
    contour: Indices
    tangents: Floats

    @property
    def vectors(self) -> Floats:
        """(S, d) float, mm   The chords as vectors: the q of paper Eq. 2."""
        return self.points[self.end] - self.points[self.start]

    def broken_at(self, joints: Mask) -> Chords:
        """The same chords with no smooth way on from the marked ones ((S,) bool)."""
        follows = np.where(joints, -1, self.follows)
        return replace(self, follows=follows, precedes=_inverse(follows))


def chain_chords(
    contours: Sequence[ArrayLike],
    closed: Sequence[bool],
    corners: Sequence[ArrayLike | None],
    tangents: Sequence[ArrayLike | None],
) -> Chords:
    """The chords of the contours, consecutive equal points dropped.

    contours : (n_i, d) float, mm, d = 2 or 3   A closed one may repeat its first point at its end.
    corners  : per contour a (n_i,) bool mask, indices, or None
    tangents : per contour (n_i, d) float, any length, NaN rows where not known, or None
    Raises FitError if a point is not finite, flags or tangents do not match the points, or fewer than 2 distinct
    points (closed: 3) remain; says which contour.
    """
    arrays = [_checked(points, index) for index, points in enumerate(contours)]
    if len({array.shape[1] for array in arrays}) > 1:
        raise FitError("contours of 2 and of 3 dimensions cannot be fitted in one call")
    masks = [_corner_mask(mask, len(array), i) for i, (mask, array) in enumerate(zip(corners, arrays, strict=True))]
    known = [_unit_tangents(given, array, i) for i, (given, array) in enumerate(zip(tangents, arrays, strict=True))]
    points, corner, directions = np.concatenate(arrays), np.concatenate(masks), np.concatenate(known)
    owner = np.repeat(np.arange(len(arrays)), [len(array) for array in arrays])
    is_closed = np.asarray(closed, dtype=bool)
    stays, corner = _duplicates_dropped(points, corner, owner, is_closed)
    points, corner, owner, directions = points[stays], corner[stays], owner[stays], directions[stays]
    counts = np.bincount(owner, minlength=len(arrays))
    few = np.flatnonzero(counts < np.where(is_closed, 3, 2))
    if few.size:
        kind, least = ("closed", 3) if is_closed[few[0]] else ("open", 2)
        raise FitError(
            f"contour {few[0]} has {counts[few[0]]} distinct points; {kind} ones need {least}",
            "drop it or slice elsewhere",
        )
    first = np.cumsum(counts) - counts
    last = first + counts - 1
    start = np.flatnonzero(is_closed[owner] | (np.arange(len(points)) != last[owner]))
    end = np.where(start == last[owner[start]], first[owner[start]], start + 1)
    chord_from = np.full(len(points), -1, dtype=np.intp)
    chord_from[start] = np.arange(len(start))
    follows = np.where(corner[end], -1, chord_from[end])
    return Chords(points, start, end, follows, _inverse(follows), owner[start], directions)


def _checked(points: ArrayLike, index: int) -> Floats:
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] not in (2, 3) or len(array) == 0:
        raise FitError(f"contour {index} has shape {array.shape}; (n, 2) or (n, 3) is needed")
    if not np.isfinite(array).all():
        bad = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
        raise FitError(f"contour {index}: point {bad} is not finite", "check the mesh for NaN")
    return array


def _corner_mask(corners: ArrayLike | None, count: int, index: int) -> Mask:
    if corners is None:
        return np.zeros(count, dtype=bool)
    given = np.asarray(corners)
    if given.dtype == bool:
        if given.shape != (count,):
            raise FitError(f"contour {index} has {count} points but {len(given)} corner flags")
        return given
    mask = np.zeros(count, dtype=bool)
    if given.size:
        if given.min() < -count or given.max() >= count:
            raise FitError(f"contour {index} has {count} points; corner indices reach {given.max()}")
        mask[given.astype(np.intp)] = True
    return mask


def _unit_tangents(tangents: ArrayLike | None, points: Floats, index: int) -> Floats:
    if tangents is None:
        return np.broadcast_to(np.nan, points.shape)
    given = np.asarray(tangents, dtype=np.float64)
    if given.shape != points.shape:
        raise FitError(f"contour {index} has points {points.shape} but tangents {given.shape}")
    length = np.linalg.norm(given, axis=1)[:, None]
    return np.asarray(np.divide(given, length, out=np.full_like(given, np.nan), where=length > 0.0))


def _duplicates_dropped(points: Floats, corner: Mask, owner: Indices, closed: Mask) -> tuple[Mask, Mask]:
    """Which points stay, and which are corners, when every point that repeats the one before it goes.

    On closed contours the last point also goes if it repeats the first; a dropped corner moves to the point that stays.
    """
    counts = np.bincount(owner, minlength=len(closed))
    last = np.cumsum(counts) - 1
    first = last - counts + 1
    tolerance = np.maximum(DUPLICATE_MM, 16.0 * np.finfo(float).eps * np.abs(points).max(axis=1))
    same = np.zeros(len(points), dtype=bool)
    same[1:] = (owner[1:] == owner[:-1]) & (np.abs(np.diff(points, axis=0)).max(axis=1) <= tolerance[1:])
    ends_at_start = closed & (counts > 1) & (np.abs(points[last] - points[first]).max(axis=1) <= tolerance[last])
    if not same.any() and not ends_at_start.any():
        return ~same, corner
    kept_at = np.maximum.accumulate(np.where(same, 0, np.arange(len(points))))
    for contour in np.flatnonzero(ends_at_start):
        tail = kept_at[last[contour]]
        if tail != first[contour]:
            same[tail] = True
            kept_at[kept_at == tail] = first[contour]
    moved = np.zeros(len(points), dtype=bool)
    moved[kept_at[corner]] = True
    return ~same, moved


def _inverse(follows: Indices) -> Indices:
    precedes = np.full(len(follows), -1, dtype=np.intp)
    linked = np.flatnonzero(follows >= 0)
    precedes[follows[linked]] = linked
    return precedes
