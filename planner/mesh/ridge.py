"""Edges that bend more than the surface beside them: corners of the shape, however small the angle."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

LEAST_BEND_DEG = 2.0
"""Edges that bend less are never ridges: so little can be the unevenness of a fine mesh."""
_REACH = 3.0  # heights of the facet beside an edge over which the surface has to turn likewise
_AGAIN = 0.75  # times the edge's own bend: what it has to turn there; most smooth surfaces turn twice to three times
_MORE = 1.5  # times the largest bend that its facets share with others
_MOST_FACETS = 64


def ridge_edges(mesh: Mesh, bends: Floats, crease_rad: float) -> Flags:
    """Which edges bend alone: (m, 3) bool, edge k of facet f runs from its vertex k to k + 1; half-edges agree.

    bends : (m, 3) float, rad, from `crease.edge_bends`;  crease_rad : edges that bend more count as ends of the surface
    Facets that stand for a smooth surface share its turning between them: in the plane across an edge, the surface turns
    three quarters as much again, the same way, over the next two facets on one side or the other. Where it does not, the edge
    is a corner that happens to be blunt, such as the seam of two united bodies where they meet at a small angle. But not
    where its own facets bend more at another edge that shares its turning: there the mesh is coarse for the surface, and
    the lesser curvature of it changes within a facet, as beside the top of a torus.
    """
    mate = np.where(mesh.adjacency >= 0, mesh.half_edge_mates.reshape(-1, 3), -1)
    asked = (bends > np.radians(LEAST_BEND_DEG)) & (bends <= crease_rad) & (mate >= 0)
    turned = turning_beside(mesh.vertices, mesh.facets, mesh.normals, mesh.areas, mate, asked, crease_rad)
    best = np.maximum(turned, turned.ravel()[np.maximum(mate, 0)])
    alone = asked & (best < _AGAIN * bends)
    shared = np.where((bends <= crease_rad) & ~alone, bends, 0.0)
    others = np.maximum(np.roll(shared, 1, axis=1), np.roll(shared, 2, axis=1))
    return np.asarray(alone & (bends > _MORE * np.maximum(others, others.ravel()[np.maximum(mate, 0)])))


@njit(cache=True)
def turning_beside(
    vertices: Floats, facets: Ints, normals: Floats, areas: Floats, mate: Ints, asked: Flags, crease_rad: float
) -> Floats:  # pragma: no cover
    """How far the surface turns, beside each edge that is asked for, on the edge's own facet and beyond: (m, 3) float, rad.

    Measured along the plane section across the edge's middle, in the sense of the edge's own bend, over _REACH times the
    height of the facet over the edge; it ends where a turn is greater than crease_rad.
    """
    found = np.zeros(facets.shape)
    for f in range(facets.shape[0]):
        for k in range(3):
            if asked[f, k]:
                found[f, k] = _turn_from(vertices, facets, normals, areas, mate, f, k, crease_rad)
    return found


@njit(cache=True)
def _turn_from(
    vertices: Floats, facets: Ints, normals: Floats, areas: Floats, mate: Ints, f: int, k: int, crease_rad: float
) -> float:  # pragma: no cover
    """The turning on the side of facet f, rad, for the edge k of it."""
    tail, head = vertices[facets[f, k]], vertices[facets[f, (k + 1) % 3]]
    along = head - tail
    length = np.sqrt(along @ along)
    if length <= 0.0 or areas[f] <= 0.0:
        return 0.0
    along = along / length
    other = mate[f, k] // 3
    reach = _REACH * 2.0 * areas[f] / length
    inward = np.cross(normals[f], along)
    sense = _turn(np.cross(normals[other], along), inward, along)
    place = 0.5 * (tail + head)
    gone, total = 0.0, 0.0
    facet, entry = f, k
    for _ in range(_MOST_FACETS):
        leave, distance = _exit(vertices, facets, facet, entry, place, inward, along)
        if leave < 0 or gone + distance > reach:
            break
        gone += distance
        place = place + distance * inward
        across = mate[facet, leave]
        if across < 0:
            break
        facet, entry = across // 3, across % 3
        ahead = np.cross(normals[facet], along)
        size = np.sqrt(ahead @ ahead)
        if size < 1e-9:
            break
        ahead = ahead / size
        turn = _turn(inward, ahead, along)
        if abs(turn) > crease_rad:
            break
        total += turn
        inward = ahead
    return total if sense > 0.0 else -total


@njit(cache=True)
def _turn(before: Floats, after: Floats, axis: Floats) -> float:  # pragma: no cover
    """Angle from one direction to the next about an axis, rad, signed."""
    return float(np.arctan2(np.cross(before, after) @ axis, before @ after))


@njit(cache=True)
def _exit(
    vertices: Floats, facets: Ints, facet: int, entry: int, place: Floats, inward: Floats, along: Floats
) -> tuple[int, float]:  # pragma: no cover
    """Edge over which the plane through `place` across `along` leaves a facet, and the way there, mm; edge -1 if over none."""
    best, way = -1, 0.0
    for j in range(3):
        if j == entry:
            continue
        first, second = vertices[facets[facet, j]] - place, vertices[facets[facet, (j + 1) % 3]] - place
        low, high = first @ along, second @ along
        if (low > 0.0) == (high > 0.0):
            continue
        share = low / (low - high)
        distance = (first + share * (second - first)) @ inward
        if best < 0 or distance > way:
            best, way = j, distance
    return best, max(way, 0.0)
