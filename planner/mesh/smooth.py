"""The smooth surface that a mesh's facets stand for: normals at its vertices and a curve over every edge."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from planner.mesh.arcs import with_arc_ends
from planner.mesh.crease import corner_normals, crease_edges, edge_bends, smooth_fans
from planner.mesh.curvature import facet_curvatures
from planner.mesh.mesh import Mesh
from planner.nurbs.handles import equal_speed

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

STORED = 1.2e-7
"""Coordinates of an STL are 32-bit: two neighbouring numbers differ by this share of the largest coordinate."""
_FLAT_RATIO = 2.5  # a plane face this much wider than all others at a vertex is a flat face, not a step along a bend
_APEX_RATIO = 0.25  # of the bend at a vertex that its neighbours see along the edge: below it the surface is a cone
_APEX_BEND = 0.02  # rad; less bent vertices are no tip
_STRAIGHT_RAD = 1e-5  # an edge whose curve leaves it at a smaller angle is straight: the rounding of 32-bit coordinates
_STEEPEST = 0.5  # cosine: a normal or crease that leads further off an edge than 60 degrees says nothing about it


@dataclass(frozen=True, eq=False)
class SmoothSurface:
    """A mesh with what its facets stand for.

    bends   : (m, 3) float, rad   between the facets at edge k (vertex k to k + 1) of facet f
    creases : (m, 3) bool         edges that bend more than the crease angle
    flats   : (m, 3) bool         edges between facets of one plane, within the rounding of 32-bit coordinates
    fans    : (m, 3) int64        corners of one vertex with the same number lie on one smooth piece of surface
    normals : (m, 3, 3) float     unit normal of the surface at each facet's corners
    """

    mesh: Mesh
    crease_rad: float
    bends: Floats
    creases: Flags
    flats: Flags
    fans: Ints
    normals: Floats

    @cached_property
    def curvatures(self) -> Floats:
        """(m, 3, 3) float, 1/mm: curvature tensor of each facet, > 0 convex."""
        return facet_curvatures(self.mesh, self.normals)

    @cached_property
    def rises(self) -> Floats:
        """(m,) float, mm: how high the surface may stand over each facet, the largest of bend · height / 8 over its edges.

        The height is that of the higher facet on the edge; creases say nothing. Over the strips of a cylinder this is
        their sagitta, over equilateral facets of a sphere half that of their edges.
        """
        mesh = self.mesh
        length = np.linalg.norm(np.roll(mesh.corners, -1, axis=1) - mesh.corners, axis=2)
        height = 2.0 * mesh.areas[:, None] / np.maximum(length, 1e-300)
        mate = np.where(mesh.adjacency >= 0, mesh.half_edge_mates.reshape(-1, 3), np.arange(height.size).reshape(-1, 3))
        higher = np.maximum(height, height.ravel()[mate])
        return np.asarray(np.where(self.creases, 0.0, self.bends * higher / 8.0).max(axis=1))


_SURFACES: WeakKeyDictionary[Mesh, dict[float, SmoothSurface]] = WeakKeyDictionary()


def smooth_surface(mesh: Mesh, crease_deg: float) -> SmoothSurface:
    """The smooth surface of a mesh; kept as long as the mesh is.

    Vertex normals are exact where the vertices lie on a sphere or on a surface of revolution with plane facets
    (`corner_normals`); a face much wider than the strips beside it keeps its own normal along its border, at the tip of
    a cone each facet keeps its own, and where the curvature jumps the edges end as arcs do (`with_arc_ends`).
    """
    known = _SURFACES.setdefault(mesh, {})
    if crease_deg not in known:
        known[crease_deg] = _smooth_surface(mesh, crease_deg)
    return known[crease_deg]


def _smooth_surface(mesh: Mesh, crease_deg: float) -> SmoothSurface:
    bends = edge_bends(mesh)
    creases = crease_edges(mesh, crease_deg)
    flats = bends <= _rounding_rad(mesh)
    fans = smooth_fans(mesh, creases)
    normals = corner_normals(mesh, crease_deg)
    normals = _with_flat_faces(mesh, flats, fans, normals)
    normals = _with_tips(mesh, creases | flats, fans, normals)
    normals = with_arc_ends(mesh, flats, fans, normals)
    return SmoothSurface(mesh, float(np.radians(crease_deg)), bends, creases, flats, fans, normals)


def _rounding_rad(mesh: Mesh) -> Floats:
    """(m, 3) float, rad: how far the facets at each edge may bend by the rounding of their coordinates alone."""
    corners = mesh.corners
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    stored = STORED * float(np.abs(mesh.bounds).max())
    tilt = 2.0 * stored * longest / np.maximum(2.0 * mesh.areas, 1e-300)
    across = np.maximum(mesh.adjacency, 0)
    return np.asarray(np.minimum(tilt[:, None] + tilt[across] + 1e-9, 0.01))


def _with_flat_faces(mesh: Mesh, flats: Flags, fans: Ints, normals: Floats) -> Floats:
    """Normals with those of flat faces wherever one meets strips that are much narrower.

    The width of a face is 4 · area / perimeter, taken over all facets of its plane.
    """
    facet, edge = np.nonzero(flats & (mesh.adjacency >= 0))
    links = coo_array((np.ones(len(facet), dtype=bool), (facet, mesh.adjacency[facet, edge])), shape=(len(flats),) * 2)
    count, face = connected_components(links, directed=False)
    lengths = np.linalg.norm(np.roll(mesh.corners, -1, axis=1) - mesh.corners, axis=2)
    perimeter = np.bincount(face, weights=np.where(flats, 0.0, lengths).sum(axis=1), minlength=count)
    width = 4.0 * np.bincount(face, weights=mesh.areas, minlength=count) / np.maximum(perimeter, 1e-300)
    own_face = np.repeat(face, 3)
    own_width, fan = width[own_face], fans.ravel()
    widest, first = np.zeros(fan.max(initial=-1) + 1), np.zeros(fan.max(initial=-1) + 1, dtype=np.int64)
    np.maximum.at(widest, fan, own_width)
    is_widest = own_width >= widest[fan]
    np.maximum.at(first, fan[is_widest], own_face[is_widest].astype(np.int64))
    second = np.zeros(len(widest))
    other = own_face != first[fan]
    np.maximum.at(second, fan[other], own_width[other])
    rules = (second > 0.0) & (widest >= _FLAT_RATIO * second)
    plane = np.column_stack([np.bincount(face, weights=mesh.area_vectors[:, k], minlength=count) for k in range(3)])
    plane = plane / np.maximum(np.linalg.norm(plane, axis=1), 1e-300)[:, None]
    return np.asarray(np.where(rules[fans][:, :, None], plane[first[fans]], normals))


def _with_tips(mesh: Mesh, left_out: Flags, fans: Ints, normals: Floats) -> Floats:
    """Normals with each facet's own at the tips of cones.

    Along an edge of a smooth surface both ends see the same bend (to first order); at a cone's tip only the tip does.
    left_out : (m, 3) bool   edges that say nothing
    """
    following = np.roll(normals, -1, axis=1)
    along = np.roll(mesh.corners, -1, axis=1) - mesh.corners
    length = np.linalg.norm(along, axis=2)
    along = along / np.maximum(length, 1e-300)[:, :, None]
    at_start = -np.einsum("mkd,mkd->mk", normals, along)
    at_end = np.einsum("mkd,mkd->mk", following, along)
    rows = np.flatnonzero(~left_out)
    fan = np.concatenate([fans.ravel()[rows], np.roll(fans, -1, axis=1).ravel()[rows]])
    near = np.concatenate([at_start.ravel()[rows], at_end.ravel()[rows]])
    far = np.concatenate([at_end.ravel()[rows], at_start.ravel()[rows]])
    is_tip = (np.abs(near) > _APEX_BEND) & (np.abs(far) < _APEX_RATIO * np.abs(near))
    size = int(fans.max(initial=-1)) + 1
    seen = np.bincount(fan, minlength=size)
    says_tip = np.bincount(fan, weights=is_tip.astype(np.float64), minlength=size)
    tips = (seen >= 3) & (says_tip >= seen)
    return np.where(tips[fans][:, :, None], mesh.normals[:, None, :], normals)


def edge_curves(surface: SmoothSurface, facet: Ints, edge: Ints) -> tuple[Floats, Floats, Floats]:
    """The cubic over each edge, and the surface's normals at its ends on both sides.

    facet, edge : (n,) int64   edge k of facet f, run from its vertex k to k + 1
    Returns Bézier points (n, 4, 3) mm, normals at both ends in this facet (n, 2, 3) and in the one across (n, 2, 3).
    A smooth edge leaves its ends along the projection of the edge on the tangent planes (curved PN triangles), a
    crease along the cross product of both sides' normals. Handles of equal speed (paper Eq. 5), with which an edge over
    a circular arc is on it to sixth order; the third of the edge that PN triangles use is of fourth.
    Source: Vlachos, Peters, Boyd, Mitchell, Curved PN triangles, I3D 2001; paper Eqs. 5-7.
    """
    mesh = surface.mesh
    ends = mesh.facets[np.repeat(facet[:, None], 2, axis=1), np.column_stack([edge, (edge + 1) % 3])]
    start, end = mesh.vertices[ends[:, 0]], mesh.vertices[ends[:, 1]]
    own = np.stack([surface.normals[facet, edge], surface.normals[facet, (edge + 1) % 3]], axis=1)
    mate = mesh.half_edge_mates[3 * facet + edge]
    other_facet, other_edge = np.where(mate >= 0, mate // 3, facet), np.where(mate >= 0, mate % 3, edge)
    turned = np.where(mate >= 0, (other_edge + 1) % 3, other_edge)
    back = np.where(mate >= 0, other_edge, (other_edge + 1) % 3)
    other = np.stack([surface.normals[other_facet, turned], surface.normals[other_facet, back]], axis=1)
    along = end - start
    length = np.linalg.norm(along, axis=1)[:, None]
    unit = along / np.maximum(length, 1e-300)
    mean = _unit(own + other)
    on_plane = unit[:, None, :] - np.einsum("nd,nkd->nk", unit, mean)[:, :, None] * mean
    on_crease = np.cross(own, other)
    on_crease *= np.sign(np.einsum("nd,nkd->nk", unit, on_crease))[:, :, None]
    is_crease = surface.creases[facet, edge]
    tangent = _unit(np.where(is_crease[:, None, None], on_crease, on_plane))
    off_edge = np.linalg.norm(tangent - unit[:, None, :], axis=2)
    parts = (off_edge <= _STRAIGHT_RAD) | (np.einsum("nd,nkd->nk", unit, tangent) < _STEEPEST)
    tangent[parts] = np.repeat(unit[:, None, :], 2, axis=1)[parts]
    handle = equal_speed(along, tangent[:, 0], tangent[:, 1])[:, None] / 3.0
    bezier = np.stack([start, start + handle * tangent[:, 0], end - handle * tangent[:, 1], end], axis=1)
    return bezier, own, other


def bezier_at(bezier: Floats, t: Floats) -> tuple[Floats, Floats]:
    """Points and derivatives of cubics, one parameter each.  bezier : (n, 4, d)  t : (n,)  Returns (n, d), (n, d)."""
    s, u = (1.0 - t)[:, None], t[:, None]
    p0, p1, p2, p3 = (bezier[:, k] for k in range(4))
    point = s**3 * p0 + 3.0 * s * s * u * p1 + 3.0 * s * u * u * p2 + u**3 * p3
    slope = 3.0 * (s * s * (p1 - p0) + 2.0 * s * u * (p2 - p1) + u * u * (p3 - p2))
    return np.asarray(point), np.asarray(slope)


def _unit(vectors: Floats) -> Floats:
    """Vectors of length 1; zero stays zero.  (..., 3)."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0))
