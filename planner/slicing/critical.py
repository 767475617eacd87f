"""Heights at which the outline of a part changes its kind: where it begins, ends, joins, parts or lies level."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from planner.errors import RecipeError
from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LEVEL_FRACTION = 1e-6
"""Rise along the build direction, as a fraction of the part's extent, up to which vertices are level: 15 times the
rounding of 32-bit coordinates."""


def critical_heights(mesh: Mesh, direction: ArrayLike) -> Floats:
    """Heights of level faces and folds, and of vertices where the section's topology changes: minima, maxima and saddles.

    direction : (3,) float, any length.  Returns (k,) float, mm, ascending b·p, none nearer to another than the level's
    tolerance; the part's lowest and highest point are among them.

    Connected vertices of one height count as one place. A place is regular if the facets around it that leave its level
    fall into one run above and one below; with no run below it is a minimum, with none above a maximum, else a saddle.
    At a fold, a level edge whose two facets both rise or both fall, the outline gets a slot or a tongue of no width, even
    where it stays one outline (a bore that opens into a face).
    Source: Banchoff, Critical points and curvature for embedded polyhedra, J. Diff. Geom. 1 (1967).
    Raises RecipeError for a direction without length.
    """
    axis = np.asarray(direction, dtype=np.float64)
    if axis.shape != (3,) or not np.isfinite(axis).all() or not np.linalg.norm(axis) > 0.0:
        raise RecipeError(f"the build direction {direction!r} is no direction", "give three numbers, not all zero")
    heights = mesh.vertices @ (axis / np.linalg.norm(axis))
    return critical_stations(mesh, heights)


def critical_stations(mesh: Mesh, height: Floats) -> Floats:
    """The same for any height of the vertices, such as stations.  height : (n,) float.  Returns (k,) float."""
    used = height[mesh.facets]
    touch = LEVEL_FRACTION * float(used.max() - used.min())
    group = _level_groups(mesh.facets, height, touch)
    mate = np.where(mesh.adjacency >= 0, mesh.half_edge_mates.reshape(-1, 3), -1).ravel()
    above, below, level = _runs(mesh.facets, mate, group, height, touch)
    root = group == np.arange(len(group))
    is_used = np.zeros(len(group), dtype=bool)
    is_used[group[mesh.facets]] = True
    critical = root & is_used & ((above != 1) | (below != 1) | level)
    found = np.sort(np.concatenate([height[critical], _folds(mesh, height, touch)]))
    found = np.concatenate([[used.min()], found, [used.max()]])
    kept = np.concatenate([[True], np.diff(found) > touch])
    values = found[kept]
    values[-1] = used.max()
    return np.asarray(values)


def _folds(mesh: Mesh, height: Floats, touch: float) -> Floats:
    """Heights of level edges whose facets lie both above or both below them: (f,) float, ascending."""
    used = height[mesh.facets]
    mate = np.where(mesh.adjacency >= 0, mesh.half_edge_mates.reshape(-1, 3), 0)
    rise = np.roll(used, -2, axis=1) - used
    across = used.ravel()[mate // 3 * 3 + (mate % 3 + 2) % 3] - used
    level = (np.abs(np.roll(used, -1, axis=1) - used) <= touch) & (mesh.adjacency >= 0)
    fold = level & (np.abs(rise) > touch) & (np.abs(across) > touch) & ((rise > 0.0) == (across > 0.0))
    return np.unique(used[fold])


@njit(cache=True)
def _root(parent: Ints, i: int) -> int:  # pragma: no cover
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True)
def _level_groups(facets: Ints, height: Floats, touch: float) -> Ints:  # pragma: no cover
    """Root vertex of the connected vertices of one height that each vertex belongs to: (n,) int64."""
    parent = np.arange(height.shape[0])
    for f in range(facets.shape[0]):
        for k in range(3):
            a, b = facets[f, k], facets[f, (k + 1) % 3]
            if abs(height[a] - height[b]) <= touch:
                a, b = _root(parent, a), _root(parent, b)
                parent[max(a, b)] = min(a, b)
    for v in range(parent.shape[0]):
        parent[v] = _root(parent, v)
    return parent


@njit(cache=True)
def _runs(
    facets: Ints, mate: Ints, group: Ints, height: Floats, touch: float
) -> tuple[Ints, Ints, NDArray[np.bool_]]:  # pragma: no cover
    """Around each level place: how many runs of facets lie above it, how many below, and whether a facet is level.

    Facets that reach above a place are joined across edges that reach above it too; a run is what hangs together.
    Corner h = 3f + k of a facet stands for the facet seen from the place of its vertex k.
    """
    count = 3 * facets.shape[0]
    upper, lower = np.arange(count), np.arange(count)
    level = np.zeros(group.shape[0], np.bool_)
    goes_up, goes_down = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    for f in range(facets.shape[0]):
        for k in range(3):
            place = group[facets[f, k]]
            for j in range(3):
                rise = height[facets[f, j]] - height[facets[f, k]]
                if group[facets[f, j]] != place:
                    if rise > 0.0:
                        goes_up[3 * f + k] = True
                    else:
                        goes_down[3 * f + k] = True
        if group[facets[f, 0]] == group[facets[f, 1]] == group[facets[f, 2]]:
            level[group[facets[f, 0]]] = True
    for f in range(facets.shape[0]):
        for k in range(3):  # corners of one facet in one place are one
            j = (k + 1) % 3
            if group[facets[f, k]] == group[facets[f, j]]:
                a, b = _root(upper, 3 * f + k), _root(upper, 3 * f + j)
                upper[max(a, b)] = min(a, b)
                a, b = _root(lower, 3 * f + k), _root(lower, 3 * f + j)
                lower[max(a, b)] = min(a, b)
    for h in range(count):
        g = mate[h]
        if g < 0 or g < h:
            continue
        tail, head = h // 3 * 3 + h % 3, h // 3 * 3 + (h + 1) % 3
        for own, far in ((tail, head), (head, tail)):
            if group[facets[own // 3, own % 3]] == group[facets[far // 3, far % 3]]:
                continue
            vertex = facets[own // 3, own % 3]
            other = g // 3 * 3 + g % 3
            if facets[other // 3, other % 3] != vertex:
                other = g // 3 * 3 + (g + 1) % 3
            if height[facets[far // 3, far % 3]] > height[vertex]:
                a, b = _root(upper, own), _root(upper, other)
                upper[max(a, b)] = min(a, b)
            else:
                a, b = _root(lower, own), _root(lower, other)
                lower[max(a, b)] = min(a, b)
    above, below = np.zeros(group.shape[0], np.int64), np.zeros(group.shape[0], np.int64)
    for h in range(count):
        place = group[facets[h // 3, h % 3]]
        if goes_up[h] and _root(upper, h) == h:
            above[place] += 1
        if goes_down[h] and _root(lower, h) == h:
            below[place] += 1
    return above, below, level
