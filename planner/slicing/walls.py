"""Side walls as ruled surfaces: those of a layer whose contours correspond one to one, and whether lines join them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.matching.layer import SURFACE_STYLE, stack_walls
from planner.matching.twist import has_fans
from planner.mesh.mesh import Mesh
from planner.plan import Wall
from planner.slicing.contours import ContourStyle
from planner.slicing.section import Section

Floats = NDArray[np.float64]

_STEP_MM = 0.5  # between the points at which walls are measured


def ruled_walls(bottom: Section, top: Section, mesh: Mesh, style: ContourStyle = SURFACE_STYLE) -> tuple[Wall, ...]:
    """Walls between two sections whose loops correspond one to one; empty where they do not.

    bottom, top : cut with sides "above" and "below"; parallel planes
    Loops belong together by the mesh's facets, points by the tangents of both contours (`planner.matching`). A wall in
    which a corner faces a run of the other contour has no one ruling there: then too there are none.
    Source: paper Eq. 19, §V.
    """
    return ruled_walls_many([(bottom, top)], mesh, style)[0]


def ruled_walls_many(
    layers: Sequence[tuple[Section, Section]], mesh: Mesh, style: ContourStyle = SURFACE_STYLE
) -> list[tuple[Wall, ...]]:
    """`ruled_walls` of many layers, each a bottom and a top section; all contours are fitted in one pass."""
    fitting = [k for k, (bottom, top) in enumerate(layers) if bottom.loops and len(bottom.loops) == len(top.loops)]
    walls: list[tuple[Wall, ...]] = [()] * len(layers)
    for k, found in zip(fitting, stack_walls(mesh, [layers[k] for k in fitting], style=style), strict=True):
        if not found.notes and not any(wall.how == "swept" or has_fans(wall.surface) for wall in found.walls):
            walls[k] = tuple(
                Wall(wall.surface.curve0, wall.surface.curve1, wall.twist_max_rad) for wall in found.walls
            )
    return walls


def wall_error(walls: tuple[Wall, ...], area: MultiPolygon, share: float) -> float:
    """Largest distance, mm, of the walls from a section between their ends, in its plane.

    share : of the height at which the section lies.
    """
    worst = 0.0
    outline = area.boundary
    shapely.prepare(outline)
    for wall in walls:
        u = np.linspace(0.0, 1.0, max(50, int(wall.bottom.length / _STEP_MM)))
        points = (1.0 - share) * wall.bottom.evaluate(u) + share * wall.top.evaluate(u)
        worst = max(worst, float(shapely.distance(outline, shapely.points(points[:, :2])).max()))
    return worst
