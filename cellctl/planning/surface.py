"""The as-built surface of a proof as the console draws it: fewer triangles, and at each corner how far it is off the part."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cellctl.planning.container import pack, quantised
from cellctl.planning.geometry import VIEW_SCHEMA

Array = NDArray[np.float64]
Index = NDArray[np.int64]

TRIANGLES_MAX = 160_000
COARSER = 1.25
DEVIATION_STEP_MM = 0.001


def clustered(vertices: Array, facets: Index, deviation: Array, box_mm: float) -> tuple[Array, Index, Array]:
    """The surface with one vertex for each box of that size: their mean, and the deviation that is farthest from zero.

    vertices (n, 3) mm, facets (m, 3), deviation (n,) mm; facets that lose their area are left out.
    """
    boxes = np.floor((vertices - vertices.min(axis=0)) / box_mm).astype(np.int64)
    size = boxes.max(axis=0) + 1
    key = (boxes[:, 0] * size[1] + boxes[:, 1]) * size[2] + boxes[:, 2]
    _, place = np.unique(key, return_inverse=True)
    count = np.bincount(place).astype(np.float64)
    middle = np.column_stack([np.bincount(place, vertices[:, d]) / count for d in range(3)])
    most, least = np.full(len(count), -np.inf), np.full(len(count), np.inf)
    np.maximum.at(most, place, deviation)
    np.minimum.at(least, place, deviation)
    corners = place[facets]
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]
    return middle, corners, np.where(np.abs(least) > np.abs(most), least, most)


def decimated(vertices: Array, facets: Index, deviation: Array, triangles_max: int = TRIANGLES_MAX) -> tuple[Array, Index, Array]:
    """The surface, or a coarser one with at most so many triangles."""
    if len(facets) <= triangles_max:
        return vertices, facets, deviation
    corner = vertices[facets[:, 0]]
    area = float(np.linalg.norm(np.cross(vertices[facets[:, 1]] - corner, vertices[facets[:, 2]] - corner), axis=1).sum()) / 2.0
    box_mm = float(np.sqrt(2.0 * area / triangles_max))
    while True:
        found = clustered(vertices, facets, deviation, box_mm)
        if len(found[1]) <= triangles_max:
            return found
        box_mm *= COARSER


def surface_bytes(vertices: Array, facets: Index, deviation: Array, tolerance_mm: float) -> bytes:
    """Container of an as-built surface: `position` (n, 4) u2, `deviation` (n,) i2 in steps of 1 um, `facets` (m, 3) u4."""
    points, corners, off = decimated(vertices, facets, deviation)
    origin, step, position = quantised(points, np.zeros(len(points)))
    header = {
        "schema": VIEW_SCHEMA,
        "kind": "surface",
        "origin": origin,
        "step_mm": step,
        "deviation_step_mm": DEVIATION_STEP_MM,
        "tolerance_mm": tolerance_mm,
        "triangles_measured": len(facets),
    }
    steps = np.clip(np.rint(off / DEVIATION_STEP_MM), -32767, 32767).astype(np.int16)
    return pack(header, {"position": position, "deviation": steps, "facets": corners.astype(np.uint32)})
