"""Slicing against manifold3d's slice and trimesh's multi-plane section, both in one run, areas compared; and its growth."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
import trimesh
from numpy.typing import NDArray

from planner.mesh import Mesh, load, load_bytes
from planner.slicing import Section, slice_mesh
from tests.bench.table import Table

ROOT = Path(__file__).resolve().parents[2]
PARTS = ROOT / "config" / "parts"
PLANES = 200  # about a part's layers
CASES = (
    ("pipe", 0),
    ("bearing", 0),
    ("double_arc", 0),
    ("double_arc", 2),
)  # part, and how often each facet is quartered
Z = np.array([0.0, 0.0, 1.0])
TILTED = np.array([0.6, 0.0, 0.8])
MOST_BYTES = 8.0  # of memory, per byte of the mesh

T = TypeVar("T")


def run() -> list[Table]:
    """Cut along z and along a tilted direction; raises AssertionError if the areas disagree."""
    part = load(PARTS / "pipe.stl")
    for direction in (Z, TILTED):
        slice_mesh(part, planes_along(part, direction, 2))  # compile, or load what was compiled
    return [compared(), grown(), loaded()]


def compared() -> Table:
    """The same parts and planes for all three."""
    rows: list[list[str | int | float]] = []
    for name, times in CASES:
        shape = load(PARTS / f"{name}.stl").to_trimesh()
        for _ in range(times):
            shape = shape.subdivide()
        mesh = Mesh.from_trimesh(shape)
        rows += [row_of(name, mesh, "z", Z), row_of(name, mesh, "tilted", TILTED)]
    note = (
        f"CPU time of one process, {PLANES} planes; least of some repeats. Ours, with all contours linked, oriented and "
        "nested and the facet of every segment known: first cut of a new mesh (its half-edges are paired then), and any "
        "later one. trimesh mesh_multiplane: unlinked segments only, normals ready. manifold3d slice per height: linked "
        "polygons, z only, no facets, its own mesh ready. Ratios are to ours on a mesh that is ready, as theirs is. Area "
        "error: largest relative difference of any section's area."
    )
    columns = [
        "part", "facets", "planes along", "ours first, ms", "ours, ms", "trimesh, ms", "trimesh / ours",
        "manifold3d, ms", "manifold3d / ours", "area error",
    ]  # fmt: skip
    return Table("Slicing", columns, rows, note)


def row_of(name: str, mesh: Mesh, along: str, direction: NDArray[np.float64]) -> list[str | int | float]:
    """One line of the table of peers."""
    planes = planes_along(mesh, direction, PLANES)
    first_ms, _ = timed(lambda: slice_mesh(Mesh(mesh.vertices, mesh.facets), planes), 3)
    ours_ms, sections = timed(lambda: slice_mesh(mesh, planes), 5)
    heights = (planes[:, :3] - planes[0, :3]) @ direction
    shape = mesh.to_trimesh()
    _ = shape.face_normals
    trimesh_ms, (segments, to_space, facets) = timed(
        lambda: trimesh.intersections.mesh_multiplane(shape, planes[0, :3], direction, heights), 2
    )
    true_areas = [
        flat_area(lines, mesh.normals[numbers] @ frame[:3, :2])
        for lines, frame, numbers in zip(segments, to_space, facets, strict=True)
    ]
    error = largest_error(sections, true_areas)
    manifold_ms: float | str = "-"
    ratio: float | str = "-"
    if along == "z":
        manifold_ms, cuts = manifold_slices(mesh, planes[:, 2])
        error = max(error, largest_error(sections, cuts))
        ratio = manifold_ms / ours_ms
    assert error < 1e-5, f"section areas disagree by {error:.2g}"
    return [
        name, len(mesh.facets), along, first_ms, ours_ms, trimesh_ms, trimesh_ms / ours_ms, manifold_ms, ratio,
        f"{error:.1e}",
    ]  # fmt: skip


def manifold_slices(mesh: Mesh, heights: NDArray[np.float64]) -> tuple[float, list[float]]:
    """Time in ms of manifold3d's slices at all heights, and their areas."""
    import manifold3d  # type: ignore[import-not-found,unused-ignore]

    solid = manifold3d.Manifold(manifold3d.Mesh64(mesh.vertices.copy(), mesh.facets.astype(np.uint64)))
    levels = heights.tolist()
    spent_ms, cuts = timed(lambda: [solid.slice(level) for level in levels], 3)
    return spent_ms, [cut.area() for cut in cuts]


def planes_along(mesh: Mesh, direction: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """(count, 6) planes evenly between the mesh's ends along a direction."""
    along = mesh.vertices @ direction
    heights = np.linspace(along.min(), along.max(), 2 * count + 1)[1::2]
    return np.column_stack([heights[:, None] * direction, np.tile(direction, (count, 1))])


def timed(work: Callable[[], T], repeats: int = 3) -> tuple[float, T]:
    """Least CPU time in ms of some repeats, and the last result."""
    best = np.inf
    for _ in range(repeats):
        started = time.process_time()
        result = work()
        best = min(best, time.process_time() - started)
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


def grown() -> Table:
    """Time and memory of balls of more and more facets, each measured in a process of its own, which gives freed arrays back at once."""
    rows: list[list[str | int | float]] = []
    for bands in (35, 112, 354, 707):
        for planes in (100, 400):
            output = subprocess.run(
                [sys.executable, "-m", "tests.bench.slicing_growth", str(bands), str(planes)],
                cwd=ROOT, env={**os.environ, "MALLOC_MMAP_THRESHOLD_": "65536"}, capture_output=True, text=True, check=True,
            ).stdout  # fmt: skip
            facets, crossed, first_ms, pair_ms, ours_ms, mesh_bytes, peak_bytes = (float(w) for w in output.split())
            assert facets < 1e5 or peak_bytes < MOST_BYTES * mesh_bytes, f"{peak_bytes / mesh_bytes:.1f} times the mesh"
            rows.append(
                [
                    int(facets), planes, int(crossed), first_ms, pair_ms, ours_ms,
                    1e6 * first_ms / (facets + crossed), 1e6 * ours_ms / (facets + crossed),
                    mesh_bytes / 1e6, peak_bytes / mesh_bytes,
                ]
            )  # fmt: skip
    note = (
        "Balls, z-planes; CPU time, each row in a new process. Crossed: pairs of facet and plane that "
        "meet. First: a new mesh, half-edges paired, everything linked and nested; the column after it is the pairing "
        "alone. ns: per facet and crossing together. Memory: growth of the process's peak during the first cut, results "
        "included, over the bytes of vertices and facets (small meshes: a process grows in steps)."
    )
    columns = [
        "facets", "planes", "crossed", "first, ms", "of it pairing, ms", "later, ms", "first, ns", "later, ns",
        "mesh, MB", "memory / mesh",
    ]  # fmt: skip
    return Table("Slicing growth", columns, rows, note)


def loaded() -> Table:
    """From a binary STL's bytes to a closed, checked mesh, against trimesh's reading and merging alone."""
    rows: list[list[str | int | float]] = []
    for divisions in (6, 8):
        data = trimesh.creation.icosphere(subdivisions=divisions, radius=20.0).export(file_type="stl")
        ours_ms, mesh = timed(lambda data=data: load_bytes(data, ".stl"), 2)  # type: ignore[misc]
        theirs_ms, _ = timed(lambda data=data: trimesh.load(trimesh.util.wrap_as_stream(data), file_type="stl"), 1)  # type: ignore[misc]
        rows.append([len(mesh.facets), len(data) / 1e6, ours_ms, theirs_ms, theirs_ms / ours_ms])
    note = "CPU time. Ours: read, merge, mend, orient, test for self-crossing. trimesh.load: read and merge vertices."
    return Table(
        "Loading a binary STL", ["facets", "file, MB", "ours, ms", "trimesh, ms", "trimesh / ours"], rows, note
    )
