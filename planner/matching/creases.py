"""Corners of two contours that one crease of the mesh joins."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from planner.matching.outline import Outline
from planner.matching.slab import Slab
from planner.mesh.mesh import Mesh
from planner.mesh.smooth import smooth_surface
from planner.slicing.section import Loop

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Neighbours = dict[int, list[int]]
Place = tuple[int, int]

_NEAR = 1e-2  # of the contour's size: a corner of the curve this near to a point of the section is that point

_graphs: WeakKeyDictionary[Mesh, dict[float, Neighbours]] = WeakKeyDictionary()


def crease_graph(mesh: Mesh, crease_deg: float) -> Neighbours:
    """For each vertex on a crease the vertices at the other ends of its creases; kept as long as the mesh."""
    known = _graphs.setdefault(mesh, {})
    if crease_deg not in known:
        facet, edge = np.nonzero(smooth_surface(mesh, crease_deg).creases)
        tail, head = mesh.facets[facet, edge], mesh.facets[facet, (edge + 1) % 3]
        graph: Neighbours = {}
        for a, b in np.unique(np.sort(np.column_stack([tail, head]), axis=1), axis=0).tolist():
            graph.setdefault(a, []).append(b)
            graph.setdefault(b, []).append(a)
        known[crease_deg] = graph
    return known[crease_deg]


def corner_anchors(graph: Neighbours, slab: Slab, loops: tuple[Loop, Loop], outlines: tuple[Outline, Outline]) -> Floats:
    """Corners of a bottom and a top contour that one chain of creases joins: (a, 2, 2) float for `match_outlines`.

    loops, outlines : of the bottom and the top. Rows are in the order of both contours; chains that end, part or would
    cross others inside the slab join nothing.
    """
    corners = [_corner_edges(loop, outline) for loop, outline in zip(loops, outlines, strict=True)]
    if not corners[0] or not corners[1]:
        return np.empty((0, 2, 2))
    rows: list[tuple[float, float]] = []
    for edge, u in corners[0].items():
        reached = _follow(graph, slab, edge)
        if reached in corners[1]:
            rows.append((u, corners[1][reached]))
    pairs = np.array(sorted(rows)).reshape(-1, 2)
    pairs = pairs[_in_order(pairs[:, 1])]
    anchors = np.empty((len(pairs), 2, 2))
    for k, outline in enumerate(outlines):
        anchors[:, k, 0] = outline.measure(np.where(pairs[:, k] == 0.0, 1.0, pairs[:, k]), False)
        anchors[:, k, 1] = outline.measure(pairs[:, k], True)
        anchors[:, k, 1] += np.where(anchors[:, k, 1] < anchors[:, k, 0], 1.0, 0.0)
    return anchors


def _corner_edges(loop: Loop, outline: Outline) -> dict[Place, float]:
    """Mesh edge (a < b), or vertex (a, a), that each corner of the curve lies on, with the corner's parameter."""
    if not len(outline.corners):
        return {}
    places = outline.curve.evaluate(outline.corners)
    apart = np.linalg.norm(loop.points[None, :, :] - places[:, None, :], axis=2)
    nearest = np.argmin(apart, axis=1)
    near = apart[np.arange(len(nearest)), nearest] <= _NEAR * float(np.ptp(loop.points, axis=0).max())
    edges, weights = loop.edges[nearest], loop.weights[nearest, None]
    ends = np.where(weights <= 0.0, edges[:, :1], np.where(weights >= 1.0, edges[:, 1:], edges))
    return {
        (int(a), int(b)): float(u) for (a, b), u, is_near in zip(ends, outline.corners, near, strict=True) if is_near
    }


def _follow(graph: Neighbours, slab: Slab, place: Place) -> Place | None:
    """Where the crease that crosses the bottom plane at `place` crosses the top plane; None if it does not."""
    low, high = sorted(place, key=lambda v: float(slab.above[v]))
    if low == high:
        upward = [v for v in graph.get(low, ()) if slab.above[v] > 0.0]
        if len(upward) != 1:
            return None
        high = upward[0]
    elif high not in graph.get(low, ()):
        return None
    for _ in range(len(graph)):
        if slab.below[high] < 0.0:
            return (min(low, high), max(low, high))
        if slab.below[high] == 0.0:
            return (high, high)
        onward = [v for v in graph[high] if v != low]
        if len(onward) != 1 or slab.above[high] <= 0.0:
            return None
        low, high = high, onward[0]
    return None


def _in_order(values: Floats) -> Ints:
    """Rows of the longest run of values that goes round in order, started at each place in turn."""
    best: list[int] = []
    for start in range(len(values)):
        run = [start]
        last = 0.0
        for step in range(1, len(values)):
            row = (start + step) % len(values)
            on = float((values[row] - values[start]) % 1.0)
            if on > last:
                run.append(row)
                last = on
        if len(run) > len(best):
            best = run
        if len(best) == len(values):
            break
    return np.array(sorted(best), dtype=np.int64)
