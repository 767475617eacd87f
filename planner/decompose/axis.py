"""Centroidal axis of a body that grows straight: the centroids of its sections from the base to its end."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.plan import Skeleton
from planner.slicing.slicer import slice_mesh

Floats = NDArray[np.float64]

_STATIONS = 24  # along a piece: as many as its picture needs


def straight_axis(mesh: Mesh, base: Floats) -> tuple[Floats, Floats]:
    """Centroids of sections across a direction, (m, 3) float mm, and the radii (mm) of circles with their areas, (m,).

    base : (6,) float   point of the base plane and the unit direction; sections lie at the middles of equal steps from the
    body's lowest point along it to its highest, and the axis is continued straight to both.
    """
    direction = base[3:]
    along = mesh.vertices[np.unique(mesh.facets)] @ direction
    low, high = float(along.min()), float(along.max())
    levels = low + (high - low) * (np.arange(_STATIONS) + 0.5) / _STATIONS
    planes = np.column_stack([np.outer(levels, direction), np.tile(direction, (_STATIONS, 1))])
    points, radii = [], []
    for section in slice_mesh(mesh, planes):
        area = sum(loop.area_mm2 for loop in section.loops)
        if area <= 0.0:
            continue
        moment = sum((_loop_moment(loop.xy) for loop in section.loops), np.zeros(2))
        points.append(section.lift((moment / area)[None, :])[0])
        radii.append(np.sqrt(area / np.pi))
    centres, sizes = np.array(points), np.array(radii)
    first = centres[0] + (low - centres[0] @ direction) * direction
    last = centres[-1] + (high - centres[-1] @ direction) * direction
    return np.vstack([first, centres, last]), np.concatenate([sizes[:1], sizes, sizes[-1:]])


def axis_graph(axis: Floats, radii: Floats) -> Skeleton:
    """One axis as a graph: its points in a row."""
    count = len(axis)
    return Skeleton(axis, radii, np.column_stack([np.arange(count - 1), np.arange(1, count)]).astype(np.int64))


def _loop_moment(xy: Floats) -> Floats:
    """(2,) float, mm³   Signed first moment of the area in a closed loop about its frame's origin."""
    after = np.roll(xy, -1, axis=0)
    cross = xy[:, 0] * after[:, 1] - after[:, 0] * xy[:, 1]
    return np.asarray(((xy + after) * cross[:, None]).sum(axis=0) / 6.0)
