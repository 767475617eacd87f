"""Where facets lie along a way of planes: a straight build direction, or planes that turn from one to the next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from planner.errors import RecipeError
from planner.mesh.findings import place_text
from planner.mesh.mesh import Mesh
from planner.slicing.section import checked_planes

Floats = NDArray[np.float64]
PlanesAt = Callable[[Floats], Floats]


@dataclass(frozen=True)
class Stations:
    """A mesh along a way of planes; a station is a place on it, in mm for a straight one.

    vertex : (n,) float   station of the plane through each vertex
    low, high, middle : (m,) float   of each facet's corners and centre
    direction : (m, 3) float   local build direction b, unit, at each facet's centre
    rate : (m,) float   how far, mm, the plane moves along its normal at the facet's centre per unit of station
    planes : stations (k,) -> planes (k, 6), a point (mm) and a unit normal each
    """

    vertex: Floats
    low: Floats
    high: Floats
    middle: Floats
    direction: Floats
    rate: Floats
    planes: PlanesAt


def straight_stations(mesh: Mesh, axis: Floats) -> Stations:
    """Heights along one direction.  axis : (3,) float, unit."""
    vertex = mesh.vertices @ axis
    corners = vertex[mesh.facets]

    def planes(heights: Floats) -> Floats:
        """Level planes of these heights."""
        return np.column_stack([heights[:, None] * axis, np.broadcast_to(axis, (len(heights), 3))])

    count = len(mesh.facets)
    direction = np.broadcast_to(axis, (count, 3))
    return Stations(
        vertex, corners.min(axis=1), corners.max(axis=1), corners.mean(axis=1), direction, np.ones(count), planes
    )


def path_stations(mesh: Mesh, path: ArrayLike) -> Stations:
    """Stations along planes that may turn: between row i and i + 1 one goes over into the other (`planes_on`), station i to i + 1.

    path : (p, 6) float, p >= 2   a point (mm) and a unit normal each; the first lies below the whole mesh, the last above.
    Raises RecipeError if the planes do not take in the mesh, or cross each other inside it (then one place of the part
    would have two stations).
    """
    rows = checked_planes(path)
    if len(rows) < 2:
        raise RecipeError(f"a way of planes needs two planes at least, not {len(rows)}", "add the last plane")
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[mesh.facets] = True
    vertex, crossings = _find_stations(mesh.vertices, rows)
    _refuse_path(mesh, used & (crossings != 1), crossings)
    corners = vertex[mesh.facets]
    middle, _ = _find_stations(mesh.centroids, rows)
    before, after = (planes_on(rows, middle + step) for step in (-0.5e-3, 0.5e-3))
    moved = after[:, :3] - before[:, :3]
    normal = planes_on(rows, middle)[:, 3:]
    arm = mesh.centroids - 0.5 * (after[:, :3] + before[:, :3])
    turned = (after[:, 3:] - before[:, 3:]) / 1e-3
    rate = np.einsum("ij,ij->i", moved / 1e-3, normal) - np.einsum("ij,ij->i", arm, turned)
    return Stations(
        vertex,
        corners.min(axis=1),
        corners.max(axis=1),
        middle,
        normal,
        rate,
        lambda stations: planes_on(rows, stations),
    )


def planes_on(path: Floats, stations: Floats) -> Floats:
    """Planes (k, 6) at stations (k,) of a path (p, 6); before the first and after the last row it goes on straight.

    Between two rows the planes belong to the pencil of both: they go through the line in which these meet, so that a layer
    between any two of them is as many times thicker on one side as one between the rows. Their points go over linearly,
    each put into its plane.
    """
    first = np.clip(np.floor(stations).astype(np.int64), 0, len(path) - 2)
    share = (stations - first)[:, None]
    mixed = (1.0 - share) * path[first] + share * path[first + 1]
    off = [np.einsum("ij,ij->i", mixed[:, :3] - path[row, :3], path[row, 3:]) for row in (first, first + 1)]
    height = (1.0 - share[:, 0]) * off[0] + share[:, 0] * off[1]
    mixed[:, :3] -= (height / np.einsum("ij,ij->i", mixed[:, 3:], mixed[:, 3:]))[:, None] * mixed[:, 3:]
    mixed[:, 3:] /= np.linalg.norm(mixed[:, 3:], axis=1, keepdims=True)
    return np.asarray(mixed)


@njit(cache=True)
def _find_stations(points: Floats, path: Floats) -> tuple[Floats, NDArray[np.int64]]:  # pragma: no cover
    """Station of the plane through each point, and how often the way of planes passes it.

    points : (n, 3) float, mm;  path : (p, 6) float.  Returns (n,) float and (n,) int64; 1 is as it should be.
    """
    station = np.zeros(points.shape[0])
    crossings = np.zeros(points.shape[0], np.int64)
    for i in range(points.shape[0]):
        last = 0.0
        for k in range(path.shape[0]):
            height = 0.0
            for axis in range(3):
                height += (points[i, axis] - path[k, axis]) * path[k, 3 + axis]
            if k and last > 0.0 and height <= 0.0:
                station[i] = last / (last - height) + k - 1
                crossings[i] += 1
            elif k and last <= 0.0 and height > 0.0:
                crossings[i] += 2
            if k == 0 and height <= 0.0:
                crossings[i] += 1 if height > -1e-9 else 2
            last = height
    return station, crossings


def _refuse_path(mesh: Mesh, is_bad: NDArray[np.bool_], crossings: NDArray[np.int64]) -> None:
    """Raise RecipeError at the first vertex that the way of planes misses or passes more than once."""
    if not is_bad.any():
        return
    worst = int(np.flatnonzero(is_bad)[0])
    how = "never passes" if crossings[worst] == 0 else "does not pass exactly once"
    raise RecipeError(
        f"the way of planes {how} {int(is_bad.sum())} of the part's vertices, first at {place_text(mesh.vertices[worst])}",
        "begin below the part, end above it, and turn the planes about lines outside of it",
    )
