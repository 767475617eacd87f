"""Slicing time of the largest part against trimesh's multi-plane section, both in one run, areas compared."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import manifold3d  # type: ignore[import-not-found,unused-ignore]
import numpy as np
import trimesh
from numpy.typing import NDArray

from planner.mesh import Mesh, load
from planner.slicing import Section, slice_mesh
from tests.bench.table import Table

PART = Path(__file__).resolve().parents[2] / "config" / "parts" / "double_arc.stl"
PLANES = 200  # about the part's layers
SUBDIVISIONS = (0, 2)  # as it is (11 thousand facets) and each facet in 16 (179 thousand)

T = TypeVar("T")


def run() -> list[Table]:
    """Cut along z and along a tilted direction; raises AssertionError if the areas disagree."""
    part = load(PART)
    slice_mesh(part, planes_along(part, np.array([0.0, 0.0, 1.0]), 2))  # compile, or load what was compiled
    rows: list[list[str | int | float]] = []
    for times in SUBDIVISIONS:
        shape = part.to_trimesh()
        for _ in range(times):
            shape = shape.subdivide()
        mesh = Mesh.from_trimesh(shape)
        for name, direction in (("z", np.array([0.0, 0.0, 1.0])), ("tilted", np.array([0.6, 0.0, 0.8]))):
            rows.append(row_of(mesh, name, direction))
    note = (
        "One process, one thread unless the library takes more. Ours: adjacency, intersection, linking, nesting and "
        "orientation, facet of every segment; trimesh mesh_multiplane: unlinked segments only; manifold3d slice: "
        "linked polygons, z only, no facets, its own mesh already built. Largest relative difference of any section's area."
    )
    columns = [
        "facets", "planes along", "planes", "ours, ms", "trimesh, ms", "trimesh / ours", "manifold3d, ms", "area error",
    ]  # fmt: skip
    return [Table("Slicing", columns, rows, note)]


def row_of(mesh: Mesh, name: str, direction: NDArray[np.float64]) -> list[str | int | float]:
    """One line of the table."""
    planes = planes_along(mesh, direction, PLANES)
    ours_ms, sections = timed(lambda: slice_mesh(Mesh(mesh.vertices, mesh.facets), planes))
    heights = (planes[:, :3] - planes[0, :3]) @ direction
    shape = mesh.to_trimesh()
    _ = shape.face_normals
    trimesh_ms, (segments, to_space, facets) = timed(
        lambda: trimesh.intersections.mesh_multiplane(shape, planes[0, :3], direction, heights), 1
    )
    error = largest_error(
        sections,
        [
            flat_area(lines, mesh.normals[numbers] @ frame[:3, :2])
            for lines, frame, numbers in zip(segments, to_space, facets, strict=True)
        ],
    )
    manifold_ms: float | str = "-"
    if name == "z":
        solid = manifold3d.Manifold(manifold3d.Mesh64(mesh.vertices.copy(), mesh.facets.astype(np.uint64)))
        manifold_ms, cuts = timed(lambda: [solid.slice(float(height)).area() for height in planes[:, 2]])
        error = max(error, largest_error(sections, cuts))
    assert error < 1e-5, f"section areas disagree by {error:.2g}"
    return [len(mesh.facets), name, PLANES, ours_ms, trimesh_ms, trimesh_ms / ours_ms, manifold_ms, f"{error:.1e}"]


def planes_along(mesh: Mesh, direction: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """(count, 6) planes evenly between the mesh's ends along a direction."""
    along = mesh.vertices @ direction
    heights = np.linspace(along.min(), along.max(), 2 * count + 1)[1::2]
    return np.column_stack([heights[:, None] * direction, np.tile(direction, (count, 1))])


def timed(work: Callable[[], T], repeats: int = 3) -> tuple[float, T]:
    """Least time in ms of some repeats, and the last result."""
    best = np.inf
    for _ in range(repeats):
        started = time.perf_counter()
        result = work()
        best = min(best, time.perf_counter() - started)
    return 1e3 * best, result


def flat_area(lines: NDArray[np.float64], outward: NDArray[np.float64]) -> float:
    """Area enclosed by unlinked segments (n, 2, 2) by the divergence theorem; outward : (n, 2) normals of their facets."""
    along = lines[:, 1] - lines[:, 0]
    normal = np.column_stack([along[:, 1], -along[:, 0]])
    normal *= np.sign(np.einsum("ij,ij->i", normal, outward))[:, None]
    return float(0.5 * np.einsum("ij,ij->", lines.mean(axis=1), normal))


def largest_error(sections: list[Section], areas: list[float]) -> float:
    """Largest difference of areas, relative to the largest area."""
    ours = np.array([section.area_mm2 for section in sections])
    return float(np.abs(ours - np.array(areas)).max() / ours.max())
