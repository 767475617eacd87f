"""All side walls of a layer, and of a stack of layers, from the mesh and the sections in its planes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from planner.matching.adjacency import match_in_slab, match_sections
from planner.matching.branching import branch_walls, names_in, sections_apart, swept_curve, swept_walls
from planner.matching.contact import first_contact
from planner.matching.slab import Slab, slab_of
from planner.matching.twist import largest_twist
from planner.matching.walls import LayerWalls, Rim, RuledWall, joined, plane_axes, rim_of
from planner.mesh.findings import place_text
from planner.mesh.mesh import Mesh
from planner.nurbs.curve import Curve
from planner.nurbs.ruled import RuledSurface
from planner.slicing.contours import ContourStyle, fitted_curves
from planner.slicing.section import Section

Floats = NDArray[np.float64]

SURFACE_STYLE = ContourStyle()
"""Contours along the smooth surface, as recipes have it by default."""


def layer_walls(mesh: Mesh, bottom: Section, top: Section, *, style: ContourStyle = SURFACE_STYLE) -> LayerWalls:
    """The ruled side walls of the layer between two sections.

    bottom : cut with side "above"; top : with side "below"; of this mesh; the planes need not be parallel but must not
    meet inside the part. Contours that correspond one to one are joined by rulings (paper Eq. 19); the others as
    `branch_walls` says. Every wall is a closed ring from plane to plane.
    Raises PlanningError where the planes meet inside the part, FitError where no curve fits a contour.
    """
    return stack_walls(mesh, [(bottom, top)], style=style)[0]


def stack_walls(
    mesh: Mesh, layers: Sequence[tuple[Section, Section]], *, style: ContourStyle = SURFACE_STYLE
) -> list[LayerWalls]:
    """`layer_walls` of many layers, each a bottom and a top section; all contours are fitted in one pass."""
    used = [sections_apart(mesh, bottom, top) for bottom, top in layers]
    curves = fitted_curves([section for pair in used for section in pair], mesh, style)
    return [
        _walls(mesh, given, apart, (curves[2 * k], curves[2 * k + 1]), style)
        for k, (given, apart) in enumerate(zip(layers, used, strict=True))
    ]


def _walls(
    mesh: Mesh,
    given: tuple[Section, Section],
    apart: tuple[Section, Section],
    curves: tuple[list[Curve], list[Curve]],
    style: ContourStyle,
) -> LayerWalls:
    """The walls of one layer.  given : its sections; apart : those that the curves belong to."""
    bottom, top = apart
    slab = slab_of(mesh, bottom.plane, top.plane)
    axes = plane_axes(bottom, top)
    low = rim_of(mesh, bottom, curves[0], axes[0], style.crease_deg)
    high = rim_of(mesh, top, curves[1], axes[1], style.crease_deg)
    found = match_in_slab(mesh, bottom, top, slab)
    walls: list[RuledWall] = []
    for group in found.groups:
        if group.kind == "one_to_one":
            number, other = group.bottom[0], group.top[0]
            surface = joined(mesh, slab, (low, number), (high, other), style.crease_deg)
            how = found.how(number, other) or "indirect"
            walls.append(RuledWall(surface, how, (number,), (other,), largest_twist(surface)))
        else:
            walls += branch_walls(mesh, slab, low, high, group, style)
    walls, notes = _kept_apart(walls, slab, low, high, axes[0][:2])
    walls = [_in_planes(mesh, wall, given, apart) for wall in walls]
    return LayerWalls(
        given[0].plane,
        given[1].plane,
        found if apart == given else match_sections(mesh, *given),
        tuple(walls),
        tuple(wall.surface.curve0 for wall in walls),
        tuple(wall.surface.curve1 for wall in walls),
        notes,
    )


def _kept_apart(
    walls: list[RuledWall], slab: Slab, low: Rim, high: Rim, axes: Floats
) -> tuple[list[RuledWall], tuple[str, ...]]:
    """The walls if they stay apart between the planes; else all swept from the plane with more contours, and why."""
    contact = first_contact([wall.surface for wall in walls], axes)
    if contact is None:
        return walls, ()
    place = place_text(contact.place)
    which = "a wall would meet itself" if contact.first == contact.second else "two walls would meet"
    note = f"{which} at {contact.share:.0%} of the layer's height, near {place}: its contours are swept straight"
    return swept_walls(slab, low, high), (note,)


def _in_planes(
    mesh: Mesh, wall: RuledWall, given: tuple[Section, Section], apart: tuple[Section, Section]
) -> RuledWall:
    """The wall carried on to the layer's own planes, with their loops' numbers, where it was taken a little inside them."""
    if apart == given:
        return wall
    curves = [wall.surface.curve0, wall.surface.curve1]
    numbers = [wall.bottom, wall.top]
    for k in range(2):
        if apart[k] is not given[k]:
            curves[k] = swept_curve(curves[k], given[k].plane, given[k].normal)
            names = names_in(given[k], apart[k], len(mesh.facets))
            numbers[k] = tuple(sorted({names[number] for number in numbers[k]} - {-1}))
    how = wall.how if numbers[0] and numbers[1] else "swept"
    return RuledWall(RuledSurface(curves[0], curves[1]), how, numbers[0], numbers[1], wall.twist_max_rad)
