"""How far the walls of a layer lie from the mesh between its planes, both ways."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.matching.walls import LayerWalls
from planner.mesh.mesh import Mesh
from planner.mesh.nearest import FacetTree
from planner.nurbs.ruled import RuledSurface
from planner.slicing.slicer import slice_mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Of a ruling, where it is measured: a chord is farthest from its arc half-way, a third-order difference a quarter off."""
_LEAST_AREA = 1e-12  # of the largest triangle: where one contour stands still, triangles have no area
_PER_PIECE, _MOST_PER_PIECE = 2, 64  # places along each piece
_FLAT = 1e-5  # of the ring's size: how far the triangles may lie from the ruled surface


@dataclass(frozen=True, eq=False)
class WallDeviation:
    """Distances between walls and mesh inside one layer, mm.

    wall_to_mesh : (a,) float   of points of the walls from the mesh, 5 on each ruling measured
    mesh_to_wall : (b,) float   of the mesh's section points and vertices strictly inside the layer from the walls
    rim_mm : of contours from the mesh in their own planes, and of the mesh's sections there from the walls: what no
        thinner layer can better
    is_swept : whether the largest of wall_to_mesh lies on a wall that goes straight, having no partner
    """

    wall_to_mesh: Floats
    mesh_to_wall: Floats
    rim_mm: tuple[float, float] = (0.0, 0.0)
    is_swept: bool = False

    @property
    def max_mm(self) -> float:
        """The largest of both, mm; 0 where there is nothing to measure."""
        return max(float(self.wall_to_mesh.max(initial=0.0)), float(self.mesh_to_wall.max(initial=0.0)))

    @property
    def p99_mm(self) -> float:
        """99th percentile, of the way that has the larger one, mm."""
        ways = [np.percentile(way, 99.0) for way in (self.wall_to_mesh, self.mesh_to_wall) if len(way)]
        return float(max(ways, default=0.0))


def wall_deviation(layer_walls: LayerWalls, mesh: Mesh, tree: FacetTree | None = None) -> WallDeviation:
    """Two-way distance between a layer's walls and the mesh inside the layer.

    tree : of the mesh, to measure many layers quickly. Level ledges at the two planes belong to the planar faces, not
    to the walls: mesh vertices in the planes are not measured.
    """
    if not layer_walls.walls:
        return WallDeviation(np.empty(0), np.empty(0))
    body = wall_mesh(layer_walls)
    outward = (tree or FacetTree(mesh)).nearest(body.vertices)[0]
    inner, rim_points = _mesh_points(layer_walls, mesh)
    away = FacetTree(body).nearest(np.concatenate([inner, rim_points]))[0]
    own, is_swept = _rims(layer_walls, outward)
    return WallDeviation(outward, away[: len(inner)], (own, float(away[len(inner) :].max(initial=0.0))), is_swept)


def _rims(layer_walls: LayerWalls, outward: Floats) -> tuple[float, bool]:
    """Greatest distance of the contours in their own planes, mm, and whether the greatest of all is a swept wall's.

    outward : (a,) float, mm, of the vertices of `wall_mesh`, wall by wall.
    """
    rim, worst, is_swept, start = 0.0, -1.0, False, 0
    for wall in layer_walls.walls:
        count = len(_SHARES) * len(_places_along(wall.surface))
        away = outward[start : start + count].reshape(len(_SHARES), -1)
        start += count
        swept = wall.how == "swept"
        if not swept or (wall.bottom and not wall.top):
            rim = max(rim, float(away[0].max()))
        if not swept or (wall.top and not wall.bottom):
            rim = max(rim, float(away[-1].max()))
        if float(away.max()) > worst:
            worst, is_swept = float(away.max()), swept
    return rim, is_swept


def wall_mesh(layer_walls: LayerWalls) -> Mesh:
    """The walls alone as triangles: an open mesh, outside to the right of the contours' direction."""
    vertices, facets, count = [], [], 0
    for wall in layer_walls.walls:
        grid, cells = ring_triangles(wall.surface)
        vertices.append(grid)
        facets.append(cells + count)
        count += len(grid)
    body = Mesh(np.concatenate(vertices), np.concatenate(facets))
    return Mesh(body.vertices, body.facets[body.areas > _LEAST_AREA * body.areas.max()])


def ring_triangles(surface: RuledSurface) -> tuple[Floats, Ints]:
    """Vertices (n, 3) mm and triangles (m, 3) of one closed ring, finer along it than across."""
    u = _places_along(surface)
    first, last = surface.curve0.evaluate(u), surface.curve1.evaluate(u)
    v = np.array(_SHARES)[:, None, None]
    grid = (1.0 - v) * first + v * last
    rows, columns = len(_SHARES), len(u)
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b = number[:-1].ravel(), np.roll(number, -1, axis=1)[:-1].ravel()
    c, d = np.roll(number, -1, axis=1)[1:].ravel(), number[1:].ravel()
    facets = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return grid.reshape(-1, 3), facets


def _places_along(surface: RuledSurface) -> Floats:
    """Parameters (k,) of the rulings between which triangles lie near the surface: closer where it bends or twists."""
    breaks = surface.curve0.breaks
    low, high = surface.curve0.evaluate(breaks), surface.curve1.evaluate(breaks)
    middle = 0.5 * (breaks[:-1] + breaks[1:])
    sag = [
        np.linalg.norm(curve.evaluate(middle) - 0.5 * (ends[:-1] + ends[1:]), axis=1)
        for curve, ends in ((surface.curve0, low), (surface.curve1, high))
    ]
    twist = np.linalg.norm(np.diff(high - low, axis=0), axis=1) / (4.0 * (len(_SHARES) - 1))
    near = _FLAT * max(float(np.linalg.norm(np.ptp(np.vstack([low, high]), axis=0))), 1e-300)
    parts = np.ceil(np.maximum(np.sqrt(np.maximum(*sag) / near), twist / near))
    parts = np.clip(parts, _PER_PIECE, _MOST_PER_PIECE).astype(np.intp)
    piece = np.repeat(np.arange(len(parts)), parts)
    step = np.arange(len(piece)) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.asarray(breaks[piece] + step / parts[piece] * np.diff(breaks)[piece])


def _mesh_points(layer_walls: LayerWalls, mesh: Mesh) -> tuple[Floats, Floats]:
    """Points of the mesh inside the layer, on three sections and its vertices; those of contours joined by rulings, in
    the layer's planes."""
    bottom, top = layer_walls.bottom_plane, layer_walls.top_plane
    above, below = (mesh.vertices - bottom[:3]) @ bottom[3:], (top[:3] - mesh.vertices) @ top[3:]
    thickness = abs(float((top[:3] - bottom[:3]) @ bottom[3:]))
    margin = 1e-3 * thickness
    inner = [mesh.vertices[(above > margin) & (below > margin)]]
    planes = np.array([bottom, *(_between(bottom, top, share) for share in _SHARES[1:-1])])
    low, *middle = slice_mesh(mesh, planes, "above")
    high = slice_mesh(mesh, top[None], "below")[0]
    inner += [_with_middles(loop.points) for section in middle for loop in section.loops]
    ruled = [wall for wall in layer_walls.walls if wall.how != "swept"]
    rims = [low.loops[number] for wall in ruled for number in wall.bottom]
    rims += [high.loops[number] for wall in ruled for number in wall.top]
    return np.concatenate(inner), np.concatenate([np.empty((0, 3)), *(_with_middles(loop.points) for loop in rims)])


def _with_middles(points: Floats) -> Floats:
    """(2n, 3) float, mm   Corners of a closed polygon and the middles of its sides."""
    return np.concatenate([points, 0.5 * (points + np.roll(points, -1, axis=0))])


def _between(bottom: Floats, top: Floats, share: float) -> Floats:
    """The plane (6,) at a share of the way from one plane to the other."""
    normal = (1.0 - share) * bottom[3:] + share * top[3:]
    point = (1.0 - share) * bottom[:3] + share * top[:3]
    return np.concatenate([point, normal / np.linalg.norm(normal)])
