"""The chords between contour points, and which chord follows which smoothly: many contours in one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
    """

    points: Floats
    start: Indices
    end: Indices
    follows: Indices
    precedes: Indices
    contour: Indices

    @property
    def vectors(self) -> Floats:
        """(S, d) float, mm   The chords as vectors: the q of paper Eq. 2."""
        return self.points[self.end] - self.points[self.start]

    def broken_at(self, joints: Mask) -> Chords:
        """The same chords with no smooth way on from the marked ones ((S,) bool)."""
        follows = np.where(joints, -1, self.follows)
        return Chords(self.points, self.start, self.end, follows, _inverse(follows), self.contour)


def chain_chords(
    contours: Sequence[ArrayLike], closed: Sequence[bool], corners: Sequence[ArrayLike | None]
) -> Chords:
    """The chords of the contours, consecutive equal points dropped.

    contours : (n_i, d) float, mm, d = 2 or 3   A closed one may repeat its first point at its end.
    corners  : per contour a (n_i,) bool mask, indices, or None
    Raises FitError if a point is not finite or fewer than 2 distinct points (closed: 3) remain; says which contour.
    """
    arrays = [_checked(points, index) for index, points in enumerate(contours)]
    if len({array.shape[1] for array in arrays}) > 1:
        raise FitError("contours of 2 and of 3 dimensions cannot be fitted in one call")
    masks = [_corner_mask(mask, len(points), index) for index, (mask, points) in enumerate(zip(corners, arrays, strict=True))]
    points, corner = np.concatenate(arrays), np.concatenate(masks)
    owner = np.repeat(np.arange(len(arrays)), [len(array) for array in arrays])
    is_closed = np.asarray(closed, dtype=bool)
    if len(is_closed) != len(arrays):
        raise FitError(f"{len(arrays)} contours but {len(is_closed)} closed flags")
    points, corner, owner = _without_duplicates(points, corner, owner, is_closed)
    counts = np.bincount(owner, minlength=len(arrays))
    few = np.flatnonzero(counts < np.where(is_closed, 3, 2))
    if few.size:
        kind, least = ("closed", 3) if is_closed[few[0]] else ("open", 2)
        raise FitError(
            f"contour {few[0]} has {counts[few[0]]} distinct points; {kind} ones need {least}", "drop it or slice elsewhere"
        )
    first = np.cumsum(counts) - counts
    last = first + counts - 1
    start = np.flatnonzero(is_closed[owner] | (np.arange(len(points)) != last[owner]))
    end = np.where(start == last[owner[start]], first[owner[start]], start + 1)
    chord_from = np.full(len(points), -1, dtype=np.intp)
    chord_from[start] = np.arange(len(start))
    follows = np.where(corner[end], -1, chord_from[end])
    return Chords(points, start, end, follows, _inverse(follows), owner[start])


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


def _without_duplicates(points: Floats, corner: Mask, owner: Indices, closed: Mask) -> tuple[Floats, Mask, Indices]:
    """Drop every point that repeats the one before it (cyclically on closed contours); a dropped corner moves on."""
    counts = np.bincount(owner, minlength=len(closed))
    last = np.cumsum(counts) - 1
    first = last - counts + 1
    tolerance = np.maximum(DUPLICATE_MM, 16.0 * np.finfo(float).eps * np.abs(points).max(axis=1))
    same = np.zeros(len(points), dtype=bool)
    same[1:] = (owner[1:] == owner[:-1]) & (np.abs(np.diff(points, axis=0)).max(axis=1) <= tolerance[1:])
    ends_at_start = closed & (counts > 1) & (np.abs(points[last] - points[first]).max(axis=1) <= tolerance[last])
    if not same.any() and not ends_at_start.any():
        return points, corner, owner
    kept_at = np.maximum.accumulate(np.where(same, 0, np.arange(len(points))))
    for contour in np.flatnonzero(ends_at_start):
        tail = kept_at[last[contour]]
        if tail != first[contour]:
            same[tail] = True
            kept_at[kept_at == tail] = first[contour]
    moved = np.zeros(len(points), dtype=bool)
    moved[kept_at[corner]] = True
    return points[~same], moved[~same], owner[~same]


def _inverse(follows: Indices) -> Indices:
    precedes = np.full(len(follows), -1, dtype=np.intp)
    linked = np.flatnonzero(follows >= 0)
    precedes[follows[linked]] = linked
    return precedes
