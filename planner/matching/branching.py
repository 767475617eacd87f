"""Walls where contours begin, end, part or join: swept along the plane's normal, begun where the surface begins."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.errors import FitError
from planner.matching.adjacency import Group, loop_of_facet, match_in_slab
from planner.matching.slab import Slab, slab_of
from planner.matching.twist import largest_twist
from planner.matching.walls import Rim, RuledWall, joined, plane_axes, rim_of
from planner.mesh.mesh import Mesh
from planner.nurbs.curve import Curve
from planner.nurbs.ruled import RuledSurface
from planner.slicing.contours import ContourStyle, fitted_curves
from planner.slicing.section import Section
from planner.slicing.slicer import slice_mesh

Floats = NDArray[np.float64]

NEAR_SHARE = 1e-3
"""Of a layer's thickness: how far from the place where a surface begins, ends or parts its section is taken. At the
place itself the contour has no area or touches itself; the wall's error from this is as small."""
IN_PLANE_FRACTION = 2e-6
"""Of the mesh's diagonal: vertices this near to a plane count as in it; level edges in 32-bit coordinates are no more level."""
_SHARED = 0.2  # of its facets: a loop that shares fewer with another plane's loop stands for none there


def swept_curve(curve: Curve, plane: Floats, normal: Floats) -> Curve:
    """The curve moved along `normal` into a plane.  plane : (6,) float, a point (mm) and a unit normal;  normal : (3,)."""
    slope = float(plane[3:] @ normal)
    projection = np.eye(4)
    projection[:3, :3] -= np.outer(normal, plane[3:]) / slope
    projection[:3, 3] = normal * (float(plane[3:] @ plane[:3]) / slope)
    return curve.transformed(projection)


def branch_walls(
    mesh: Mesh, slab: Slab, low: Rim, high: Rim, group: Group, style: ContourStyle
) -> list[RuledWall]:
    """The rings of a group whose contours do not correspond one to one.

    Where a surface begins or ends in the layer, the section next to that place is swept on to the plane and joined to
    the contours of the other plane. Where contours part, those of the branches (top) are swept down onto the bottom
    plane; where they join, those of the branches (bottom) are swept up. Swept rings of one plane never meet.
    Source: paper §V, Figs. 11 and 12.
    """
    if group.kind in ("begin", "hole_opens", "end", "hole_closes"):
        opened = _opened(mesh, slab, low, high, group, style)
        if opened is not None:
            return opened
    if len(group.bottom) >= len(group.top) and group.bottom:
        return [_swept_up(slab, low, number, group.top) for number in group.bottom]
    return [_swept_down(slab, high, number, group.bottom) for number in group.top]


def swept_walls(slab: Slab, low: Rim, high: Rim) -> list[RuledWall]:
    """All contours of the plane that has more of them (of the bottom if equal), swept straight to the other plane."""
    if len(low.curves) >= len(high.curves):
        return [_swept_up(slab, low, number, ()) for number in range(len(low.curves))]
    return [_swept_down(slab, high, number, ()) for number in range(len(high.curves))]


def _swept_up(slab: Slab, low: Rim, number: int, top: tuple[int, ...]) -> RuledWall:
    curve = low.outlines[number].curve
    surface = RuledSurface(curve, swept_curve(curve, slab.top, slab.bottom[3:]))
    return RuledWall(surface, "swept", (number,), top, largest_twist(surface))


def _swept_down(slab: Slab, high: Rim, number: int, bottom: tuple[int, ...]) -> RuledWall:
    curve = high.outlines[number].curve
    surface = RuledSurface(swept_curve(curve, slab.bottom, slab.top[3:]), curve)
    return RuledWall(surface, "swept", bottom, (number,), largest_twist(surface))


def _opened(
    mesh: Mesh, slab: Slab, low: Rim, high: Rim, group: Group, style: ContourStyle
) -> list[RuledWall] | None:
    """Rings from the place where a surface begins (or to where it ends); None where it branches on its way."""
    begins = not group.bottom
    rim, numbers = (high, group.top) if begins else (low, group.bottom)
    section = near_section(mesh, slab, rim.section.loops[numbers[0]].facets, begins)
    bottom, top = (section, high.section) if begins else (low.section, section)
    inner = slab_of(mesh, bottom.plane, top.plane)
    wanted = set(numbers)
    pairs = [
        (found.bottom[0], found.top[0])
        for found in match_in_slab(mesh, bottom, top, inner).groups
        if found.kind == "one_to_one" and (found.top[0] if begins else found.bottom[0]) in wanted
    ]
    if len(pairs) != len(numbers):
        return None
    try:
        curves = fitted_curves([section], mesh, style)[0]
        other = rim_of(mesh, section, curves, plane_axes(bottom, top)[0 if begins else 1], style.crease_deg)
    except FitError:
        return None
    rings = []
    for first, second in pairs:
        ends = ((other, first), (high, second)) if begins else ((low, first), (other, second))
        surface = joined(mesh, inner, *ends, style.crease_deg)
        low_curve, high_curve = surface.curve0, surface.curve1
        if begins:
            low_curve = swept_curve(low_curve, slab.bottom, slab.top[3:])
        else:
            high_curve = swept_curve(high_curve, slab.top, slab.bottom[3:])
        surface = RuledSurface(low_curve, high_curve)
        own = (() if begins else (first,), (second,) if begins else ())
        rings.append(RuledWall(surface, "swept", *own, largest_twist(surface)))
    return rings


def near_section(mesh: Mesh, slab: Slab, facets: NDArray[np.int64], begins: bool) -> Section:
    """The section next to the lowest (begins) or highest place of the piece of surface that holds these facets."""
    piece = int(slab.component[facets].max())
    corners = mesh.facets[slab.component == piece].ravel()
    depth = slab.above if begins else slab.below
    least = max(float(depth[corners].min()), 0.0)
    most = float((slab.above + slab.below)[corners].min())
    plane = (slab.bottom if begins else slab.top).copy()
    away = least + NEAR_SHARE * max(most - least, 0.0)
    plane[:3] += plane[3:] * (away if begins else -away)
    return slice_mesh(mesh, plane[None], "above" if begins else "below")[0]


def sections_apart(mesh: Mesh, bottom: Section, top: Section) -> tuple[Section, Section]:
    """Both sections; one in whose plane the surface begins, ends, parts or folds is taken a little inside the layer.

    In such a plane contours touch themselves or have no width, so that the section shows less than what lies next to it:
    a mesh vertex in the plane is passed twice, or not at all.
    """
    slab = slab_of(mesh, bottom.plane, top.plane)
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[mesh.facets[slab.component >= 0].ravel()] = True
    sections = []
    for section, height, way in ((bottom, slab.above, 1.0), (top, slab.below, -1.0)):
        passed = _vertices_passed(section)
        in_plane = np.flatnonzero(used & (np.abs(height) <= IN_PLANE_FRACTION * mesh.diagonal))
        if len(np.unique(passed)) < len(passed) or len(np.setdiff1d(in_plane, passed)):
            section = _moved(mesh, slab, section, way)
        sections.append(section)
    return sections[0], sections[1]


def _moved(mesh: Mesh, slab: Slab, section: Section, way: float) -> Section:
    """The section a little further along (way 1) or against (-1) its normal."""
    thickness = abs(float((slab.top[:3] - slab.bottom[:3]) @ slab.bottom[3:]))
    plane = section.plane.copy()
    step = min(max(NEAR_SHARE * thickness, 4.0 * IN_PLANE_FRACTION * mesh.diagonal), 0.25 * thickness)
    plane[:3] += plane[3:] * (way * step)
    return slice_mesh(mesh, plane[None], "above" if way > 0.0 else "below")[0]


def _vertices_passed(section: Section) -> NDArray[np.int64]:
    """Mesh vertices that are points of the section's contours, as often as they are."""
    if not section.loops:
        return np.empty(0, dtype=np.int64)
    edges = np.concatenate([loop.edges for loop in section.loops])
    weights = np.concatenate([loop.weights for loop in section.loops])
    return np.concatenate([edges[weights <= 0.0, 0], edges[weights >= 1.0, 1]])


def names_in(given: Section, found: Section, facet_count: int) -> tuple[int, ...]:
    """For each loop of the section found the number of the loop of the given section that it stands for; -1 for none.

    The one that most of its facets belong to: the two planes are next to each other.
    """
    if found is given:
        return tuple(range(len(given.loops)))
    owner = loop_of_facet(given.loops, facet_count)
    names = []
    for loop in found.loops:
        numbers = owner[loop.facets]
        counts = np.bincount(numbers[numbers >= 0], minlength=1)
        names.append(int(counts.argmax()) if counts.max() > _SHARED * len(numbers) else -1)
    return tuple(names)
