"""Regions thinner than a bead: the line along their middle, from the Voronoi diagram of their outline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import Voronoi
from shapely import MultiPolygon, Polygon

from planner.nurbs.offset import inset, outset

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_SPACING = 0.12  # of the bead's width: outline samples; the middle line wavers by less than a tenth of that
_CORNER = 0.5  # of the bead's width: corners sharper than about 37 degrees reach farther and count as thin walls
_LEAST_AREA = 0.02  # of the width squared
_MOST_ARMS = 50  # of one piece: a grating of more walls than that is planned without its shortest ones
_LEAST_LENGTH = 0.5  # of the bead's width: shorter middles are corners of thicker regions


@dataclass(frozen=True)
class ThinPart:
    """A piece of a region in which no whole bead fits side by side.

    area : the piece   lines : (n, 2) float mm each, along its middle   closed : whether each line is a loop
    """

    area: Polygon
    lines: tuple[Floats, ...]
    closed: tuple[bool, ...]

    @property
    def width_mm(self) -> float:
        """Mean width: area by length of the middle, mm."""
        length = sum(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in self.lines)
        return float(self.area.area) / length if length else 0.0


def thin_parts(region: MultiPolygon, width_mm: float) -> list[ThinPart]:
    """The pieces of a region that a bead of this width, kept inside the outline, cannot reach.

    Corners, which every round bead leaves, are no pieces: they end less than half a width from where beads reach.
    """
    reached = outset(inset(region, 0.5 * width_mm), 0.5 * width_mm + 1e-3)
    far = shapely.buffer(reached, _CORNER * width_mm)
    found = []
    for piece in shapely.get_parts(shapely.difference(region, reached)):
        if piece.geom_type != "Polygon" or shapely.difference(piece, far).area < _LEAST_AREA * width_mm**2:
            continue
        lines, closed = _middle_lines(piece, width_mm)
        if lines:
            found.append(ThinPart(piece, tuple(lines), tuple(closed)))
    return found


def _middle_lines(piece: Polygon, width_mm: float) -> tuple[list[Floats], list[bool]]:
    """Longest lines of the piece's skeleton: a loop for a closed wall, else the longest path, side arms after it."""
    points, ends, lengths = _skeleton(piece, _SPACING * min(width_mm, max(2.0 * piece.area / piece.length, 0.05)))
    if not len(ends):
        return [], []
    lines: list[Floats] = []
    closed: list[bool] = []
    left = np.ones(len(ends), dtype=bool)
    for _ in range(_MOST_ARMS):
        path, is_loop = _longest(points, ends[left], lengths[left])
        line = points[path] if is_loop else _without_forks(points[path], piece)
        length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
        if length < max(_LEAST_LENGTH * width_mm, 2.0 * piece.area / piece.length):
            break
        lines.append(_smoothed(line, is_loop))
        closed.append(is_loop)
        used = np.zeros(len(points), dtype=bool)
        used[path] = True
        left &= ~(used[ends[:, 0]] & used[ends[:, 1]])
        if not left.any():
            break
    return lines, closed


def _skeleton(piece: Polygon, spacing_mm: float) -> tuple[Floats, Ints, Floats]:
    """Voronoi points and edges well inside the piece: (n, 2) mm, (m, 2) point numbers, (m,) lengths mm."""
    outline = shapely.get_coordinates(shapely.segmentize(piece.boundary, spacing_mm))
    sites = np.unique(np.round(outline, 9), axis=0)
    if len(sites) < 4:
        return np.empty((0, 2)), np.empty((0, 2), dtype=np.int64), np.empty(0)
    diagram = Voronoi(sites, qhull_options="Qbb Qc Qz")
    edges = np.asarray(diagram.ridge_vertices, dtype=np.int64)
    owners = np.asarray(diagram.ridge_points)
    bounded = (edges >= 0).all(axis=1)
    edges, owners = edges[bounded], owners[bounded]
    across = np.linalg.norm(sites[owners[:, 0]] - sites[owners[:, 1]], axis=1)
    points = np.asarray(diagram.vertices)
    shapely.prepare(piece)
    inside = shapely.contains_xy(piece, points[:, 0], points[:, 1])
    kept = inside[edges].all(axis=1) & (across > 3.0 * spacing_mm)
    edges = edges[kept]
    return points, edges, np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)


def _longest(points: Floats, edges: Ints, lengths: Floats) -> tuple[Ints, bool]:
    """Point numbers of the longest way through the skeleton; a loop where the largest part is a ring."""
    graph = coo_matrix((np.maximum(lengths, 1e-12), (edges[:, 0], edges[:, 1])), shape=(len(points), len(points))).tocsr()
    count, part = connected_components(graph, directed=False)
    weight = np.bincount(part[edges[:, 0]], weights=lengths, minlength=count)
    first = int(edges[np.flatnonzero(part[edges[:, 0]] == np.argmax(weight))[0], 0])
    far = _farthest(graph, first)[0]
    other, before = _farthest(graph, far)
    path = _walk(before, far, other)
    blocked = np.isin(edges, path[1:-1]).any(axis=1)
    rest = coo_matrix(
        (np.maximum(lengths, 1e-12)[~blocked], (edges[~blocked, 0], edges[~blocked, 1])), shape=graph.shape
    ).tocsr()
    distance, back = dijkstra(rest, directed=False, indices=far, return_predecessors=True)
    if len(path) > 3 and np.isfinite(distance[other]) and distance[other] > 0.5 * lengths.sum() / 4.0:
        return np.concatenate([path, _walk(back, far, other)[::-1][1:]]), True
    return path, False


def _farthest(graph: object, start: int) -> tuple[int, Ints]:
    distance, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    return int(np.argmax(np.where(np.isfinite(distance), distance, -1.0))), before


def _walk(before: Ints, start: int, end: int) -> Ints:
    """Point numbers from start to end along the predecessors."""
    way = [end]
    while way[-1] != start:
        way.append(int(before[way[-1]]))
    return np.array(way[::-1], dtype=np.int64)


def _without_forks(line: Floats, piece: Polygon) -> Floats:
    """The line without its ends that run into corners: there the way to the outline shrinks faster than half the step."""
    clear = np.asarray(shapely.distance(piece.boundary, shapely.points(line)))
    for _ in range(2):
        line, clear = line[::-1], clear[::-1]
        run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        steep = np.flatnonzero(clear - clear[0] > 0.5 * run)
        if len(steep) and steep[-1] < len(line) - 2:
            line, clear = line[steep[-1] :], clear[steep[-1] :]
    return line


def _smoothed(line: Floats, is_loop: bool) -> Floats:
    """The line without what the sampling of the outline made it waver."""
    shape = shapely.LineString(line)
    tolerance = 0.01 * min(shape.length, 1.0)
    return np.asarray(shapely.get_coordinates(shapely.simplify(shape, tolerance)))
