"""One closed mesh from the walls of a stack of layers: strips along the walls, planar faces where neighbours differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from planner.errors import PlanningError
from planner.matching.walls import LayerWalls
from planner.mesh.mesh import Mesh
from planner.model.caps import face_triangles, planar_faces
from planner.model.noding import noded
from planner.model.rings import Ring, RingTable, own_ring, shared_ring, wall_tables
from planner.model.strips import wall_triangles
from planner.slicing.section import plane_frame

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_WELD = 2.0  # of the chord error: contours above and below a plane that lie nearer are one
_DRAWN = 0.5  # of the chord error: vertices of different contours that lie nearer are one
_WIDTH = 0.25  # of the chord error: along a ring, what counts as one place

WALL = -1
"""What stands in `ClosedModel.face` for a facet of a wall."""


@dataclass(frozen=True, eq=False)
class PlanarFace:
    """A bottom, top or ledge.  plane : number of the plane, from below;  side : +1 faces along its normal, -1 against it.

    rings : (n, 3) float, mm each, the outer one first, counter-clockwise about the plane's normal, holes clockwise
    """

    plane: int
    side: int
    rings: tuple[Floats, ...]


@dataclass(frozen=True, eq=False)
class ClosedModel:
    """A watertight mesh and where its facets come from.

    layer : (m,) int64   layer of a wall's facet; of a planar face the number of its plane
    wall : (m,) int64    number of the wall in its layer; WALL for planar faces
    faces : the planar faces
    """

    mesh: Mesh
    layer: Ints
    wall: Ints
    faces: tuple[PlanarFace, ...]


class _Stack:
    """Vertices and triangles as they are collected."""

    def __init__(self, chord_mm: float) -> None:
        self.chord_mm = chord_mm
        self.points: list[Floats] = []
        self.count = 0
        self.triangles: list[Ints] = []
        self.layer: list[Ints] = []
        self.wall: list[Ints] = []
        self.faces: list[PlanarFace] = []

    def add_points(self, points: Floats) -> None:
        self.points.append(points)
        self.count += len(points)

    def add_triangles(self, triangles: Ints, layer: int, wall: int) -> None:
        self.triangles.append(triangles)
        self.layer.append(np.full(len(triangles), layer))
        self.wall.append(np.full(len(triangles), wall))


def closed_model(layers: Sequence[LayerWalls], chord_mm: float) -> ClosedModel:
    """The solid between the walls of layers that lie on each other, as one watertight mesh.

    layers : from below; the top plane of each is the bottom plane of the next.  chord_mm : largest distance, mm, between
    the triangles and the walls' surfaces. A contour that the walls on both sides of a plane share is sampled once for
    both; where the solids on both sides differ, planar faces close them (their symmetric difference).
    Raises PlanningError if there is no wall, or the result is not closed.
    """
    if not any(layer.walls for layer in layers):
        raise PlanningError("there is no wall to build a model from", "slice the part with more layers")
    stack = _Stack(chord_mm)
    tables = [[wall_tables(wall.surface, chord_mm) for wall in layer.walls] for layer in layers]
    lower: list[Ring] = []
    for number in range(len(layers) + 1):
        tops = [pair[1] for pair in tables[number - 1]] if number else []
        bottoms = [pair[0] for pair in tables[number]] if number < len(layers) else []
        plane = layers[number].bottom_plane if number < len(layers) else layers[-1].top_plane
        upper_ends, next_lower = _plane_rings(stack, plane, number, tops, bottoms)
        for k, (low, high) in enumerate(zip(lower, upper_ends, strict=True)):
            stack.add_triangles(wall_triangles(low, high, _WIDTH * chord_mm), number - 1, k)
        lower = next_lower
    return _finished(stack)


def _plane_rings(
    stack: _Stack, plane: Floats, number: int, tops: list[RingTable], bottoms: list[RingTable]
) -> tuple[list[Ring], list[Ring]]:
    """Rings for the walls below (tops) and above (bottoms) a plane; the planar faces between them go to the stack."""
    found_top: dict[int, Ring] = {}
    found_bottom: dict[int, Ring] = {}
    for k, low in enumerate(tops):
        for j, high in enumerate(bottoms):
            if j in found_bottom:
                continue
            shared = shared_ring(low, high, _WELD * stack.chord_mm, stack.count)
            if shared is not None:
                found_top[k], found_bottom[j] = shared[0], shared[1]
                stack.add_points(shared[2])
                break
    loose_top = [k for k in range(len(tops)) if k not in found_top]
    loose_bottom = [j for j in range(len(bottoms)) if j not in found_bottom]
    tables = [*(tops[k] for k in loose_top), *(bottoms[j] for j in loose_bottom)]
    rings = _noded_rings(stack, plane, number, tables, len(loose_top)) if tables else []
    found_top.update(zip(loose_top, rings[: len(loose_top)], strict=True))
    found_bottom.update(zip(loose_bottom, rings[len(loose_top) :], strict=True))
    return [found_top[k] for k in range(len(tops))], [found_bottom[j] for j in range(len(bottoms))]


def _noded_rings(stack: _Stack, plane: Floats, number: int, tables: list[RingTable], below: int) -> list[Ring]:
    """Rings that end on one side of the plane only, cut at each other, and the planar faces that they leave."""
    frame = plane_frame(plane)
    own = [own_ring(table, 0) for table in tables]
    first = np.cumsum([0, *(len(points) for _, points in own)])
    xy = (np.concatenate([points for _, points in own]) - frame[0]) @ frame[1:3].T + 0.0
    given = [np.arange(a, b) for a, b in pairwise(first.tolist())]
    points, cut = noded(xy, given, _DRAWN * stack.chord_mm)
    space = frame[0] + points @ frame[1:3]
    base = stack.count
    stack.add_points(space)
    rings = []
    for (ring, _), (ids, place) in zip(own, cut, strict=True):
        s = np.append(ring.s, ring.s[0] + ring.table.length_mm)
        rings.append(Ring(ring.table, base + ids, np.interp(place, np.arange(len(s)), s)))
    loops = [ids for ids, _ in cut if len(ids) > 1]
    lower = [ids for ids, _ in cut[:below] if len(ids) > 1]
    for outline, side in planar_faces(points, lower, loops[len(lower) :]):
        stack.add_triangles(base + face_triangles(points, outline, side), number, WALL)
        stack.faces.append(PlanarFace(number, side, tuple(space[ids] for ids in outline)))
    return rings


def _finished(stack: _Stack) -> ClosedModel:
    facets = np.concatenate(stack.triangles)
    used, facets = np.unique(facets, return_inverse=True)
    mesh = Mesh(np.concatenate(stack.points)[used], facets.reshape(-1, 3))
    if not mesh.is_closed:
        place = mesh.centroids[int(np.flatnonzero((mesh.edge_state != 0).any(axis=1))[0])]
        raise PlanningError(
            f"the model does not close near ({place[0]:.4g}, {place[1]:.4g}, {place[2]:.4g}) mm",
            "choose another chord error or build direction",
        )
    mesh = _with_own_fans(mesh)
    return ClosedModel(mesh, np.concatenate(stack.layer), np.concatenate(stack.wall), tuple(stack.faces))


def _with_own_fans(mesh: Mesh) -> Mesh:
    """The mesh with a vertex of its own for each fan of facets around it: where parts touch in a vertex or along an edge,
    they do not share it, so that every edge has two facets."""
    count = 3 * len(mesh.facets)
    half = np.arange(count)
    mate = mesh.across.astype(np.int64)
    end = mate // 3 * 3 + (mate % 3 + 1) % 3  # the corner at which the other half-edge ends: where this one begins
    links = coo_array((np.ones(count, dtype=np.int8), (half, end)), shape=(count, count))
    fans, fan = connected_components(links, directed=False)
    if fans == len(mesh.vertices):
        return mesh
    vertices = np.empty((fans, 3))
    vertices[fan] = mesh.vertices[mesh.facets.ravel()]
    return Mesh(vertices, fan.reshape(-1, 3))
