"""Contours along the smooth surface of parts whose curvature changes and jumps, coarse and fine."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from planner.slicing.contours import section_curves_many
from tests.unit.planner import smooth_parts as parts
from tests.unit.planner import smooth_surfaces as known

CASES: dict[str, tuple[Callable[[], known.Shape], float]] = {  # the part, times closer than the polygon at the worst
    "filleted cylinder, coarse": (lambda: parts.filleted_cylinder(24, 3), 1.4),
    "filleted cylinder, fine": (lambda: parts.filleted_cylinder(64, 8), 2.5),
    "rounded box": (lambda: parts.rounded_box(8), 5.0),
    "stadium, coarse": (lambda: parts.stadium(9), 10.0),
    "stadium, fine": (lambda: parts.stadium(24), 40.0),
    "vase, coarse": (lambda: parts.vase(16, 10), 2.5),
    "vase, fine": (lambda: parts.vase(96, 60), 25.0),
    "hyperboloid, coarse": (lambda: parts.hyperboloid(16, 8), 7.0),
    "hyperboloid, fine": (lambda: parts.hyperboloid(64, 32), 12.0),
    "ellipsoid, coarse": (lambda: parts.ellipsoid(24, 12), 2.0),
    "ellipsoid, fine": (lambda: parts.ellipsoid(64, 32), 20.0),
    "ellipsoid without rows, coarse": (lambda: parts.round_ellipsoid(2), 1.8),
    "ellipsoid without rows, fine": (lambda: parts.round_ellipsoid(4), 6.0),
    "icosphere 2": (lambda: known.icosphere(2), 40.0),
}


@pytest.mark.parametrize("name", CASES)
def test_no_contour_is_farther_from_the_true_section_than_the_polygon_and_fine_meshes_come_much_closer(
    name: str,
) -> None:
    make, times = CASES[name]
    shape = make()
    assert shape.mesh.is_closed
    for way in ("upright", "tilted", "steep", "lying"):
        normal = known.direction(way)
        sections = known.sections_across(shape.mesh, normal)
        for section, curves in zip(sections, section_curves_many(sections, shape.mesh), strict=True):
            for loop, made in zip(section.loops, curves, strict=True):
                polygon = known.in_plane_distance(shape.field, known.along(loop, 16), normal).max()
                edges = made.curve.breaks
                shares = np.arange(16) / 16
                points = made.curve.evaluate((edges[:-1, None] + shares * np.diff(edges)[:, None]).ravel())
                error = known.in_plane_distance(shape.field, points, normal).max()
                assert error <= max(polygon / times, 1e-9), (way, error, polygon)
