"""Planar faces between the solid below a plane and the solid above it: bottoms, tops and ledges."""

from __future__ import annotations

import manifold3d  # type: ignore[import-not-found,unused-ignore]
import numpy as np
import shapely
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def planar_faces(xy: Floats, below: list[Ints], above: list[Ints]) -> list[tuple[list[Ints], int]]:
    """Faces of the plane that bound material on one side only, as rings of vertices (the outer one first), and +1 where
    the material lies below the plane, -1 where it lies above.

    xy : (n, 2) float, mm;  below, above : vertex numbers of the closed polylines that bound the solid on either side,
    material on the left; noded (they meet in common vertices only). Rings are counter-clockwise outside, holes clockwise.
    """
    tail, head, times = _net_sides(below, above, len(xy))
    if not len(tail):
        return []
    lines = shapely.linestrings(np.stack([xy[tail], xy[head]], axis=1))
    faces = shapely.get_parts(shapely.polygonize(lines))
    inner = shapely.get_coordinates(shapely.point_on_surface(faces))
    side = winding(inner, xy[tail], xy[head], times)
    used = np.unique(np.concatenate([tail, head]))
    number = dict(zip(map(tuple, xy[used].tolist()), used.tolist(), strict=True))
    found = []
    for face, turns in zip(shapely.orient_polygons(faces), side.tolist(), strict=True):
        if turns:
            rings = [face.exterior, *face.interiors]
            numbers = [[number[point] for point in ring.coords[:-1]] for ring in rings]
            found += [([np.array(ring) for ring in numbers], 1 if turns > 0 else -1)] * abs(turns)
    return found


def face_triangles(xy: Floats, rings: list[Ints], side: int) -> Ints:
    """Triangles (m, 3) of one face on its own vertices, counter-clockwise seen along -normal for side +1."""
    ids = np.concatenate(rings)
    made = np.asarray(manifold3d.triangulate([xy[ring] for ring in rings]), dtype=np.int64)
    triangles = ids[made]
    return triangles if side > 0 else triangles[:, ::-1]


def _net_sides(below: list[Ints], above: list[Ints], count: int) -> tuple[Ints, Ints, Ints]:
    """Sides a < b that the polylines pass more often one way than the other, and how often: (k,) each.

    Those above count against those below: where both walls meet there is no face.
    """
    keys, times = [], []
    for rings, sign in ((below, 1), (above, -1)):
        for ring in rings:
            after = np.roll(ring, -1)
            keys.append(np.minimum(ring, after) * count + np.maximum(ring, after))
            times.append(np.where(ring < after, sign, -sign))
    if not keys:
        empty = np.empty(0, dtype=np.int64)
        return empty, empty, empty
    sides, index = np.unique(np.concatenate(keys), return_inverse=True)
    net = np.bincount(index.reshape(-1), weights=np.concatenate(times)).astype(np.int64)
    kept = net != 0
    return sides[kept] // count, sides[kept] % count, net[kept]


def winding(points: Floats, tail: Floats, head: Floats, times: Ints) -> Ints:
    """How often directed sides, each counted `times`, run round each point, counter-clockwise: (n,) int64."""
    x, y = points[:, 0, None], points[:, 1, None]
    rises = (tail[:, 1] <= y) & (head[:, 1] > y)
    falls = (tail[:, 1] > y) & (head[:, 1] <= y)
    left = (head[:, 0] - tail[:, 0]) * (y - tail[:, 1]) - (x - tail[:, 0]) * (head[:, 1] - tail[:, 1])
    turns = (rises & (left > 0.0)) * times - (falls & (left < 0.0)) * times
    return np.asarray(turns.sum(axis=1))
