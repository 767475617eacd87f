"""What sections enclose by the curves that are fitted to them."""

from __future__ import annotations

from shapely import MultiPolygon

from planner.mesh.mesh import Mesh
from planner.slicing.contours import ContourStyle, fitted_curves, region_of
from planner.slicing.regions import Shapes
from planner.slicing.section import Section


def fitted_shapes(mesh: Mesh, style: ContourStyle) -> Shapes:
    """For `layer_regions`: the regions that fitted contours bound, their chords within 5e-4 mm.

    mesh : the one that is cut   style : how contours are made.
    """

    def shapes(sections: list[Section]) -> list[MultiPolygon]:
        curves = fitted_curves(sections, mesh, style)
        return [region_of(section, found) for section, found in zip(sections, curves, strict=True)]

    return shapes
