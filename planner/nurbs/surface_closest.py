"""The point of a surface nearest to each of many points: a tree of nearly flat patches, then Newton."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from planner.nurbs.closest import box_distance2, checked_points
from planner.nurbs.surface_foot import foot_on_patch
from planner.nurbs.surface_patches import BezierPatches, halve_columns, halve_rows

if TYPE_CHECKING:
    from planner.nurbs.surface import Surface

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

_FLAT = 0.08  # control points of a leaf's rows and columns stray from their chords by this share: 0.6 rad of turn
_TWIST = 0.85  # cosine: tangent planes at a leaf's corners differ by half a radian at most
_TWIST_DEPTH = 8  # halvings for that: along a fold they would never end
_DEPTH = 30  # halvings of a patch at most: near a singular point no leaf is flat


class PatchTree:
    """Patches of a surface, halved until nearly flat, in a tree of boxes."""

    def __init__(self, patches: BezierPatches) -> None:
        """patches : the surface, as Bézier patches."""
        self._rational = patches.rational
        nets, bounds = _leaves(patches.nets, patches.bounds, patches.rational)
        boxes = _leaf_boxes(nets, patches.rational)
        order, self._boxes = _tree(boxes)
        self._nets, self._bounds = nets[order], bounds[order]
        ends = np.array([bounds[:, 0].min(), bounds[:, 1].max(), bounds[:, 2].min(), bounds[:, 3].max()])
        self._rims = (self._bounds == ends) @ np.array([1, 2, 4, 8])

    def nearest(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """Parameters u and v of, and distance to, the surface's point nearest to each point: three (k,) float."""
        return _nearest(self._nets, self._bounds, self._rims, self._boxes, self._rational, points)


def closest_on_surface(surface: Surface, points: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Parameters u and v of, and distance to, the point of the surface nearest to each given point.

    points : (k, d) float, mm   Returns three (k,) float (the distance in mm).
    The nearest of all patches, edges and corners included. Where several are equally near, one of them.
    Raises ValueError if the points have not the surface's dimension or are not finite.
    Source: Piegl & Tiller ch. 6.1 (Eqs. 6.5-6.8), started from every nearly flat patch that can hold the foot.
    """
    return surface.closest_tree.nearest(checked_points(points, surface.dimension))


@njit(cache=True, error_model="numpy", nogil=True)
def _bent2(line: Floats, rational: bool) -> float:
    """How far a row of control points strays from its chord: squared share of its length, at least; 0 if straight."""
    last, dimension = len(line) - 1, line.shape[1] - int(rational)
    w0 = line[0, dimension] if rational else 1.0
    w1 = line[last, dimension] if rational else 1.0
    length2 = 0.0
    for axis in range(dimension):
        length2 += (line[last, axis] / w1 - line[0, axis] / w0) ** 2
    worst = 0.0
    for j in range(1, last):
        weight = line[j, dimension] if rational else 1.0
        along, away2 = 0.0, 0.0
        for axis in range(dimension):
            start = line[0, axis] / w0
            offset = line[j, axis] / weight - start
            along += offset * (line[last, axis] / w1 - start)
            away2 += offset**2
        if along < 0.0 or along > length2:
            return np.inf
        if away2 > 0.0:
            worst = max(worst, (away2 - along * along / length2) / length2)
    return worst


@njit(cache=True, error_model="numpy", nogil=True)
def _edge(net: Floats, rational: bool, i: int, j: int, to_i: int, to_j: int, vector: Floats) -> float:
    """From one control point to another, into vector (d,); returns the squared length."""
    length2 = 0.0
    for axis in range(vector.size):
        start, end = net[i, j, axis], net[to_i, to_j, axis]
        if rational:
            start, end = start / net[i, j, vector.size], end / net[to_i, to_j, vector.size]
        vector[axis] = end - start
        length2 += vector[axis] ** 2
    return length2


@njit(cache=True, error_model="numpy", nogil=True)
def _is_twisted(net: Floats, rational: bool) -> bool:
    """Whether tangent planes at two corners (each as e ∧ f of the edges that meet there) differ by more than _TWIST."""
    dimension = net.shape[2] - int(rational)
    p, q = net.shape[0] - 1, net.shape[1] - 1
    e, f = np.empty((4, dimension)), np.empty((4, dimension))
    areas = np.zeros(4)
    for corner in range(4):
        i, j = (corner // 2) * p, (corner % 2) * q
        low_i, low_j = min(i, p - 1), min(j, q - 1)
        ee = _edge(net, rational, low_i, j, low_i + 1, j, e[corner])
        ff = _edge(net, rational, i, low_j, i, low_j + 1, f[corner])
        area2 = ee * ff - np.sum(e[corner] * f[corner]) ** 2
        areas[corner] = np.sqrt(area2) if area2 > 1e-12 * ee * ff else 0.0
    for one in range(4):
        for other in range(one):
            if areas[one] > 0.0 and areas[other] > 0.0:
                across = np.sum(e[one] * e[other]) * np.sum(f[one] * f[other])
                across -= np.sum(e[one] * f[other]) * np.sum(f[one] * e[other])
                if across < _TWIST * areas[one] * areas[other]:
                    return True
    return False


@njit(cache=True, error_model="numpy", nogil=True)
def _more_bent(net: Floats, rational: bool, depth: int) -> int:
    """0 if the patch is flat enough, else 1 or 2: the direction to halve, in which it is bent more (or is longer)."""
    first, second = 0.0, 0.0
    for j in range(net.shape[1]):
        first = max(first, _bent2(net[:, j], rational))
    for i in range(net.shape[0]):
        second = max(second, _bent2(net[i], rational))
    if max(first, second) > _FLAT**2 and depth < _DEPTH:
        return 1 if first >= second else 2
    if depth >= _TWIST_DEPTH or not _is_twisted(net, rational):
        return 0
    p, q = net.shape[0] - 1, net.shape[1] - 1
    vector = np.empty(net.shape[2] - int(rational))
    along = max(_edge(net, rational, 0, 0, p, 0, vector), _edge(net, rational, 0, q, p, q, vector))
    across = max(_edge(net, rational, 0, 0, 0, q, vector), _edge(net, rational, p, 0, p, q, vector))
    return 1 if along >= across else 2


@njit(cache=True, error_model="numpy", nogil=True)
def _leaves(nets: Floats, bounds: Floats, rational: bool) -> tuple[Floats, Floats]:
    """Patches halved until flat: their nets and their (u0, u1, v0, v1)."""
    rows, columns, width = nets.shape[1], nets.shape[2], nets.shape[3]
    room, found = 4 * len(nets), 0
    leaf, ends = np.empty((room, rows, columns, width)), np.empty((room, 4))
    stack, stack_ends = np.empty((_DEPTH + 2, rows, columns, width)), np.empty((_DEPTH + 2, 4))
    depths = np.empty(_DEPTH + 2, dtype=np.intp)
    for k in range(len(nets)):
        stack[0], stack_ends[0], depths[0] = nets[k], bounds[k], 0
        height = 1
        while height > 0:
            top = height - 1
            bent = _more_bent(stack[top], rational, depths[top])
            if bent == 0:
                if found == room:
                    leaf, ends = (
                        np.concatenate((leaf, np.empty_like(leaf))),
                        np.concatenate((ends, np.empty_like(ends))),
                    )
                    room *= 2
                leaf[found], ends[found] = stack[top], stack_ends[top]
                found += 1
                height -= 1
                continue
            if bent == 1:
                halve_rows(stack[top], stack[height], stack[top])
            else:
                halve_columns(stack[top], stack[height], stack[top])
            side = 0 if bent == 1 else 2
            stack_ends[height] = stack_ends[top]
            middle = 0.5 * (stack_ends[top, side] + stack_ends[top, side + 1])
            stack_ends[height, side + 1], stack_ends[top, side] = middle, middle
            depths[top] += 1
            depths[height] = depths[top]
            height += 1
    return leaf[:found].copy(), ends[:found].copy()


def _leaf_boxes(nets: Floats, rational: bool) -> Floats:
    """Boxes (s, 2, d) of the control points."""
    points = nets[..., :-1] / nets[..., -1:] if rational else nets
    flat = points.reshape(len(nets), -1, points.shape[-1])
    return np.stack([flat.min(axis=1), flat.max(axis=1)], axis=1)


@njit(cache=True, error_model="numpy", nogil=True)
def _tree(leaf_boxes: Floats) -> tuple[Indices, Floats]:
    """The order of the leaves and the boxes of all nodes in preorder: halves by the median along the longest side.

    The left child of a node follows it; a tree of k leaves has 2k-1 nodes.
    """
    count, dimension = len(leaf_boxes), leaf_boxes.shape[2]
    order, boxes = np.arange(count), np.empty((2 * count - 1, 2, dimension))
    stack = np.empty((64, 3), dtype=np.intp)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, 0, count
    height = 1
    while height > 0:
        height -= 1
        node, low, high = stack[height]
        inside = order[low:high].copy()
        longest, widest = 0, -1.0
        for axis in range(dimension):
            boxes[node, 0, axis], boxes[node, 1, axis] = np.inf, -np.inf
            for leaf in inside:
                boxes[node, 0, axis] = min(boxes[node, 0, axis], leaf_boxes[leaf, 0, axis])
                boxes[node, 1, axis] = max(boxes[node, 1, axis], leaf_boxes[leaf, 1, axis])
            if boxes[node, 1, axis] - boxes[node, 0, axis] > widest:
                longest, widest = axis, boxes[node, 1, axis] - boxes[node, 0, axis]
        if high - low > 1:
            middles = np.empty(len(inside))
            for index in range(len(inside)):
                middles[index] = leaf_boxes[inside[index], 0, longest] + leaf_boxes[inside[index], 1, longest]
            order[low:high] = inside[np.argsort(middles, kind="mergesort")]
            middle = (low + high) // 2
            stack[height, 0], stack[height, 1], stack[height, 2] = node + 2 * (middle - low), middle, high
            stack[height + 1, 0], stack[height + 1, 1], stack[height + 1, 2] = node + 1, low, middle
            height += 2
    return order, boxes


@njit(cache=True, error_model="numpy", nogil=True)
def _nearest(
    nets: Floats, bounds: Floats, rims: Indices, boxes: Floats, rational: bool, points: Floats
) -> tuple[Floats, Floats, Floats]:
    """The walk through the tree for each point, nearer child first; the last point's leaf gives the first bound."""
    rows, columns, width = nets.shape[1], nets.shape[2], nets.shape[3]
    by_s, by_t, jet = np.empty((3, rows)), np.empty((3, columns)), np.empty((3, 3, width))
    u, v, distance = np.empty(len(points)), np.empty(len(points)), np.empty(len(points))
    stack, near_by = np.empty((128, 3), dtype=np.intp), np.empty(128)
    leaf = 0
    for k in range(len(points)):
        point, begin = points[k], leaf
        s, t, best = foot_on_patch(nets[leaf], rational, rims[leaf], point, np.inf, by_s, by_t, jet)
        stack[0, 0], stack[0, 1], stack[0, 2] = 0, 0, len(nets)
        near_by[0], height = 0.0, 1
        while height > 0:
            height -= 1
            if near_by[height] >= best:
                continue
            node, low, high = stack[height]
            if high - low == 1:
                if low != begin:
                    a, b, nearer = foot_on_patch(nets[low], rational, rims[low], point, best, by_s, by_t, jet)
                    if nearer < best:
                        s, t, best, leaf = a, b, nearer, low
                continue
            middle = (low + high) // 2
            right = node + 2 * (middle - low)
            near, far = box_distance2(boxes[node + 1], point), box_distance2(boxes[right], point)
            left_first = near <= far
            for place in range(2):
                is_left = (place == 1) == left_first
                stack[height, 0] = node + 1 if is_left else right
                stack[height, 1], stack[height, 2] = (low, middle) if is_left else (middle, high)
                near_by[height] = near if is_left else far
                height += 1
        u[k] = bounds[leaf, 0] + s * (bounds[leaf, 1] - bounds[leaf, 0])
        v[k] = bounds[leaf, 2] + t * (bounds[leaf, 3] - bounds[leaf, 2])
        distance[k] = np.sqrt(best)
    return u, v, distance
