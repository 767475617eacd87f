"""The side walls of one layer: ruled surfaces between the contours that belong together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from planner.matching.adjacency import Matching
from planner.matching.correspondence import match_outlines
from planner.matching.creases import corner_anchors, crease_graph
from planner.matching.outline import Outline, outline_of
from planner.matching.rulings import ruled_between
from planner.matching.slab import Slab
from planner.mesh.mesh import Mesh
from planner.mesh.smooth import smooth_surface
from planner.nurbs.curve import Curve
from planner.nurbs.ruled import RuledSurface
from planner.slicing.section import Section

Floats = NDArray[np.float64]
WallHow = Literal["direct", "indirect", "swept"]


@dataclass(frozen=True, eq=False)
class RuledWall:
    """One closed ring of a layer's side.

    surface : curve0 in the bottom plane, curve1 in the top plane, equal parameter = one ruling
    how : how its two contours were found to belong together; "swept" where one of them is the other, moved
    bottom, top : numbers of the loops of both sections that it stands for; empty where the section has none
    twist_max_rad : largest angle between the surface's normals at both ends of one ruling; 0 on a developable wall
    """

    surface: RuledSurface
    how: WallHow
    bottom: tuple[int, ...]
    top: tuple[int, ...]
    twist_max_rad: float


@dataclass(frozen=True, eq=False)
class LayerWalls:
    """The sides of the solid between two planes, ring by ring.

    bottom_plane, top_plane : (6,) float   a point (mm) and the unit normal
    bottom_loops, top_loops : the closed boundary curves in the two planes, material on the left seen against the
    normal; wall i joins bottom_loops[i] to top_loops[i]
    notes : one line for every wall that could not be ruled as its contours ask, and what was done
    """

    bottom_plane: Floats
    top_plane: Floats
    matching: Matching
    walls: tuple[RuledWall, ...]
    bottom_loops: tuple[Curve, ...]
    top_loops: tuple[Curve, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Rim:
    """The contours of one plane of a layer, ready to be joined.

    section : where they come from   curves : one per loop, in the layer's plane   outlines : the same, measured
    """

    section: Section
    curves: tuple[Curve, ...]
    outlines: tuple[Outline, ...]


def rim_of(mesh: Mesh, section: Section, curves: list[Curve], axes: Floats, crease_deg: float) -> Rim:
    """The rim of a section whose loops have these curves.  axes : (3, 3) float, as for `outline_of`."""
    surface = smooth_surface(mesh, crease_deg)
    outlines = [outline_of(curve, axes, loop, surface) for curve, loop in zip(curves, section.loops, strict=True)]
    return Rim(section, tuple(curves), tuple(outlines))


def joined(mesh: Mesh, slab: Slab, low: tuple[Rim, int], high: tuple[Rim, int], crease_deg: float) -> RuledSurface:
    """The ruled surface between one contour of the bottom rim and one of the top rim, given with their numbers."""
    outlines = (low[0].outlines[low[1]], high[0].outlines[high[1]])
    anchors = np.empty((0, 2, 2))
    if len(outlines[0].corners) and len(outlines[1].corners):
        loops = (low[0].section.loops[low[1]], high[0].section.loops[high[1]])
        anchors = corner_anchors(crease_graph(mesh, crease_deg), slab, loops, outlines)
    return ruled_between(*outlines, *match_outlines(*outlines, anchors))


def plane_axes(bottom: Section, top: Section) -> tuple[Floats, Floats]:
    """Axes (3, 3) of both planes against which directions are compared: two in the plane and its normal.

    The top's are the bottom's, turned the shortest way.
    """
    axes = bottom.frame[1:4]
    cross, cosine = np.cross(bottom.normal, top.normal), float(bottom.normal @ top.normal)
    turned = axes + np.cross(cross, axes) + np.cross(cross, np.cross(cross, axes)) / (1.0 + cosine)
    return axes, np.asarray(turned)
