"""Small parts with known shapes for the tests of planning."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.plan import Operation, Pass, Plan

Floats = NDArray[np.float64]


def box(x: float, y: float, z: float) -> Mesh:
    """A box on z = 0."""
    return Mesh.from_trimesh(trimesh.creation.box((x, y, z)))


def tube(inner_mm: float, outer_mm: float, height_mm: float, sections: int = 64) -> Mesh:
    """A tube along z."""
    return Mesh.from_trimesh(trimesh.creation.annulus(inner_mm, outer_mm, height_mm, sections=sections))


def frustum(bottom_mm: float, top_mm: float, height_mm: float, sections: int = 96) -> Mesh:
    """A cone frustum along z, of these radii."""
    angle = 2.0 * np.pi * np.arange(sections) / sections
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    low = np.column_stack([bottom_mm * ring, np.zeros(sections)])
    high = np.column_stack([top_mm * ring, np.full(sections, height_mm)])
    vertices = np.vstack([low, high, [[0.0, 0.0, 0.0], [0.0, 0.0, height_mm]]])
    k, n = np.arange(sections), np.roll(np.arange(sections), -1)
    s = sections
    facets = np.vstack(
        [
            np.column_stack([k, n, n + s]),
            np.column_stack([k, n + s, k + s]),
            np.column_stack([n, k, np.full(s, 2 * s)]),
            np.column_stack([k + s, n + s, np.full(s, 2 * s + 1)]),
        ]
    )
    return Mesh(vertices, facets)


def steps_of(plan: Plan) -> list[tuple[Operation, Pass]]:
    """All passes of a plan in order, each with its operation."""
    return [(operation, step) for operation in plan.operations for step in operation.passes]


def points_of(step: Pass) -> Floats:
    """(n, 3) float, mm: the tip at dense parameters."""
    return np.asarray(step.tip.evaluate(step.tip.sample(0.005)))


def lit_points(step: Pass) -> Floats:
    """(n, 3) float, mm: the tip where the laser is on."""
    rows = step.setpoints
    ends = np.append(rows[1:, 0], step.tip.length)
    arcs = [np.linspace(a, b, 200) for a, b, power in zip(rows[:, 0], ends, rows[:, 2], strict=True) if power > 0.0]
    return np.asarray(step.tip.evaluate(step.tip.at_arc_length(np.concatenate(arcs))))
