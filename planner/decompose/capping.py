"""Flat caps over the closed loops that bound a cut surface, on the loops' own vertices."""

from __future__ import annotations

from dataclasses import dataclass

import manifold3d  # type: ignore[import-not-found,unused-ignore]
import numpy as np
from numpy.typing import NDArray

from planner.errors import PlanningError
from planner.mesh.findings import place_text
from planner.slicing.section import plane_frame

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_AREA_FRACTION = 1e-6  # by which a cap's area may differ from what its loops enclose: rounding only


@dataclass(frozen=True, eq=False)
class Caps:
    """Triangles over all loops in a plane.

    triangles : (k, 3) int, nodes, counter-clockwise seen against the plane's normal   areas : (k,) float, mm²
    facets : (k,) int, a facet of a loop that the triangle fills   joined : (j, 2) int, facets whose loops one cap fills
    """

    triangles: Ints
    areas: Floats
    facets: Ints
    joined: Ints


def caps_of(nodes: Ints, points: Floats, tails: Ints, heads: Ints, facets: Ints, plane: Floats) -> Caps:
    """Fill what directed sides enclose, metal on their left seen against the plane's normal.

    nodes : (n,) int, increasing   points : (n, 3) float, mm, where they are   plane : (6,) float
    tails, heads, facets : (s,) int, nodes at both ends of each side and the facet that it bounds
    Raises PlanningError, naming the place, if the sides do not make closed loops that can be filled.
    """
    if not len(nodes):
        return Caps(np.empty((0, 3), np.int64), np.empty(0), np.empty(0, np.int64), np.empty((0, 2), np.int64))
    axes = plane_frame(plane)[1:3]
    xy = (points - plane[:3]) @ axes.T
    tail, head = np.searchsorted(nodes, tails), np.searchsorted(nodes, heads)
    rings = _rings(tail, head, xy, points)
    corner = np.concatenate([tail[ring] for ring in rings])
    owner = np.concatenate([facets[ring] for ring in rings])
    ring_of = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    made = np.asarray(manifold3d.triangulate([xy[tail[ring]] for ring in rings]), dtype=np.int64).reshape(-1, 3)
    triangles = corner[made]
    areas = _doubled(xy[triangles]) / 2.0
    enclosed = sum(_ring_area(xy[tail[ring]]) for ring in rings)
    if abs(areas.sum() - enclosed) > _AREA_FRACTION * max(enclosed, 1.0) or enclosed < 0.0:
        raise PlanningError(
            f"the section at {place_text(points.mean(axis=0))} cannot be closed by a flat face", "move the cutting plane a little"
        )
    first = np.array([facets[ring[0]] for ring in rings])
    met = ring_of[made]
    pairs = np.unique(np.concatenate([met[:, :2], met[:, 1:]]), axis=0)
    return Caps(nodes[triangles], areas, owner[made[:, 0]], first[pairs])


def _rings(tail: Ints, head: Ints, xy: Floats, points: Floats) -> list[Ints]:
    """Sides in closed loops: lists of their numbers. Where loops touch, a loop keeps to the metal on its left.

    Raises PlanningError, naming the place, where a side has no continuation.
    """
    leaving: dict[int, list[int]] = {}
    for number, start in enumerate(tail.tolist()):
        leaving.setdefault(start, []).append(number)
    used = np.zeros(len(tail), dtype=np.bool_)
    rings = []
    for first in range(len(tail)):
        if used[first]:
            continue
        ring, side = [], first
        while not used[side]:
            used[side] = True
            ring.append(side)
            ways = [way for way in leaving.get(int(head[side]), []) if not used[way] or way == first]
            if not ways:
                place = place_text(points[int(head[side])])
                raise PlanningError(f"the section at {place} is not closed", "mend the mesh")
            side = ways[0] if len(ways) == 1 else min(ways, key=lambda way: _clockwise(side, way, tail, head, xy))
        rings.append(np.array(ring))
    return rings


def _clockwise(side: int, way: int, tail: Ints, head: Ints, xy: Floats) -> float:
    """Angle, rad, by which the way back along a side is turned clockwise to run along another side from its end."""
    back, ahead = xy[tail[side]] - xy[head[side]], xy[head[way]] - xy[tail[way]]
    turn = np.arctan2(back[1], back[0]) - np.arctan2(ahead[1], ahead[0])
    return float(turn % (2.0 * np.pi)) or 2.0 * float(np.pi)


def _doubled(corners: Floats) -> Floats:
    """(k,) float   Twice the signed areas of triangles, (k, 3, 2)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def _ring_area(xy: Floats) -> float:
    after = np.roll(xy, -1, axis=0)
    return float((xy[:, 0] * after[:, 1] - after[:, 0] * xy[:, 1]).sum() / 2.0)
