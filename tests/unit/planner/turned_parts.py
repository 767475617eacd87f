"""A rod or tube bent about an axis, and the way of planes that turns with it, for the tests of layers that turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]

BEND_MM = 25.0
"""Radius of the bend, about the line x = -25, z = 0."""


def bend(degrees: float, outer_mm: float = 5.0, inner_mm: float = 0.0, steps: int = 32, around: int = 48) -> Mesh:
    """A piece of a torus, from the plane z = 0, where it is centred on the z axis, bent towards -x."""
    angle = 2.0 * np.pi * np.arange(around) / around
    turn = np.radians(degrees) * np.arange(steps + 1) / steps
    surfaces, facets = [], []
    for radius in (outer_mm, inner_mm) if inner_mm else (outer_mm,):
        away = BEND_MM + radius * np.cos(angle)
        across = np.broadcast_to(radius * np.sin(angle), (steps + 1, around))
        grid = np.stack([np.outer(np.cos(turn), away) - BEND_MM, across, np.outer(np.sin(turn), away)], axis=2)
        number = np.arange((steps + 1) * around).reshape(steps + 1, around) + around * (steps + 1) * len(surfaces)
        a, b = number[:-1].ravel(), np.roll(number, -1, axis=1)[:-1].ravel()
        c, d = np.roll(number, -1, axis=1)[1:].ravel(), number[1:].ravel()
        skin = np.concatenate([np.c_[a, b, c], np.c_[a, c, d]])
        facets.append(skin[:, ::-1] if surfaces else skin)
        surfaces.append(grid.reshape(-1, 3))
    return Mesh(np.concatenate(surfaces), np.concatenate([*facets, *_lids(steps, around, bool(inner_mm))]))


def _lids(steps: int, around: int, is_tube: bool) -> list[NDArray[np.int64]]:
    """Facets of both ends."""
    lids = []
    for row, is_end in ((0, False), (steps, True)):
        ring = row * around + np.arange(around)
        if is_tube:
            inner, after = ring + around * (steps + 1), np.roll(ring, -1)
            within = np.roll(inner, -1)
            lid = np.concatenate([np.c_[ring, after, within], np.c_[ring, within, inner]])
        else:
            lid = np.column_stack([np.full(around - 2, ring[0]), ring[1:-1], ring[2:]])
        lids.append(lid if is_end else lid[:, ::-1])
    return lids


def bend_path(degrees: float, count: int = 19) -> Floats:
    """Planes that turn with the bend, (count, 6)."""
    turn = np.radians(degrees) * np.arange(count) / (count - 1)
    path = np.zeros((count, 6))
    path[:, 0], path[:, 2] = BEND_MM * np.cos(turn) - BEND_MM, BEND_MM * np.sin(turn)
    path[:, 3], path[:, 5] = -np.sin(turn), np.cos(turn)
    return path


def from_centreline(points: Floats) -> Floats:
    """(n,) float, mm   Distance of points from the circle in which the bend's middle lies."""
    away = np.hypot(points[:, 0] + BEND_MM, points[:, 2]) - BEND_MM
    return np.asarray(np.hypot(away, points[:, 1]))
