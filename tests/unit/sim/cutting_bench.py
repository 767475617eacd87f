"""An end mill in plain numpy, and what it sweeps as the union of very many poses: the truth for the tests of cutting."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.process.stock import Stock

Array = NDArray[np.float64]


def end_mill(points: Array, tip: Array, axis: Array, radius: float, corner: float, flute: float) -> Array:
    """Signed distance of points (..., 3) to a finite cutter: a rounded profile turned about its axis."""
    away = points - tip
    axial = away @ axis
    radial = np.linalg.norm(away - axial[..., None] * axis, axis=-1)
    # the profile is the rounding (Minkowski sum with a disc of `corner`) of a box, cut off square at the top
    r, low = radial - (radius - corner), corner - axial
    rounded = np.hypot(np.maximum(r, 0.0), np.maximum(low, 0.0)) + np.minimum(np.maximum(r, low), 0.0) - corner
    top = axial - flute
    beside = np.hypot(np.maximum(radial - radius, 0.0), np.maximum(top, 0.0))
    return np.where(top > 0.0, beside, np.maximum(rounded, top))


def swept(points: Array, start: Array, end: Array, axes: tuple[Array, Array], cutter: tuple[float, float, float], poses: int) -> Array:
    """Least distance of points over many poses; position and axis go linearly."""
    least = np.full(points.shape[:-1], np.inf)
    for share in np.linspace(0.0, 1.0, poses):
        axis = axes[0] + share * (axes[1] - axes[0])
        least = np.minimum(least, end_mill(points, start + share * (end - start), axis / np.linalg.norm(axis), *cutter))
    return least


def cells(stock: Stock) -> Array:
    """Cell centres, (nx, ny, nz, 3), mm."""
    return np.stack(np.meshgrid(*stock.points(), indexing="ij"), axis=-1)


def values(stock: Stock) -> Array:
    """The whole field, mm."""
    return stock.field.dense((0, 0, 0), stock.field.shape).astype(np.float64)


def filled_mm3(stock: Stock) -> float:
    """Metal by the filled fraction of the cells as they stand, mm3."""
    return float(np.clip(0.5 - values(stock) / stock.cell_mm, 0.0, 1.0).sum()) * stock.cell_mm**3


def after_sweep(
    stock: Stock, start: Array, end: Array, axes: tuple[Array, Array], cutter: tuple[float, float, float], poses: int
) -> Array:  # fmt: skip
    """The whole field as it has to be when the cutter has gone, mm."""
    field = values(stock)
    metal = field < stock.band_mm
    field[metal] = np.maximum(field[metal], -swept(cells(stock)[metal], start, end, axes, cutter, poses))
    return np.clip(field, -stock.band_mm, stock.band_mm)


def leaning(tilt_deg: float, towards_deg: float = 0.0) -> Array:
    """Unit vector that leans from z."""
    tilt, way = np.radians([tilt_deg, towards_deg])
    return np.array([np.sin(tilt) * np.cos(way), np.sin(tilt) * np.sin(way), np.cos(tilt)])
