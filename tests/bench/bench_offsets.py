"""Insets of the same contours by our offset curves, shapely, pyclipper and pyclipr: uniformity, size and time."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely import MultiPolygon

from planner.mesh import load
from planner.nurbs.construct import circle
from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.nurbs.offset_curves import offset_many
from planner.slicing import slice_mesh
from planner.slicing.contours import section_curves_many
from tests.bench.table import Cell, Table

Floats = NDArray[np.float64]

PARTS = Path(__file__).resolve().parents[2] / "config" / "parts"
LAYERS = 40
DISTANCES = [0.3 * k for k in range(1, 11)]  # mm: ten insets
SAMPLED_MM = 5e-4  # chord error of the polygons that the libraries get for the same accuracy
COARSE_MM = 5e-3  # and of the coarse ones, as polygons are commonly simplified
GRID = 1e6  # integer units per mm of the Clipper libraries
DENSE = 20_000  # points of the exact curves that distances are measured from: chords within 2e-6 mm
MEASURED = 2  # layers of each case whose insets are measured
REPEATS = 3
ENOUGH_S = 0.5  # of CPU time: what takes longer is run once

Inset = Callable[[], list[list[Floats]]]


def run() -> list[Table]:
    """The table that `make bench` prints."""
    columns = [
        "contours", "insets by", "CPU, ms", "time / ours", "|dist - d| min, mm", "mean, mm", "max, mm", "points of the result",
    ]  # fmt: skip
    note = (
        f"{LAYERS} layers with {len(DISTANCES)} insets each, {DISTANCES[0]:g} ... {DISTANCES[-1]:g} mm; least CPU time of "
        f"{REPEATS} runs in one process (one where it takes over {ENOUGH_S:g} s), "
        f"from the NURBS contours to curves (ours; made in one call) or from ready polygons to "
        f"polygons (libraries: the sampling of the curves is not counted). Distances of the results, at their vertices and "
        "between them, to the exact contours. Points: control points of ours, vertices of polygons. shapely is vectorised over "
        f"all layers, on polygons of {SAMPLED_MM:g} mm chord error and on ones simplified to {COARSE_MM:g} mm; the Clippers on "
        f"the former, grid {1.0 / GRID:g} mm."
    )
    rows = [row for name, layers in cases().items() for row in rows_of(name, layers)]
    return [Table("Offsets", columns, rows, note)]


def cases() -> dict[str, list[list[Curve]]]:
    """Per case the curves of every layer."""
    t = 2.0 * np.pi * np.arange(240) / 240
    ellipse = interpolate(np.column_stack([30 * np.cos(t), 10 * np.sin(t)]), closed=True)
    wave = (10.0 * (1.0 + 0.3 * np.cos(5.0 * t)))[:, None] * np.column_stack([np.cos(t), np.sin(t)])
    tooth = 2.0 * np.pi * (np.repeat(np.arange(24), 4) + np.tile([-0.3, -0.2, 0.2, 0.3], 24)) / 24
    reach = np.tile([24.0, 28.0, 28.0, 24.0], 24)[:, None]
    gear = Curve.from_polyline(reach * np.column_stack([np.cos(tooth), np.sin(tooth)]), closed=True)
    drawn = {
        "ellipse 30 x 10": [ellipse],
        "gear of 24 teeth": [gear, circle((0.0, 0.0), 8.0)],
        "wavy hole": [circle((0.0, 0.0), 28.0), interpolate(wave, closed=True)],
    }
    made = {name: [curves] * LAYERS for name, curves in drawn.items()}
    return {**{name: sections(name) for name in ("pipe", "bearing")}, **made}


def sections(part: str) -> list[list[Curve]]:
    """The contours of evenly spread sections of a part."""
    mesh = load(PARTS / f"{part}.stl")
    low, high = mesh.bounds[:, 2]
    planes = np.zeros((LAYERS, 6))
    planes[:, 2] = low + (high - low) * (np.arange(LAYERS) + 0.5) / LAYERS
    planes[:, 5] = 1.0
    return [[found.curve for found in layer] for layer in section_curves_many(slice_mesh(mesh, planes), mesh)]


def rows_of(name: str, layers: list[list[Curve]]) -> list[list[Cell]]:
    """One line per peer."""
    known = {id(curves): region(curves, SAMPLED_MM) for curves in layers}
    fine = [known[id(curves)] for curves in layers]
    coarse = [shapely.simplify(shape, COARSE_MM) for shape in fine]
    peers: list[tuple[str, Inset | None]] = [
        ("ours, 2e-4 mm", None),
        (f"shapely, {SAMPLED_MM:g} mm", lambda: by_shapely(fine, SAMPLED_MM)),
        (f"shapely, {COARSE_MM:g} mm", lambda: by_shapely(coarse, COARSE_MM)),
        ("pyclipper", clipper("pyclipper", fine)),
        ("pyclipr", clipper("pyclipr", fine)),
    ]
    sets = [[flat(curve) for curve in curves] for curves in layers]
    inward = [-d for d in DISTANCES]
    ours_ms, found = cpu_ms(lambda: offset_many(sets, inward))
    curves = [[[ring.curve for ring in rings] for rings in row] for row in found]
    measured = list(range(0, len(layers), -(-len(layers) // MEASURED)))
    exact = [[Dense(curve) for curve in sets[k]] for k in measured]
    samples = [[[c.evaluate(np.linspace(0.0, 1.0, 1200)) for c in inset] for inset in curves[k]] for k in measured]
    count = sum(len(c.control_points) for row in curves for inset in row for c in inset)
    rows: list[list[Cell]] = [[name, "ours, 2e-4 mm", ours_ms, 1.0, *uniformity(exact, samples, False), count]]
    for peer, work in peers[1:]:
        if work is None:
            rows.append([name, peer, "not installed", "-", "-", "-", "-", "-"])
            continue
        ms, table = cpu_ms(work)
        per_layer = [[table[k + i * len(layers)] for i in range(len(DISTANCES))] for k in measured]
        rows.append([name, peer, ms, ms / ours_ms, *uniformity(exact, per_layer, True), sum(len(p) for rings in table for p in rings)])
    return rows


def flat(curve: Curve) -> Curve:
    """A level curve in the plane."""
    return Curve(curve.degree, curve.knots, curve.control_points[:, :2], curve.weights)


def region(curves: list[Curve], chord_mm: float) -> shapely.Geometry:
    """The even-odd region of sampled curves."""
    rings = [shapely.Polygon(curve.evaluate(curve.sample(chord_mm))[:, :2]) for curve in curves]
    whole: shapely.Geometry = MultiPolygon()
    for ring in rings:
        whole = shapely.symmetric_difference(whole, ring)
    return whole


def by_shapely(regions: list[shapely.Geometry], chord_mm: float) -> list[list[Floats]]:
    """Rings of all insets, distance by distance, all layers of one in one call."""
    found = []
    for distance in DISTANCES:
        quarter = int(np.ceil(0.25 * np.pi / np.arccos(1.0 - chord_mm / distance)))
        found.append(shapely.buffer(np.array(regions), -distance, quad_segs=quarter))
    return [rings_of(shape) for shape in np.concatenate(found)]


def rings_of(shape: shapely.Geometry) -> list[Floats]:
    """Closed rings of polygons, (n, 2) float each."""
    parts = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
    lines = [ring for part in parts for ring in (part.exterior, *part.interiors)]
    return [shapely.get_coordinates(line) for line in lines if len(line.coords)]


def clipper(name: str, regions: list[shapely.Geometry]) -> Inset | None:
    """Insets by a Clipper library, or None where it is not installed."""
    try:
        library = importlib.import_module(name)
    except ImportError:
        return None
    paths = [[ring[:-1] for ring in rings_of(shapely.orient_polygons(shape))] for shape in regions]
    if name == "pyclipr":
        return lambda: [by_pyclipr(library, rings, distance) for distance in DISTANCES for rings in paths]
    grid = [[np.round(ring * GRID).astype(np.int64).tolist() for ring in rings] for rings in paths]
    return lambda: [by_pyclipper(library, rings, distance) for distance in DISTANCES for rings in grid]


def by_pyclipr(library: object, rings: list[Floats], distance: float) -> list[Floats]:
    """One inset by Clipper 2."""
    offset = library.ClipperOffset()  # type: ignore[attr-defined]
    offset.scaleFactor = int(GRID)
    offset.arcTolerance = SAMPLED_MM * GRID
    offset.addPaths(rings, library.JoinType.Round, library.EndType.Polygon)  # type: ignore[attr-defined]
    return [np.vstack([path, path[:1]])[:, :2] for path in offset.execute(-distance)]


def by_pyclipper(library: object, rings: list[list[list[int]]], distance: float) -> list[Floats]:
    """One inset by Clipper 1."""
    offset = library.PyclipperOffset(2.0, SAMPLED_MM * GRID)  # type: ignore[attr-defined]
    offset.AddPaths(rings, library.JT_ROUND, library.ET_CLOSEDPOLYGON)  # type: ignore[attr-defined]
    found = offset.Execute(-distance * GRID)
    return [np.array([*path, path[0]], dtype=np.float64) / GRID for path in found]


def cpu_ms(work: Callable[[], object]) -> tuple[float, object]:  # type: ignore[type-arg,unused-ignore]
    """Least CPU time in ms of some runs, and the last result."""
    best, result = np.inf, None
    for _ in range(REPEATS):
        started = time.process_time()
        result = work()
        best = min(best, time.process_time() - started)
        if best > ENOUGH_S:
            break
    return 1e3 * best, result


class Dense:
    """A closed curve as a dense polyline, and a tree of its points."""

    def __init__(self, curve: Curve) -> None:
        self.path = curve.evaluate(np.union1d(np.linspace(*curve.domain, DENSE), curve.breaks))
        self.tree = cKDTree(self.path[:-1])

    def away(self, points: Floats) -> Floats:
        """Distance of points, mm: from the sides on both sides of the nearest of the polyline's points."""
        path, best = self.path, np.full(len(points), np.inf)
        near = self.tree.query(points)[1]
        for step in (-1, 0):
            low = path[(near + step) % (len(path) - 1)]
            side = path[(near + step) % (len(path) - 1) + 1] - low
            share = ((points - low) * side).sum(axis=1) / np.maximum((side**2).sum(axis=1), 1e-300)
            best = np.minimum(best, np.linalg.norm(points - low - np.clip(share, 0.0, 1.0)[:, None] * side, axis=1))
        return best


def uniformity(layers: list[list[Dense]], insets: list[list[list[Floats]]], are_polygons: bool) -> list[Cell]:
    """Least, mean and largest | distance - d | at the points of the insets, of polygons also half-way between, mm."""
    off = []
    for exact, row in zip(layers, insets, strict=True):
        for distance, rings in zip(DISTANCES, row, strict=True):
            if rings:
                points = np.vstack([*rings, *(0.5 * (ring[1:] + ring[:-1]) for ring in rings if are_polygons)])
                off.append(np.abs(np.min([dense.away(points) for dense in exact], axis=0) - distance))
    every = np.concatenate(off) if off else np.zeros(1)
    return [f"{every.min():.1e}", f"{every.mean():.1e}", f"{every.max():.1e}"]
