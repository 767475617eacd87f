"""One small part from mesh to offsets, layers and what hangs of it, its numbers in a file: `python -m tests.unit.kernel_chain FILE.npz`."""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from planner.collide.reach import reach
from planner.collide.shapes import HeadShape
from planner.decompose.hanging import Limits, hanging
from planner.nurbs.fit import Handles
from planner.nurbs.offset_curves import offset_curves
from planner.slicing.contours import ContourStyle, section_curves_many
from planner.slicing.cusp import LayerRule
from planner.slicing.thickness import layer_heights
from tests.unit.planner.smooth_surfaces import direction, sections_across, torus

Floats = NDArray[np.float64]
HANDLES: tuple[Handles, ...] = ("curvature", "speed")
RULES: tuple[LayerRule, ...] = ("facet", "extruded")


def chain() -> dict[str, Floats]:
    """Knots and control points of the contours, of their offsets, layer heights, what hangs and clearances of a coarse torus, by name; mm."""
    mesh, normal = torus(10, 6).mesh, direction("tilted")
    sections = sections_across(mesh, normal)
    found = {f"loop {k}": loop.points for k, loop in enumerate(loop for section in sections for loop in section.loops)}
    for handles in HANDLES:
        for k, curves in enumerate(section_curves_many(sections, mesh, ContourStyle(handles=handles))):
            for i, made in enumerate(curves):
                name = f"{handles} section {k} curve {i}"
                found[name], found[f"{name} knots"] = made.curve.control_points, made.curve.knots
                found[f"{name} deviations"] = np.array([made.deviation_mm, made.smooth_deviation_mm])
    level = sections_across(mesh, direction("upright"))[3:5]
    for k, curves in enumerate(section_curves_many(level, mesh)):
        for i, curve in enumerate(offset_curves([made.curve for made in curves], -0.7)):
            found[f"offset {k} curve {i}"], found[f"offset {k} curve {i} knots"] = curve.control_points, curve.knots
    for rule in RULES:
        found[f"layers {rule}"] = layer_heights(mesh, (0.0, 0.0, 1.0), 0.3, 0.1, 2.0, rule=rule)
    base = np.array([0.0, 0.0, mesh.bounds[0][2], 0.0, 0.0, 1.0])
    hangs = hanging(mesh, base, None, Limits(35.0, 70.0, 0.5, 0.1, 3.0))
    found["hanging"], found["hanging tilted"] = hangs.weights, np.array([hangs.total_mm2, hangs.tilted_mm2])
    tips, axes = mesh.vertices[:4], np.tile([0.6, 0.0, 0.8], (4, 1))
    found["reach"] = reach(tips, axes, mesh.vertices, (80.0, 80.0), HeadShape()).clearance_mm
    return found


if __name__ == "__main__":
    np.savez(sys.argv[1], **chain())  # type: ignore[arg-type]
