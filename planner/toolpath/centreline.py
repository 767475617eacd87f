"""Regions too narrow for two beads: the line along their middle and their width, from a Voronoi diagram."""

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
_BEYOND = 1.5  # of the width: how far into wider parts the skeleton is made, beyond what its ends fork in
_REACH = 0.25  # of the width: how far a middle line runs into the wider part
_DEAD_END = 1.7  # times the way to the side: an outline that near ahead is the region's end
_FULL_END = 0.5  # of the width: half a bead, whose round end leaves little in square corners
_LEAST_STEP_MM = 0.5  # between the places where the width is measured
_LEAST_CORE = 0.06  # of the width squared: where beads side by side begin to fit in a smaller spot only, one bead goes on
_LEAST_LENGTH = 0.5  # of the bead's width: shorter middles are corners of thicker regions


@dataclass(frozen=True)
class MiddleLine:
    """points : (n, 2) float, mm, along the middle   widths_mm : (n,) float, of the region there   closed : a loop."""

    points: Floats
    widths_mm: Floats
    closed: bool

    @property
    def length_mm(self) -> float:
        """Length of the line, mm."""
        return _length(self.points)


@dataclass(frozen=True)
class ThinPart:
    """A piece of a region in which one bead takes the place of two side by side.

    area : the piece   lines : along its middle.
    """

    area: Polygon
    lines: tuple[MiddleLine, ...]

    @property
    def width_mm(self) -> float:
        """Mean width: area by length of the middle, mm."""
        length = sum(line.length_mm for line in self.lines)
        return float(self.area.area) / length if length else 0.0


def thin_parts(region: MultiPolygon, width_mm: float, widest_mm: float | None = None) -> list[ThinPart]:
    """The pieces of a region that are narrower than `widest_mm` (default: the bead's width).

    Corners, which every round bead leaves, are no pieces: they end less than half a width from where beads reach.
    """
    radius = 0.5 * (width_mm if widest_mm is None else widest_mm)
    cores = [core for core in inset(region, radius).geoms if core.area >= _LEAST_CORE * width_mm**2]
    reached = outset(MultiPolygon(cores), radius + 1e-3)
    far = shapely.buffer(reached, _CORNER * width_mm)
    outline = region.boundary
    shapely.prepare(outline)
    found = []
    for piece in shapely.get_parts(shapely.difference(region, reached)):
        if piece.geom_type != "Polygon" or shapely.difference(piece, far).area < _LEAST_AREA * width_mm**2:
            continue
        lines = _middle_lines(piece, region, outline, width_mm)
        if lines:
            found.append(ThinPart(piece, tuple(lines)))
    return found


def _middle_lines(
    piece: Polygon, region: MultiPolygon, outline: shapely.Geometry, width_mm: float
) -> list[MiddleLine]:
    """Longest lines of the skeleton in the piece: a loop for a closed wall, else the longest path, side arms after it.

    The skeleton is that of the region round the piece, so that it runs on where the piece ends in a wider part.
    """
    zone = shapely.intersection(region, shapely.buffer(piece, _BEYOND * width_mm))
    thickness = max(2.0 * piece.area / piece.length, 0.05)
    points, ends, lengths = _skeleton(zone, _SPACING * min(width_mm, thickness))
    within = shapely.buffer(piece, _REACH * width_mm)
    shapely.prepare(within)
    if len(ends):
        middles = 0.5 * (points[ends[:, 0]] + points[ends[:, 1]])
        kept = shapely.contains_xy(within, middles[:, 0], middles[:, 1])
        ends, lengths = ends[kept], lengths[kept]
    lines: list[MiddleLine] = []
    left = np.ones(len(ends), dtype=bool)
    for _ in range(_MOST_ARMS):
        if not left.any():
            break
        path, is_loop = _longest(points, ends[left], lengths[left])
        line = points[path] if is_loop else _without_forks(points[path], outline)
        if _length(line) < max(_LEAST_LENGTH * width_mm, thickness):
            break
        smooth = _smoothed(line if is_loop else _to_the_end(line, outline, width_mm))
        widths = 2.0 * np.asarray(shapely.distance(outline, shapely.points(smooth)))
        if not is_loop:
            widths[[0, -1]] = widths[[1, -2]]
        lines.append(MiddleLine(smooth, widths, is_loop))
        used = np.zeros(len(points), dtype=bool)
        used[path] = True
        left &= ~(used[ends[:, 0]] & used[ends[:, 1]])
    return lines


def _length(line: Floats) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def _skeleton(piece: shapely.Geometry, spacing_mm: float) -> tuple[Floats, Ints, Floats]:
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


def _without_forks(line: Floats, outline: shapely.Geometry) -> Floats:
    """The line without its ends that run into corners: there the way to the outline shrinks faster than half the step."""
    clear = np.asarray(shapely.distance(outline, shapely.points(line)))
    for _ in range(2):
        line, clear = line[::-1], clear[::-1]
        run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        steep = np.flatnonzero(clear - clear[0] > 0.5 * run)
        if len(steep) and steep[-1] < len(line) - 2:
            line, clear = line[steep[-1] :], clear[steep[-1] :]
    return line


def _to_the_end(line: Floats, outline: shapely.Geometry, width_mm: float) -> Floats:
    """The line run on, at dead ends, until the round end of a bead as wide as the region there meets the outline.

    Wide beads run on a little farther, so that they leave no more in the end's corners than narrow ones.
    """
    for _ in range(2):
        line = line[::-1]
        clear = float(shapely.distance(outline, shapely.Point(line[-1])))
        back = np.linalg.norm(line - line[-1], axis=1)
        start = line[np.flatnonzero(back >= min(clear, 0.9 * back.max()))[-1]]
        ahead = (line[-1] - start) / max(float(np.linalg.norm(line[-1] - start)), 1e-9)
        way = shapely.LineString([line[-1], line[-1] + _DEAD_END * clear * ahead])
        met = shapely.intersection(way, outline)
        if met.is_empty:
            continue
        on = float(shapely.distance(met, shapely.Point(line[-1]))) - clear
        on += max(0.5 * (clear - _FULL_END * width_mm), 0.0)
        if on > 1e-3:
            line = np.vstack([line, line[-1] + on * ahead])
    return line


def _smoothed(line: Floats) -> Floats:
    """The line without what the sampling of the outline made it waver; no stretch longer than a twentieth of it."""
    shape = shapely.LineString(line)
    thinned = shapely.simplify(shape, 0.01 * min(shape.length, 1.0))
    return np.asarray(shapely.get_coordinates(shapely.segmentize(thinned, max(0.05 * shape.length, _LEAST_STEP_MM))))
