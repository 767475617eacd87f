"""Slice points on the smooth surface: which ones count, where they move to, and the directions of the curve there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.mesh.smooth import SmoothSurface, bezier_at, edge_curves
from planner.slicing.section import Section

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_NEWTON_STEPS = 12
_FARTHEST = 0.3  # of an edge, along it: edges that meet the plane at so small an angle are left across, in the plane
_LONGEST_MOVE = 0.5  # of an edge: a point that would move farther stays
_LEVEL = 0.05  # sine of the angle between plane and surface below which the surface tells no direction (3 degrees)


@dataclass(frozen=True, eq=False)
class Outline:
    """All loops of some sections in one table, loop after loop.

    loop, start : (n,) int64, (k+1,) int64      the loop of each point; where each loop begins
    points, normal : (n, 3) float               mm; the unit normal of each point's plane
    facets, edges, weights                      as in `Loop`
    behind : (n,) int64                         mesh facet of the segment that arrives at each point
    """

    loop: Ints
    start: Ints
    points: Floats
    normal: Floats
    facets: Ints
    edges: Ints
    weights: Floats
    behind: Ints

    @classmethod
    def of(cls, sections: Sequence[Section]) -> Outline:
        """The table of all loops of all sections, in their order."""
        loops = [loop for section in sections for loop in section.loops]
        counts = np.array([len(loop.points) for loop in loops], dtype=np.int64)
        planes = np.array([section.normal for section in sections for _ in section.loops]).reshape(-1, 3)
        number = np.repeat(np.arange(len(loops)), counts)
        facets = np.concatenate([loop.facets for loop in loops]) if loops else np.empty(0, dtype=np.int64)
        start = np.concatenate([[0], np.cumsum(counts)])
        previous = np.arange(len(number)) - 1
        previous[start[:-1]] = start[1:] - 1
        return cls(
            number,
            start,
            np.concatenate([loop.points for loop in loops]) if loops else np.empty((0, 3)),
            planes[number],
            facets,
            np.concatenate([loop.edges for loop in loops]) if loops else np.empty((0, 2), dtype=np.int64),
            np.concatenate([loop.weights for loop in loops]) if loops else np.empty(0),
            facets[previous],
        )

    def taken(self, keep: Flags) -> Outline:
        """The points that are kept, loops in their order; facets are still those that begin and end at each point.

        keep : (n,) bool   some of every loop
        """
        rows = np.flatnonzero(keep)
        start = np.searchsorted(rows, self.start).astype(np.int64)
        floats = (column[rows] for column in (self.points, self.normal, self.weights))
        ints = (column[rows] for column in (self.loop, self.facets, self.edges, self.behind))
        (points, normal, weights), (loop, facets, edges, behind) = floats, ints
        return Outline(loop, start, points, normal, facets, edges, weights, behind)

    @property
    def after(self) -> Ints:
        """(n,) int64: the point after each point, cyclically."""
        following = np.arange(len(self.loop)) + 1
        following[self.start[1:] - 1] = self.start[:-1]
        return following


@dataclass(frozen=True, eq=False)
class Nodes:
    """What a curve is led through, point by point of an Outline.

    points   : (n, 3) float, mm   on the smooth surface and in the plane
    tangents : (n, 2, 3) float    unit, before and after the point; NaN where the surface tells none
    corners  : (n,) bool          the contour crosses a crease
    """

    points: Floats
    tangents: Floats
    corners: Flags


def node_kinds(outline: Outline, surface: SmoothSurface) -> tuple[Flags, Flags]:
    """Which points are corners, as the contour crosses a crease, and which lie between facets of one plane: (n,), (n,).

    The latter tell nothing of the surface.
    """
    edge, at_vertex = _edges_met(outline, surface)
    rows, on_edge = np.flatnonzero(at_vertex), np.flatnonzero(~at_vertex)
    corners, flat = np.zeros(len(edge), dtype=bool), np.zeros(len(edge), dtype=bool)
    corners[rows] = _at_vertices(outline, surface, rows)[1]
    corners[on_edge] = surface.creases[outline.facets[on_edge], edge[on_edge]]
    flat[on_edge] = surface.flats[outline.facets[on_edge], edge[on_edge]]
    return corners, flat


def lifted_nodes(outline: Outline, surface: SmoothSurface) -> Nodes:
    """Every slice point moved to where the curve over its mesh edge meets the plane.

    Points at vertices stay. The tangent is T = b x n, b the plane's normal, n the surface's, interpolated along the
    edge and made square to it; at creases one on each side. Where an edge meets the plane at a small angle the point
    moves in the plane, across the contour, instead of along the edge.
    Raises nothing.  Source: Vlachos et al., Curved PN triangles, I3D 2001.
    """
    edge, at_vertex = _edges_met(outline, surface)
    points = outline.points.copy()
    normals = np.full((len(points), 2, 3), np.nan)
    corners = np.zeros(len(points), dtype=bool)
    rows = np.flatnonzero(at_vertex)
    normals[rows], corners[rows] = _at_vertices(outline, surface, rows)
    rows = np.flatnonzero(~at_vertex)
    facet, edge = outline.facets[rows], edge[rows]
    corners[rows] = surface.creases[facet, edge]
    points[rows], normals[rows] = _on_edges(outline, surface, rows, facet, edge)
    tangents = np.cross(outline.normal[:, None, :], normals)
    size = np.linalg.norm(tangents, axis=2)[:, :, None]
    tangents = np.divide(tangents, size, out=np.full_like(tangents, np.nan), where=size > _LEVEL)
    return Nodes(points, tangents, corners)


def _edges_met(outline: Outline, surface: SmoothSurface) -> tuple[Ints, Flags]:
    """Number of the edge that each point lies on in the facet that begins there, and whether it lies at its end."""
    edge = _edge_in(surface.mesh.facets[outline.facets], outline.edges)
    return edge, (outline.weights <= 0.0) | (outline.weights >= 1.0) | (edge < 0)


def _edge_in(corners: Ints, edges: Ints) -> Ints:
    """Number k of the edge {a, b} in each facet (from its vertex k to k + 1), -1 where it has none: (n,) int64."""
    following = np.roll(corners, -1, axis=1)
    low, high = np.minimum(corners, following), np.maximum(corners, following)
    hit = (low == edges[:, :1]) & (high == edges[:, 1:])
    return np.where(hit.any(axis=1), hit.argmax(axis=1), -1)


def _at_vertices(outline: Outline, surface: SmoothSurface, rows: Ints) -> tuple[Floats, Flags]:
    """Normals before and after slice points at mesh vertices, (k, 2, 3), and whether they are corners, (k,)."""
    vertex = np.where(outline.weights[rows] >= 0.5, outline.edges[rows, 1], outline.edges[rows, 0])
    normals, fans = np.empty((len(rows), 2, 3)), []
    for side, facet in enumerate((outline.behind[rows], outline.facets[rows])):
        hit = surface.mesh.facets[facet] == vertex[:, None]
        has, corner = hit.any(axis=1), hit.argmax(axis=1)
        normals[:, side] = np.where(has[:, None], surface.normals[facet, corner], surface.mesh.normals[facet])
        fans.append(np.where(has, surface.fans[facet, corner], -1 - facet))
    cosine = np.einsum("nd,nd->n", normals[:, 0], normals[:, 1])
    return normals, np.asarray((fans[0] != fans[1]) | (cosine < np.cos(surface.crease_rad)))


def _on_edges(outline: Outline, surface: SmoothSurface, rows: Ints, facet: Ints, edge: Ints) -> tuple[Floats, Floats]:
    """Points (k, 3) and normals before and after (k, 2, 3) on the curves over the edges of the rows."""
    bezier, own, other = edge_curves(surface, facet, edge)
    starts_low = surface.mesh.facets[facet, edge] == outline.edges[rows, 0]
    weight = np.where(starts_low, outline.weights[rows], 1.0 - outline.weights[rows])
    plane, raw = outline.normal[rows], outline.points[rows]
    t = _crossing(np.einsum("nkd,nd->nk", bezier - raw[:, None, :], plane), weight)
    t = np.where(np.abs(t - weight) <= _FARTHEST, t, weight)
    point, along = bezier_at(bezier, t)
    is_crease = surface.creases[facet, edge]
    normals = _normals_on(surface, facet, edge, np.stack([other, own], axis=1), bezier, t, point, along)
    point = _back_to_plane(point, raw, plane, normals.mean(axis=1), is_crease)
    length = np.linalg.norm(bezier[:, 3] - bezier[:, 0], axis=1)
    too_far = np.linalg.norm(point - raw, axis=1) > _LONGEST_MOVE * length
    return np.where(too_far[:, None], raw, point), normals


def _normals_on(
    surface: SmoothSurface,
    facet: Ints,
    edge: Ints,
    at_ends: Floats,
    bezier: Floats,
    t: Floats,
    point: Floats,
    along: Floats,
) -> Floats:
    """Unit normals of both sides at points of the curves over edges: (n, 2, 3), the facet across first, then this one.

    at_ends : (n, 2, 2, 3) float   of both sides, at both ends of the edge
    point, along : (n, 3) float   of the curve at t
    Linear between the ends, as it is along the chord of a quadric, and turned by the curvature tensor where the curve
    leaves the chord sideways; square to the curve. Both sides of a smooth edge share their mean.
    """
    mate = surface.mesh.adjacency[facet, edge]
    across = np.where(mate >= 0, mate, facet)
    share = np.stack([1.0 - t, t], axis=1)[:, None, :, None]
    normals = (share * at_ends).sum(axis=2)
    tensors = surface.curvatures[np.stack([across, facet], axis=1)]
    is_smooth = ~surface.creases[facet, edge]
    normals[is_smooth] = normals[is_smooth].mean(axis=1, keepdims=True)
    tensors[is_smooth] = tensors[is_smooth].mean(axis=1, keepdims=True)
    aside = (point - (1.0 - t)[:, None] * bezier[:, 0] - t[:, None] * bezier[:, 3])[:, None, :]
    normals += np.einsum("nkij,nkj->nki", tensors, aside - (aside * normals).sum(axis=2, keepdims=True) * normals)
    slope2 = np.maximum(np.einsum("nd,nd->n", along, along), 1e-300)
    normals -= (np.einsum("nkd,nd->nk", normals, along) / slope2[:, None])[:, :, None] * along[:, None, :]
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-300))


def _crossing(height: Floats, start: Floats) -> Floats:
    """Where cubics in Bézier form cross zero, from a first guess, never outside 0 … 1: (n,) float.

    height : (n, 4) float   of different sign at the ends   start : (n,) float
    Newton, halving the bracket where it leaves it.
    """
    t, low, high = start.copy(), np.zeros(len(start)), np.ones(len(start))
    rises = height[:, 3] > height[:, 0]
    for _ in range(_NEWTON_STEPS):
        value, slope = (array[:, 0] for array in bezier_at(height[:, :, None], t))
        above = (value > 0.0) == rises
        high, low = np.where(above, t, high), np.where(above, low, t)
        with np.errstate(all="ignore"):
            step = t - value / slope
        t = np.where((step >= low) & (step <= high), step, 0.5 * (low + high))
    return t


def _back_to_plane(point: Floats, raw: Floats, plane: Floats, normal: Floats, is_crease: Flags) -> Floats:
    """Points beside the plane moved into it along the surface, across the contour (on creases: straight).  (k, 3)."""
    off = np.einsum("nd,nd->n", point - raw, plane)
    tilt = np.einsum("nd,nd->n", normal, plane)
    across = plane - tilt[:, None] * normal
    size2 = np.einsum("nd,nd->n", across, across)
    use = ~is_crease & (size2 > 0.01)
    direct = plane * off[:, None]
    along = across * (off / np.where(use, size2, 1.0))[:, None]
    return np.asarray(point - np.where(use[:, None], along, direct))
