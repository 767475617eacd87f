"""A plan as coloured facets: the bands between the planes of its layers and the sections that they end in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from planner.plan import Layer, Plan
from planner.slicing.section import plane_frame

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_MOST_SLABS = 240
_CHORD = 0.002  # of a drawn contour, as a share of the part's size: below a pixel


@dataclass(frozen=True)
class Solid:
    """What stands, for a picture.

    corners : (n, 4, 3) float, mm, of each facet; the last two are the same for a triangle   normals : (n, 3) float, outward
    piece : (n,) int64, number of the subcomponent   first : (layers + 1,) int64, the facets before each layer
    rims : (m, 2, 3) float, mm, pieces of contours   rim_normals : (m, 3)
    """

    corners: Floats
    normals: Floats
    piece: Ints
    first: Ints
    rims: Floats
    rim_normals: Floats


def solid_of(plan: Plan, most_slabs: int = _MOST_SLABS, chord: float = _CHORD) -> Solid:
    """The facets of all layers with contours, in their order.

    most_slabs : where there are more layers, every few are drawn as one   chord : of a contour, as a share of the part's size
    """
    corners, normals, piece, rims, rim_normals = [], [], [], [], []
    count = np.zeros(len(plan.layers) + 1, dtype=np.int64)
    chord_mm = chord * float(np.linalg.norm(plan.bounds[1] - plan.bounds[0]))
    for first, last in _slabs(plan, most_slabs):
        slab = _Slab(plan.layers[first], plan.layers[last], chord_mm)
        for loop, is_hole in slab.loops:
            facets, outward = slab.band(loop, is_hole)
            corners.append(facets)
            normals.append(outward)
            rims.append(facets[:, :2])
            rim_normals.append(outward)
        caps, outward = slab.caps()
        corners.append(caps)
        normals.append(outward)
        count[first + 1] = sum(len(loop) for loop, _ in slab.loops) + len(caps)
        piece.append(np.full(count[first + 1], plan.layers[first].subcomponent))
    return Solid(
        np.concatenate([np.empty((0, 4, 3)), *corners]),
        np.concatenate([np.empty((0, 3)), *normals]),
        np.concatenate([np.empty(0, dtype=np.int64), *piece]),
        np.cumsum(count),
        np.concatenate([np.empty((0, 2, 3)), *rims]),
        np.concatenate([np.empty((0, 3)), *rim_normals]),
    )


def _slabs(plan: Plan, most: int) -> list[tuple[int, int]]:
    """First and last layer of every slab that is drawn as one: none reaches from one subcomponent into another."""
    each = -(-len(plan.layers) // most)
    found: list[tuple[int, int]] = []
    for number, layer in enumerate(plan.layers):
        if not layer.contours:
            continue
        joined = found and number - found[-1][0] < each
        if joined and plan.layers[found[-1][0]].subcomponent == layer.subcomponent:
            found[-1] = (found[-1][0], number)
        else:
            found.append((number, number))
    return found


class _Slab:
    """One layer, or a few as one: the contours of the first, from its bottom plane along its normal to the last one's top."""

    def __init__(self, first: Layer, last: Layer, chord_mm: float) -> None:
        self.bottom, self.top = first.bottom, last.top
        self.frame = plane_frame(first.bottom)
        self.loops = [
            (self._laid(_ring(contour.curve.evaluate(contour.curve.sample(chord_mm)))), contour.is_hole)
            for contour in first.contours
        ]

    def _laid(self, points: Floats) -> Floats:
        """Points moved along the normal into the bottom plane."""
        return np.asarray(points - ((points - self.bottom[:3]) @ self.bottom[3:])[:, None] * self.bottom[3:])

    def _raised(self, points: Floats) -> Floats:
        """Points of the bottom plane moved along its normal into the top plane."""
        along = max(float(self.bottom[3:] @ self.top[3:]), 0.2)
        way = np.maximum((self.top[:3] - points) @ self.top[3:] / along, 0.0)
        return np.asarray(points + way[..., None] * self.bottom[3:])

    def band(self, loop: Floats, is_hole: bool) -> tuple[Floats, Floats]:
        """(n, 4, 3) facets of the side over a contour and their (n, 3) outward normals."""
        after = np.roll(loop, -1, axis=0)
        flat = (loop - self.frame[0]) @ self.frame[1:3].T
        turned = np.roll(flat, -1, axis=0)
        area = float((flat[:, 0] * turned[:, 1] - flat[:, 1] * turned[:, 0]).sum())
        outward = np.cross(after - loop, self.bottom[3:])
        outward /= np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
        sign = 1.0 if (area > 0.0) != is_hole else -1.0
        return np.stack([loop, after, self._raised(after), self._raised(loop)], axis=1), sign * outward

    def caps(self) -> tuple[Floats, Floats]:
        """(n, 4, 3) triangles of the top and of the bottom, and their (n, 3) outward normals."""
        shape = shapely.Polygon()
        for loop, is_hole in sorted(self.loops, key=lambda item: item[1]):
            ring = shapely.make_valid(shapely.Polygon((loop - self.frame[0]) @ self.frame[1:3].T))
            shape = shape.difference(ring) if is_hole else shape.union(ring)
        pieces = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon" and part.area > 0.0]
        triangles = [
            shapely.get_coordinates(triangle)[:3]
            for part in pieces
            for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(part))
        ]
        if not triangles:
            return np.empty((0, 4, 3)), np.empty((0, 3))
        low = self.frame[0] + np.array(triangles) @ self.frame[1:3]
        both = np.concatenate([low, self._raised(low)])
        normals = np.repeat([-self.bottom[3:], self.top[3:]], len(low), axis=0)
        return np.concatenate([both, both[:, 2:]], axis=1), normals


def _ring(points: Floats) -> Floats:
    """Points of a closed curve without the last, which is the first again."""
    return np.asarray(points[:-1] if np.allclose(points[0], points[-1]) else points)
