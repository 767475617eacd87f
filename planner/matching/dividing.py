"""Layers divided where their walls would meet or their contours change: an interpolated slice between the two planes."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from planner.matching.branching import IN_PLANE_FRACTION
from planner.matching.layer import SURFACE_STYLE, layer_walls
from planner.matching.walls import LayerWalls
from planner.mesh.mesh import Mesh
from planner.slicing.contours import ContourStyle
from planner.slicing.critical import critical_heights
from planner.slicing.section import Section
from planner.slicing.slicer import slice_mesh

Floats = NDArray[np.float64]

MOST_DIVISIONS = 12
"""Planes put into one layer at most; a surface rougher than that is not followed event by event."""
_LEAST_SHARE = 2e-3  # of the layer's thickness: events nearer to a plane than this are in it
_HALVINGS = 3  # times that a layer is halved in search of walls that stay apart

_events: WeakKeyDictionary[Mesh, dict[tuple[float, float, float], Floats]] = WeakKeyDictionary()


def divided_walls(
    mesh: Mesh, bottom: Section, top: Section, *, style: ContourStyle = SURFACE_STYLE
) -> tuple[LayerWalls, ...]:
    """The walls between two sections, from below, with planes put in between where one layer cannot show the surface.

    bottom, top : as for `layer_walls`. Parallel planes: where contours begin, end, part, join or jump (`event_heights`)
    a plane goes exactly there, so that on each side contours correspond one to one. Any planes: a layer whose walls
    would meet is halved. Neighbouring layers share their plane, their contours in it may differ: ledges lie there.
    Raises as `layer_walls`.  Source: paper §V, Fig. 12.
    """
    planes = [bottom.plane, *_inner_planes(mesh, bottom, top), top.plane]
    if len(planes) == 2:
        return _apart(mesh, bottom, top, style, _HALVINGS)
    lower = [bottom, *slice_mesh(mesh, np.array(planes[1:-1]), "above")]
    upper = [*slice_mesh(mesh, np.array(planes[1:-1]), "below"), top]
    return tuple(
        walls for pair in zip(lower, upper, strict=True) for walls in _apart(mesh, pair[0], pair[1], style, _HALVINGS)
    )


def _inner_planes(mesh: Mesh, bottom: Section, top: Section) -> list[Floats]:
    """Planes between two parallel ones at the surface's events; none where there are too many."""
    if float(bottom.normal @ top.normal) < 1.0 - 1e-12:
        return []
    normal = bottom.normal
    low, high = float(bottom.origin @ normal), float(top.origin @ normal)
    margin = max(_LEAST_SHARE * (high - low), 4.0 * IN_PLANE_FRACTION * mesh.diagonal)
    heights = event_heights(mesh, normal)
    heights = heights[(heights > low + margin) & (heights < high - margin)]
    heights = heights[np.concatenate([[True], np.diff(heights) > margin])] if len(heights) else heights
    if len(heights) > MOST_DIVISIONS:
        return []
    return [np.concatenate([bottom.origin + normal * (height - low), normal]) for height in heights]


def _apart(mesh: Mesh, bottom: Section, top: Section, style: ContourStyle, halvings: int) -> tuple[LayerWalls, ...]:
    """The walls of a layer, halved until they stay apart; at the last, walls that would meet are swept."""
    walls = layer_walls(mesh, bottom, top, style=style)
    if not walls.notes or not halvings:
        return (walls,)
    normal = bottom.normal + top.normal
    plane = np.concatenate([0.5 * (bottom.origin + top.origin), normal / np.linalg.norm(normal)])[None]
    middle = (slice_mesh(mesh, plane, "below")[0], slice_mesh(mesh, plane, "above")[0])
    return (
        *_apart(mesh, bottom, middle[0], style, halvings - 1),
        *_apart(mesh, middle[1], top, style, halvings - 1),
    )


def event_heights(mesh: Mesh, normal: Floats) -> Floats:
    """Heights (k,) mm, ascending, at which contours across `normal` change their number or jump; kept as long as the mesh.

    Those of `critical_heights`.
    """
    known = _events.setdefault(mesh, {})
    key = (float(normal[0]), float(normal[1]), float(normal[2]))
    if key not in known:
        known[key] = critical_heights(mesh, normal)
    return known[key]
