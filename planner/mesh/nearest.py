"""How far points are from a mesh: nearest facet by a tree of boxes."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from planner.errors import MeshError
from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAF = 4
"""Facets in a leaf of the tree."""
_CELLS = 1 << 16  # per axis, of the grid whose curve puts the facets in order


class FacetTree:
    """A mesh made ready for many questions of distance.

    The facets are put in order along a Z-curve through their centres; a complete binary tree of boxes stands on leaves of
    LEAF neighbours. Building is linear but for one sort. Raises MeshError for a mesh without facets.
    Source of the order: Morton 1966; Lauterbach et al., "Fast BVH construction on GPUs", Eurographics 2009.
    """

    def __init__(self, mesh: Mesh) -> None:
        if not len(mesh.facets):
            raise MeshError("the mesh holds no facets", "export the model again")
        self.order = np.argsort(z_codes(mesh.centroids), kind="stable")
        self.corners = np.ascontiguousarray(mesh.corners[self.order])
        self.boxes = _boxes(self.corners)

    def nearest(self, points: ArrayLike) -> tuple[Floats, Ints, Floats]:
        """Distance to the mesh (mm, >= 0), the nearest facet and the nearest point of the mesh, for each point.

        points : (n, 3) float, mm.  Returns (n,) float, (n,) int64, (n, 3) float.
        """
        asked = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
        square, place, foot = _nearest(asked, self.corners, self.boxes)
        return np.sqrt(square), np.asarray(self.order[place]), foot


def z_codes(points: Floats) -> NDArray[np.uint64]:
    """Place of each point on a Z-curve through the box around all of them."""
    low = points.min(axis=0)
    cell = max(float((points.max(axis=0) - low).max()) / (_CELLS - 1), np.finfo(float).tiny)
    grid = ((points - low) / cell).astype(np.uint64)
    code = np.zeros(len(points), dtype=np.uint64)
    for axis in range(3):
        bits = grid[:, axis]
        for shift, mask in (
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
        ):
            bits = (bits | (bits << np.uint64(shift))) & np.uint64(mask)
        bits = (bits | (bits << np.uint64(2))) & np.uint64(0x1249249249249249)
        code |= bits << np.uint64(axis)
    return code


@njit(cache=True)
def _boxes(corners: Floats) -> Floats:  # pragma: no cover
    """Boxes (2 * leaves, 2, 3) of a complete tree in heap order, root 1.  corners : (m, 3, 3) float, in order."""
    leaves = 1
    while leaves * LEAF < corners.shape[0]:
        leaves *= 2
    boxes = np.empty((2 * leaves, 2, 3))
    boxes[:, 0] = np.inf
    boxes[:, 1] = -np.inf
    for f in range(corners.shape[0]):
        box = boxes[leaves + f // LEAF]
        for k in range(3):
            for axis in range(3):
                box[0, axis] = min(box[0, axis], corners[f, k, axis])
                box[1, axis] = max(box[1, axis], corners[f, k, axis])
    for node in range(leaves - 1, 0, -1):
        for axis in range(3):
            boxes[node, 0, axis] = min(boxes[2 * node, 0, axis], boxes[2 * node + 1, 0, axis])
            boxes[node, 1, axis] = max(boxes[2 * node, 1, axis], boxes[2 * node + 1, 1, axis])
    return boxes


@njit(cache=True)
def _box_square(box: Floats, point: Floats) -> float:  # pragma: no cover
    """Square of the distance from a point to a box, mm²; inf for an empty one."""
    total = 0.0
    for axis in range(3):
        out = max(box[0, axis] - point[axis], point[axis] - box[1, axis], 0.0)
        total += out * out
    return total


@njit(cache=True)
def _nearest(points: Floats, corners: Floats, boxes: Floats) -> tuple[Floats, Ints, Floats]:  # pragma: no cover
    """Square of the distance, place of the nearest facet in the order, and foot point of each point."""
    count, leaves = points.shape[0], boxes.shape[0] // 2
    square, place, foot = np.full(count, np.inf), np.zeros(count, np.int64), np.empty((count, 3))
    stack, least = np.empty(64, np.int64), np.empty(64)
    for i in range(count):
        stack[0], least[0], top = 1, 0.0, 1
        while top > 0:
            top -= 1
            node = stack[top]
            if least[top] >= square[i]:
                continue
            if node >= leaves:
                first = (node - leaves) * LEAF
                for f in range(first, min(first + LEAF, corners.shape[0])):
                    x, y, z = nearest_on_facet(corners[f], points[i])
                    away = (x - points[i, 0]) ** 2 + (y - points[i, 1]) ** 2 + (z - points[i, 2]) ** 2
                    if away < square[i]:
                        square[i], place[i] = away, f
                        foot[i, 0], foot[i, 1], foot[i, 2] = x, y, z
                continue
            near, far = 2 * node, 2 * node + 1
            near_square, far_square = _box_square(boxes[near], points[i]), _box_square(boxes[far], points[i])
            if far_square < near_square:
                near, far, near_square, far_square = far, near, far_square, near_square
            if far_square < square[i]:
                stack[top], least[top] = far, far_square
                top += 1
            if near_square < square[i]:
                stack[top], least[top] = near, near_square
                top += 1
    return square, place, foot


@njit(cache=True)
def nearest_on_facet(corner: Floats, point: Floats) -> tuple[float, float, float]:  # pragma: no cover
    """Point of a triangle nearest to a point.  corner : (3, 3) float, mm;  point : (3,) float, mm.

    Source: Ericson, Real-Time Collision Detection (2005), 5.1.5. A triangle without area counts as its edges.
    """
    a, b, c = corner[0], corner[1], corner[2]
    ab_x, ab_y, ab_z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    ac_x, ac_y, ac_z = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    ap_x, ap_y, ap_z = point[0] - a[0], point[1] - a[1], point[2] - a[2]
    d1, d2 = ab_x * ap_x + ab_y * ap_y + ab_z * ap_z, ac_x * ap_x + ac_y * ap_y + ac_z * ap_z
    if d1 <= 0.0 and d2 <= 0.0:
        return a[0], a[1], a[2]
    bp_x, bp_y, bp_z = point[0] - b[0], point[1] - b[1], point[2] - b[2]
    d3, d4 = ab_x * bp_x + ab_y * bp_y + ab_z * bp_z, ac_x * bp_x + ac_y * bp_y + ac_z * bp_z
    if d3 >= 0.0 and d4 <= d3:
        return b[0], b[1], b[2]
    cp_x, cp_y, cp_z = point[0] - c[0], point[1] - c[1], point[2] - c[2]
    d5, d6 = ab_x * cp_x + ab_y * cp_y + ab_z * cp_z, ac_x * cp_x + ac_y * cp_y + ac_z * cp_z
    if d6 >= 0.0 and d5 <= d6:
        return c[0], c[1], c[2]
    on_ab, on_ac, on_bc = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
    if on_ab <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        t = d1 / (d1 - d3)
        return a[0] + t * ab_x, a[1] + t * ab_y, a[2] + t * ab_z
    if on_ac <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / (d2 - d6)
        return a[0] + t * ac_x, a[1] + t * ac_y, a[2] + t * ac_z
    if on_bc <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return b[0] + t * (c[0] - b[0]), b[1] + t * (c[1] - b[1]), b[2] + t * (c[2] - b[2])
    total = on_ab + on_ac + on_bc
    v, w = on_ac / total, on_ab / total
    return a[0] + ab_x * v + ac_x * w, a[1] + ab_y * v + ac_y * w, a[2] + ab_z * v + ac_z * w
