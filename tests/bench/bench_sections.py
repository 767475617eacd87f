"""Sections of known surfaces: how far the STL's polygon, the facet fit and the surface fit lie from the true section."""

from __future__ import annotations

import time

import numpy as np
import shapely
import trimesh
from numpy.typing import NDArray

from planner.slicing import slice_mesh
from planner.slicing.contours import ContourStyle, section_curves_many
from planner.slicing.section import Section
from tests.bench.table import Cell, Table
from tests.unit.planner import smooth_surfaces as known

Floats = NDArray[np.float64]

WAYS = ("upright", "30 degrees", "tilted")
CHORD_MM = 1e-6  # of the points at which a curve is measured
LEAST_MM = 1e-9  # nothing is called closer than this


def run() -> list[Table]:
    """The tables that `make bench` prints."""
    return [accuracy(), rates()]


def accuracy() -> Table:
    """Largest distance from the true section, both ways, over all contours of all planes."""
    rows: list[list[Cell]] = []
    for name, make in known.SHAPES.items():
        shape = make()
        for way in WAYS:
            normal = known.direction(way)
            sections = known.sections_across(shape.mesh, normal)
            fits = [
                errors_of_fit(shape, sections, normal, ContourStyle(fit="facets")),
                errors_of_fit(shape, sections, normal, ContourStyle(handles="speed")),
                errors_of_fit(shape, sections, normal, ContourStyle()),
            ]
            polygon = polygon_errors(shape, sections, normal)
            ratio = float((polygon / np.maximum(fits[2], LEAST_MM)).min())
            peer = trimesh_error(shape, sections, normal)
            rows.append([name, way, float(polygon.max()), peer, *(float(fit.max()) for fit in fits), ratio])
    return Table(
        "Sections of known surfaces",
        (
            "surface", "planes", "STL polygon mm", "trimesh polygon mm", "facets fit mm", "surface fit, speed mm",
            "surface fit, curvature mm", "least ratio polygon / fit of any contour",
        ),
        rows,
        f"{len(known.SHARES)} planes each, R {known.RADIUS:g} mm (torus {known.RING:g} + {known.TUBE:g}). Truth is the "
        "analytic surface cut by the plane; distances within the plane, of the curve's points from the truth and of the "
        "truth from the curve. The wanted ratio is 20.",
    )  # fmt: skip


def errors_of_fit(shape: known.Shape, sections: list[Section], normal: Floats, style: ContourStyle) -> Floats:
    """The error of every contour, mm."""
    found = section_curves_many(sections, shape.mesh, style)
    return np.array(
        [
            both_ways(shape, made.curve.evaluate(made.curve.sample(CHORD_MM)), known.along(loop, 2), normal)
            for section, curves in zip(sections, found, strict=True)
            for loop, made in zip(section.loops, curves, strict=True)
        ]
    )


def polygon_errors(shape: known.Shape, sections: list[Section], normal: Floats) -> Floats:
    """The error of every loop's own polygon, mm."""
    loops = [loop for section in sections for loop in section.loops]
    return np.array([known.in_plane_distance(shape.field, known.along(loop, 16), normal).max() for loop in loops])


def trimesh_error(shape: known.Shape, sections: list[Section], normal: Floats) -> float:
    """The largest error of trimesh's section polygons, mm."""
    mesh = trimesh.Trimesh(shape.mesh.vertices, shape.mesh.facets, process=False)
    worst = 0.0
    for section in sections:
        path = mesh.section(plane_origin=section.origin + 1e-7 * normal, plane_normal=normal)
        for line in [] if path is None else path.discrete:
            points = np.concatenate([line[:-1] + share * np.diff(line, axis=0) for share in np.arange(16) / 16])
            worst = max(worst, float(known.in_plane_distance(shape.field, points, normal).max()))
    return worst


def both_ways(shape: known.Shape, points: Floats, probes: Floats, normal: Floats) -> float:
    """The larger of the points' distance from the true section and the true section's from the line through them."""
    truth = known.true_points(shape.field, probes, normal)
    truth = truth[np.abs(shape.field(truth)) < 1e-10]
    u, v = np.linalg.svd(normal[None, :])[2][1:]
    line = shapely.LineString(np.column_stack([points @ u, points @ v]))
    shapely.prepare(line)
    inward = shapely.distance(shapely.points(np.column_stack([truth @ u, truth @ v])), line).max(initial=0.0)
    return float(max(known.in_plane_distance(shape.field, points, normal).max(), inward))


def rates() -> Table:
    """CPU time of lifting, fitting and measuring all contours of a stack."""
    rows: list[list[Cell]] = []
    for name in ("sphere UV 48x24", "icosphere 4", "torus 48x24"):
        mesh = known.SHAPES[name]().mesh
        low, high = mesh.bounds[:, 2]
        heights = low + (high - low) * (np.arange(200) + 0.5) / 200.0
        planes = np.zeros((200, 6))
        planes[:, 2], planes[:, 5] = heights, 1.0
        sections = slice_mesh(mesh, planes)
        count = sum(len(loop.points) for section in sections for loop in section.loops)
        section_curves_many(sections, mesh)
        spent = []
        for _ in range(3):
            started = time.process_time()
            section_curves_many(sections, mesh)
            spent.append(time.process_time() - started)
        rows.append([name, len(sections), count, 1e3 * min(spent), 1e6 * min(spent) / count])
    return Table(
        "Contours of a stack",
        ("surface", "sections", "slice points", "CPU ms", "CPU µs a point"),
        rows,
        "Lift onto the smooth surface, fit, and both deviations measured; least of 3.",
    )
