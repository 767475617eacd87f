"""Many contours as one flat table of points with what is known there, checked once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import FitError

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

DUPLICATE_MM = 1e-9  # points closer than this are one point: far below what an STL's float32 can tell at 1 mm
_NO_MASK = np.empty(0, dtype=np.bool_)


@dataclass(frozen=True)
class ContourTable:
    """All points of all contours, one contour after the other.

    points     : (N, d) float, mm
    offsets    : (k+1,) int           Contour i has the points offsets[i] ... offsets[i+1] - 1.
    closed     : (k,) bool
    corners    : (N,) bool            Or (0,) where there are none.
    tangents   : (N, 2, d) float      Unit, arriving and leaving, NaN where not known. Or (0, 2, d).
    curvatures : (N, 2, d) float      dT/ds, 1/mm, arriving and leaving, NaN where not known. Or (0, 2, d).
    """

    points: Floats
    offsets: Indices
    closed: Mask
    corners: Mask
    tangents: Floats
    curvatures: Floats


def contour_table(
    contours: Sequence[ArrayLike],
    closed: bool | Sequence[bool],
    corners: Sequence[ArrayLike | None] | None,
    tangents: Sequence[ArrayLike | None] | None,
    curvatures: Sequence[ArrayLike | None] | None,
) -> ContourTable:
    """The contours as one table.

    contours   : (n_i, d) float, mm, d = 2 or 3
    closed     : for all, or one per contour
    corners    : per contour a (n_i,) bool mask, indices, or None
    tangents   : per contour (n_i, d) or, one-sided, (n_i, 2, d) float, any length, NaN rows where not known, or None
    curvatures : per contour (n_i, d) or (n_i, 2, d) float, 1/mm, NaN rows where not known, or None
    Values of shape (n_i, d) are dropped at corners: they cannot serve both sides.
    Raises FitError if shapes do not match; says which contour.
    """
    count = len(contours)
    arrays = [np.asarray(points, dtype=np.float64) for points in contours]
    first = arrays[0].shape
    for index, array in enumerate(arrays):
        if array.ndim != 2 or not 2 <= array.shape[1] <= 3 or not array.shape[0]:
            raise FitError(f"contour {index} has shape {array.shape}; (n, 2) or (n, 3) is needed")
        if array.shape[1] != first[1]:
            raise FitError("contours of 2 and of 3 dimensions cannot be fitted in one call")
    flags = np.array([closed] * count if isinstance(closed, (bool, np.bool_)) else closed, dtype=np.bool_)
    for name, given in (("corners", corners), ("tangents", tangents), ("curvatures", curvatures)):
        if given is not None and len(given) != count:
            raise FitError(f"{count} contours but {len(given)} entries of {name}")
    if flags.shape != (count,):
        raise FitError(f"{count} contours but {len(flags)} entries of closed")
    offsets = np.array([0, *accumulate(len(array) for array in arrays)], dtype=np.int64)
    points = np.ascontiguousarray(arrays[0] if count == 1 else np.concatenate(arrays))
    marks = _NO_MASK if corners is None else _corner_masks(corners, offsets)
    directions = _sided(tangents, offsets, marks, first[1], "tangents")
    if directions.size:
        length = np.linalg.norm(directions, axis=2, keepdims=True)
        directions = np.divide(directions, length, out=np.full_like(directions, np.nan), where=length > 0.0)
    return ContourTable(
        points, offsets, flags, marks, directions, _sided(curvatures, offsets, marks, first[1], "curvatures")
    )


def _corner_masks(corners: Sequence[ArrayLike | None], offsets: Indices) -> Mask:
    """The flags of all contours, (N,) bool, or (0,) if no contour has any."""
    if all(given is None for given in corners):
        return _NO_MASK
    flags = np.zeros(offsets[-1], dtype=np.bool_)
    for index, given in enumerate(corners):
        if given is None:
            continue
        mine = flags[offsets[index] : offsets[index + 1]]
        marks = np.asarray(given)
        if marks.dtype == np.bool_:
            if marks.shape != mine.shape:
                raise FitError(f"contour {index} has {len(mine)} points but {len(marks)} corner flags")
            mine[:] = marks
        elif marks.size:
            if marks.min() < -len(mine) or marks.max() >= len(mine):
                raise FitError(f"contour {index} has {len(mine)} points; corner indices reach {marks.max()}")
            mine[marks.astype(np.intp)] = True
    return flags


def _sided(values: Sequence[ArrayLike | None] | None, offsets: Indices, corners: Mask, dim: int, name: str) -> Floats:
    """Known vectors before and after every point, (N, 2, d), or (0, 2, d) if none are known."""
    if values is None or all(given is None for given in values):
        return np.empty((0, 2, dim))
    table = np.full((offsets[-1], 2, dim), np.nan)
    for index, given in enumerate(values):
        if given is None:
            continue
        low, high = offsets[index], offsets[index + 1]
        array = np.asarray(given, dtype=np.float64)
        if array.shape == (high - low, dim):
            table[low:high] = array[:, None, :]
            if corners.size:
                table[low:high][corners[low:high]] = np.nan
        elif array.shape == (high - low, 2, dim):
            table[low:high] = array
        else:
            raise FitError(f"contour {index} has points {(int(high - low), dim)} but {name} {array.shape}")
    return table


def refusal(table: ContourTable, contour: int, found: int) -> FitError:
    """Why a contour makes no curve: `found` distinct points, or -1 - i where its point i is not finite."""
    if found < 0:
        return FitError(f"contour {contour}: point {-1 - found} is not finite", "check the mesh for NaN")
    kind, least = ("closed", 3) if table.closed[contour] else ("open", 2)
    return FitError(
        f"contour {contour} has {found} distinct points; {kind} ones need {least}", "drop it or slice elsewhere"
    )
