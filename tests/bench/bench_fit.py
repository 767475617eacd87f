"""Contours to curves: time per contour, accuracy, evaluation and offsets, each beside its peer in the same run."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline, splprep

from planner.nurbs.construct import circle
from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate, interpolate_many
from planner.nurbs.measure import closest_points
from planner.nurbs.offset import inset
from planner.nurbs.rings import curves_from_region, region_from_curves
from tests.bench.table import Table

Floats = NDArray[np.float64]

SECONDS_PER_MEASUREMENT = 0.2
BATCH = 100  # contours of a stack fitted in one call


def run() -> list[Table]:
    """The tables that `make bench` prints."""
    return [fit_times(), accuracy(), evaluation_rates(), offsets()]


def cpu_seconds(work: Callable[[], object]) -> float:
    """Least CPU time of one call over about SECONDS_PER_MEASUREMENT, after one call to warm up."""
    work()
    best, spent = np.inf, 0.0
    while spent < SECONDS_PER_MEASUREMENT:
        started = time.process_time()
        work()
        took = time.process_time() - started
        best, spent = min(best, took), spent + max(took, 1e-5)
    return float(best)


def ellipse_points(count: int) -> Floats:
    t = 2.0 * np.pi * np.arange(count) / count
    return np.column_stack([30.0 * np.cos(t), 10.0 * np.sin(t)])


def circle_points(radius: float, count: int) -> Floats:
    t = 2.0 * np.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(t), np.sin(t)])


def fit_times() -> Table:
    rows: list[list[str | int | float]] = []
    for count in (100, 1_000, 10_000):
        points = ellipse_points(count)
        loop = np.vstack([points, points[:1]])
        t = np.linspace(0.0, 1.0, count + 1)
        alone = cpu_seconds(lambda p=points: interpolate(p, closed=True))  # type: ignore[misc]
        batch = cpu_seconds(lambda p=points: interpolate_many([p] * BATCH, closed=True)) / BATCH  # type: ignore[misc]
        curvature = cpu_seconds(lambda p=points: interpolate(p, closed=True, handles="curvature"))  # type: ignore[misc]
        fitpack = cpu_seconds(lambda p=loop: splprep(p.T, s=0.0, per=True))  # type: ignore[misc]
        periodic = cpu_seconds(lambda x=t, p=loop: make_interp_spline(x, p, bc_type="periodic"))  # type: ignore[misc]
        rows.append([count, *(1e3 * s for s in (alone, batch, curvature, fitpack, periodic)), fitpack / batch])
    return Table(
        "Fit time per contour",
        ["points", "alone, ms", f"in a batch of {BATCH}, ms", "curvature handles, ms", "splprep, ms",
         "make_interp_spline, ms", "splprep / batch"],
        rows,
        "CPU time, best of repeated calls; a closed 30 x 10 ellipse; splprep with s = 0 and per = 1.",
    )  # fmt: skip


def distance_from_ellipse(points: Floats) -> float:
    """Largest distance from the 30 x 10 ellipse, by Newton on its angle."""
    x, y = points.T
    t = np.arctan2(y / 10.0, x / 30.0)
    for _ in range(20):
        cos, sin = np.cos(t), np.sin(t)
        slope = (30 * cos - x) * -30 * sin + (10 * sin - y) * 10 * cos
        t = t - slope / (900 * sin**2 + 100 * cos**2 - (30 * cos - x) * 30 * cos - (10 * sin - y) * 10 * sin)
    return float(np.hypot(30 * np.cos(t) - x, 10 * np.sin(t) - y).max())


def accuracy() -> Table:
    fine = np.linspace(0.0, 1.0, 50_001)

    def from_radius(radius: float) -> Callable[[Floats], float]:
        return lambda p: float(np.abs(np.linalg.norm(p, axis=1) - radius).max())

    cases: list[tuple[str, Floats, Callable[[Floats], float], str]] = [
        ("circle R 23, 100 points", circle_points(23.0, 100), from_radius(23.0), "1e-6"),
        ("12-gon of R 10", circle_points(10.0, 12), from_radius(10.0), "0.0021"),
        ("ellipse 30 x 10, 50 points", ellipse_points(50), distance_from_ellipse, "-"),
        ("ellipse 30 x 10, 100 points", ellipse_points(100), distance_from_ellipse, "4e-5"),
        ("ellipse 30 x 10, 1,000 points", ellipse_points(1000), distance_from_ellipse, "-"),
    ]
    rows: list[list[str | int | float]] = []
    for name, points, distance, asked in cases:
        loop = np.vstack([points, points[:1]])
        polygon = Curve.from_polyline(points, closed=True)
        peer = make_interp_spline(np.linspace(0.0, 1.0, len(loop)), loop, bc_type="periodic")
        curves = [interpolate(points, closed=True), interpolate(points, closed=True, handles="curvature"), polygon]
        found = [distance(curve.evaluate(fine)) for curve in curves]
        rows.append([name, asked, *(f"{error:.2e}" for error in (*found, distance(peer(fine))))])
    return Table(
        "Fit accuracy",
        ["contour", "asked of speed handles, mm", "speed handles, mm", "curvature handles, mm", "polygon, mm",
         "scipy periodic cubic, mm"],
        rows,
        "Largest distance from the true shape at 50,001 parameters.",
    )  # fmt: skip


def evaluation_rates() -> Table:
    curve = interpolate(np.column_stack([ellipse_points(1000), np.zeros(1000)]), closed=True)
    peer = BSpline(curve.knots, curve.control_points, 3)
    rows: list[list[str | int | float]] = []
    rng = np.random.default_rng(0)
    for name, u in (("sorted", np.linspace(0.0, 1.0, 500_000)), ("in no order", rng.random(500_000))):
        ours, theirs = (len(u) / cpu_seconds(lambda c=c, u=u: c(u)) / 1e6 for c in (curve.evaluate, peer))  # type: ignore[misc]
        rows.append([name, ours, theirs, ours / theirs])
    return Table(
        "Curve evaluation",
        ["parameters", "ours, million points/s", "scipy BSpline, million points/s", "ratio"],
        rows,
        "A cubic curve in space of 1,000 pieces, per second of CPU.",
    )


def offsets() -> Table:
    rows: list[list[str | int | float]] = []
    for name, source in (
        ("circle R 23", circle((0.0, 0.0), 23.0)),
        ("ellipse", interpolate(ellipse_points(400), closed=True)),
    ):
        region = region_from_curves([source])
        for away in (0.5, 2.0, 5.0):
            ours = inset(region, away)
            theirs = shapely.buffer(region, -away)
            errors = [
                float(
                    np.abs(
                        closest_points(source, shapely.get_coordinates(shapely.segmentize(shape, 0.1)))[1] - away
                    ).max()
                )
                for shape in (ours, theirs)
            ]
            rings = curves_from_region(ours)
            fitted = np.vstack([ring.curve.evaluate(ring.curve.sample(1e-4)) for ring in rings])
            curve_error = float(np.abs(closest_points(source, fitted)[1] - away).max())
            times = [
                1e3 * cpu_seconds(lambda r=region, d=away: inset(r, d)),  # type: ignore[misc]
                1e3 * cpu_seconds(lambda r=region, d=away: shapely.buffer(r, -d)),  # type: ignore[misc]
                1e3 * cpu_seconds(lambda o=ours: curves_from_region(o)),  # type: ignore[misc]
            ]
            pieces = sum(len(ring.curve.breaks) - 1 for ring in rings)
            rows.append(
                [name, away, *(f"{error:.2e}" for error in (errors[0], errors[1], curve_error)), pieces, *times]
            )
    return Table(
        "Constant-distance insets",
        ["source", "distance, mm", "error of our polygon, mm", "of shapely.buffer, mm", "of our curve, mm", "pieces",
         "inset, ms", "shapely.buffer, ms", "curves, ms"],
        rows,
        "Largest difference from the asked distance to the exact source curve; polygons sampled every 0.1 mm; "
        "shapely.buffer with its default of 16 sides per quarter.",
    )  # fmt: skip
