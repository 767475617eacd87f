"""Closed meshes for booleans in space, and back in an order that depends on the shape only."""

from __future__ import annotations

import manifold3d  # type: ignore[import-not-found,unused-ignore]
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from planner.errors import PlanningError
from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]

_SAME_MM = 1e-4  # corners of a section nearer to a straight side are rounding


def solid_of(mesh: Mesh) -> manifold3d.Manifold:
    """A closed mesh as a solid.  Raises PlanningError if it encloses none."""
    solid = manifold3d.Manifold(manifold3d.Mesh64(mesh.vertices.copy(), mesh.facets.astype(np.uint64)))
    if solid.status() != manifold3d.Error.NoError:
        raise PlanningError(
            f"a body of the part encloses no volume that can be reckoned with ({solid.status().name})",
            "check the mesh, or set support = never",
        )
    return solid


def mesh_of_solid(solid: manifold3d.Manifold) -> Mesh:
    """The surface of a solid, mm: vertices by x, y, z, facets by their lowest vertex, whatever order the solid has."""
    raw = solid.to_mesh64()
    points, facets = np.asarray(raw.vert_properties)[:, :3] + 0.0, np.asarray(raw.tri_verts).astype(np.int64)
    order = np.lexsort((points[:, 2], points[:, 1], points[:, 0]))
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.arange(len(order))
    named = number[facets]
    first = np.argmin(named, axis=1)
    turned = np.take_along_axis(named, (first[:, None] + np.arange(3)) % 3, axis=1)
    return Mesh(points[order], turned[np.lexsort((turned[:, 2], turned[:, 1], turned[:, 0]))])


def prism(region: MultiPolygon, low_mm: float, high_mm: float) -> manifold3d.Manifold:
    """A region of the xy plane, mm, raised from one height to another."""
    rings: list[Floats] = []
    for piece in region.geoms:
        rings.append(shapely.get_coordinates(shapely.geometry.polygon.orient(piece).exterior)[:-1])
        rings += [shapely.get_coordinates(ring)[:-1] for ring in shapely.geometry.polygon.orient(piece).interiors]
    flat = manifold3d.CrossSection(rings, manifold3d.FillRule.Positive)
    return flat.extrude(high_mm - low_mm).translate((0.0, 0.0, low_mm))


def under(mesh: Mesh, facets: NDArray[np.int64], floor_mm: float) -> manifold3d.Manifold:
    """What lies straight below some facets that look down, to a level below all of them.  Empty if they fold over."""
    used, named = np.unique(mesh.facets[facets], return_inverse=True)
    top = named.reshape(-1, 3)[:, ::-1]
    count = len(used)
    edges = np.vstack([top[:, [0, 1]], top[:, [1, 2]], top[:, [2, 0]]])
    there = set(map(tuple, edges.tolist()))
    rim = np.array([edge for edge in edges.tolist() if (edge[1], edge[0]) not in there], dtype=np.int64).reshape(-1, 2)
    a, b = rim[:, 0], rim[:, 1]
    walls = np.vstack([np.column_stack([b, a, a + count]), np.column_stack([b, a + count, b + count])])
    upper = mesh.vertices[used]
    lower = np.column_stack([upper[:, :2], np.full(count, floor_mm)])
    body = np.vstack([top, top[:, ::-1] + count, walls])
    solid = manifold3d.Manifold(manifold3d.Mesh64(np.vstack([upper, lower]), body.astype(np.uint64)))
    return solid if solid.status() == manifold3d.Error.NoError else manifold3d.Manifold()


def silhouette(solid: manifold3d.Manifold) -> MultiPolygon:
    """What a solid covers, seen along z, mm."""
    return _area_of(manifold3d.CrossSection(solid.project().to_polygons(), manifold3d.FillRule.Positive))


def section(solid: manifold3d.Manifold, height_mm: float) -> MultiPolygon:
    """What a solid has at a height, mm."""
    return _area_of(solid.slice(height_mm))


def _area_of(flat: manifold3d.CrossSection) -> MultiPolygon:
    """A flat section as regions with holes."""
    pieces: list[Polygon] = []
    for piece in flat.simplify(_SAME_MM).decompose():
        rings = sorted((np.asarray(ring) for ring in piece.to_polygons()), key=lambda ring: -Polygon(ring).area)
        if rings:
            pieces.append(Polygon(rings[0], rings[1:]))
    whole = MultiPolygon(pieces)
    return whole if whole.is_valid else polygons(shapely.union_all([shapely.make_valid(piece) for piece in pieces]))


def polygons(shape: shapely.Geometry) -> MultiPolygon:
    """The polygons of any geometry."""
    return MultiPolygon([piece for piece in shapely.get_parts(shape) if piece.geom_type == "Polygon"])
