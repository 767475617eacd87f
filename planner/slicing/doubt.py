"""Contours along the smooth surface that lie farther from the facets than these can stand for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from planner.mesh.smooth import STORED, SmoothSurface
from planner.nurbs.curve import Curve
from planner.nurbs.sampling import divide_evenly
from planner.slicing.nearness import nearest_sides
from planner.slicing.nodes import Outline, node_kinds

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_TIMES = 4.0  # the rise of the facets: the largest lift of known surfaces, coarse and fine, is 2.8 times it
_GRAZING = 0.05  # sine of the angle between plane and facet below which the lift in the plane grows no further
_PER_PIECE, _PER_SIDE, _MOST = 4, 1.0, 4096  # places along a piece of the curve


def doubtful(curves: Sequence[Curve], outline: Outline, surface: SmoothSurface) -> Flags:
    """Which contours lie farther from their loop than the facets along it can stand for: (k,) bool.

    curves : of the outline's loops, in their order
    The limit beside each side of a loop is _TIMES the largest rise (`SmoothSurface.rises`) of the facet that it crosses
    and of those before and after, measured in the plane; sides across one flat face count as one.
    """
    limit = _limits(outline, surface)
    length = np.linalg.norm(outline.points[outline.after] - outline.points, axis=1)
    mean = np.bincount(outline.loop, weights=length) / np.maximum(np.diff(outline.start), 1)
    samples = [_places(curve, side) for curve, side in zip(curves, mean.tolist(), strict=True)]
    start = np.concatenate([[0], np.cumsum([len(points) for points in samples])]).astype(np.int64)
    away, side = nearest_sides(np.concatenate(samples), start, outline.points, outline.start)
    return np.asarray(np.maximum.reduceat(away - limit[side], start[:-1]) > 0.0)


def _limits(outline: Outline, surface: SmoothSurface) -> Floats:
    """How far a curve may lie from each side of the loops, mm: (n,) float."""
    normal = surface.mesh.normals[outline.facets]
    lean = np.sqrt(np.maximum(1.0 - np.einsum("nd,nd->n", normal, outline.normal) ** 2, _GRAZING**2))
    own = _TIMES * surface.rises[outline.facets] / lean
    corners, flat = node_kinds(outline, surface)
    begins = ~flat | corners
    begins[outline.start[:-1]] = True
    run = np.cumsum(begins) - 1
    most = np.maximum.reduceat(own, np.flatnonzero(begins))
    own = most[run]
    before = np.empty(len(own), dtype=np.int64)
    before[outline.after] = np.arange(len(own))
    near = np.maximum(own, np.maximum(own[before], own[outline.after]))
    near = np.maximum.reduceat(near, np.flatnonzero(begins))[run]
    return np.asarray(near + 8.0 * STORED * float(max(np.abs(surface.mesh.bounds).max(), surface.mesh.diagonal)) + 1e-4)


def _places(curve: Curve, side_mm: float) -> Floats:
    """Points along a curve, 4 on each piece and one per mean side of the loop: (k, 3) float, mm."""
    edges = curve.breaks
    reach = np.linalg.norm(np.diff(curve.evaluate(edges), axis=0), axis=1)
    counts = np.clip(np.ceil(_PER_SIDE * reach / max(side_mm, 1e-300)), _PER_PIECE, _MOST)
    return np.asarray(curve.evaluate(divide_evenly(edges, counts.astype(np.intp)))[:-1])
