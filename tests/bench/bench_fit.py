"""Contours to curves: time per contour and distance from the true shape, beside peers in the same run."""

from __future__ import annotations

import importlib
import importlib.util
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, splev, splprep

from planner.nurbs.curve import Curve
from planner.nurbs.fit import Handles, fit_table, interpolate, interpolate_many
from planner.nurbs.measure import closest_points, deviation
from planner.nurbs.segments import contour_table
from tests.bench.table import Cell, Table
from tests.unit.planner.fit_shapes import SPACINGS, Shape, known_shapes

Floats = NDArray[np.float64]

SECONDS_PER_MEASUREMENT = 0.2
ABSENT = "not installed"
PROBES = np.linspace(0.0, 1.0, 50_001)


def run() -> list[Table]:
    """The tables that `make bench` prints."""
    return [fit_times(), accuracy(), families(), corners(), deviation_times()]


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


def ellipse_points(a: float, b: float, count: int) -> Floats:
    """(count, 2) float, mm   Points at even angles."""
    t = 2.0 * np.pi * np.arange(count) / count
    return np.column_stack([a * np.cos(t), b * np.sin(t)])


def occ_spline(points: Floats) -> Any:
    """OpenCascade's periodic interpolation of plane points: its Geom_BSplineCurve."""
    gp, api, arrays = (importlib.import_module(f"OCP.{name}") for name in ("gp", "GeomAPI", "collections"))
    table = arrays.HArray1_gp_Pnt(1, len(points))
    for number, (x, y) in enumerate(points.tolist(), 1):
        table.SetValue(number, gp.gp_Pnt(x, y, 0.0))
    maker = api.GeomAPI_Interpolate(table, True, 1e-9)
    maker.Perform()
    return maker.Curve()


def has_occ() -> bool:
    """Whether OpenCascade (cadquery-ocp) is installed."""
    return importlib.util.find_spec("OCP") is not None


def fit_times() -> Table:
    """One contour and batches, both handles, against splprep and OpenCascade."""
    rows: list[list[Cell]] = []
    for count, batch in ((100, 100), (1_000, 100), (10_000, 20)):
        points = ellipse_points(30.0, 10.0, count)
        loop = np.vstack([points, points[:1]])
        fitpack = cpu_seconds(lambda p=loop: splprep(p.T, s=0.0, per=True))  # type: ignore[misc]
        occ = cpu_seconds(lambda p=points: occ_spline(p)) if has_occ() else None  # type: ignore[misc]
        peers: list[Cell] = [1e3 * fitpack, ABSENT if occ is None else 1e3 * occ]
        kinds: tuple[Handles, ...] = ("speed", "curvature")
        for kind in kinds:
            alone = cpu_seconds(lambda p=points, k=kind: interpolate(p, closed=True, handles=k))  # type: ignore[misc]
            many = cpu_seconds(
                lambda p=points, k=kind, n=batch: interpolate_many([p] * n, closed=True, handles=k)  # type: ignore[misc]
            )
            limit = 1.0 if count == 100 else 5.0
            ratios: list[Cell] = [fitpack / alone, fitpack * batch / many, ABSENT if occ is None else occ / alone]
            rows.append([count, kind, 1e3 * alone, batch, 1e3 * many / batch, *peers, *ratios, limit])
    return Table(
        "Fit time per contour",
        ["points", "handles", "alone, ms", "batch of", "in a batch, ms each", "splprep, ms", "OCC Interpolate, ms",
         "splprep / alone", "splprep / in a batch", "OCC / alone", "splprep must be times slower"],
        rows,
        "CPU time, best of repeated calls; a closed 30 x 10 ellipse; splprep with s = 0 and per = True. The limit is "
        "for one contour, at 100 points for a batch.",
    )  # fmt: skip


def distance_from_ellipse(a: float, b: float) -> Callable[[Floats], float]:
    """Largest distance of points from an ellipse, mm, by Newton on its angle."""

    def farthest(points: Floats) -> float:
        x, y = points.T
        t = np.arctan2(y / b, x / a)
        for _ in range(20):
            cos, sin = np.cos(t), np.sin(t)
            slope = (a * cos - x) * -a * sin + (b * sin - y) * b * cos
            bend = a * a * sin**2 + b * b * cos**2 - (a * cos - x) * a * cos - (b * sin - y) * b * sin
            t = t - slope / bend
        return float(np.hypot(a * np.cos(t) - x, b * np.sin(t) - y).max())

    return farthest


def accuracy() -> Table:
    """Circles, ellipses and the dodecagon with both handles, as exact arcs, and by the peers."""
    rows: list[list[Cell]] = []
    for name, a, b, count, speed_limit, limit in (
        ("circle R 23", 23.0, 23.0, 100, "1e-6", "1e-8"),
        ("12-gon of R 10", 10.0, 10.0, 12, "0.0021", "1e-4"),
        ("ellipse 30 x 10", 30.0, 10.0, 50, "-", "-"),
        ("ellipse 30 x 10", 30.0, 10.0, 100, "4e-5", "1e-5"),
        ("ellipse 30 x 10", 30.0, 10.0, 1000, "-", "1e-11"),
    ):
        points, distance = ellipse_points(a, b, count), distance_from_ellipse(a, b)
        loop = np.vstack([points, points[:1]])
        speed = distance(interpolate(points, closed=True, handles="speed").evaluate(PROBES))
        curvature = distance(interpolate(points, closed=True).evaluate(PROBES))
        exact = distance(interpolate(points, closed=True, arc_tolerance_mm=1e-7).evaluate(PROBES))
        polygon = distance(Curve.from_polyline(points, closed=True).evaluate(PROBES))
        fitpack = distance(np.column_stack(splev(PROBES, splprep(loop.T, s=0.0, per=True)[0])))
        periodic = distance(CubicSpline(np.linspace(0.0, 1.0, len(loop)), loop, bc_type="periodic")(PROBES))
        errors = [f"{error:.1e}" for error in (curvature, exact, polygon, fitpack, periodic)]
        rows.append([name, count, f"{speed:.1e}", speed_limit, errors[0], limit, *errors[1:],
                     occ_error(points, distance), speed / curvature, fitpack / curvature])  # fmt: skip
    return Table(
        "Fit accuracy",
        ["contour", "points", "speed handles, mm", "limit, mm", "curvature handles, mm", "limit of these, mm",
         "with arcs within 1e-7, mm", "polygon, mm", "splprep, mm", "CubicSpline periodic, mm", "OCC Interpolate, mm",
         "speed / curvature", "splprep / curvature"],
        rows,
        "Largest distance from the true shape at 50,001 parameters.",
    )  # fmt: skip


def occ_error(points: Floats, distance: Callable[[Floats], float]) -> str:
    """Distance of OpenCascade's spline from the true shape, mm."""
    if not has_occ():
        return ABSENT
    curve = occ_spline(points)
    span = curve.FirstParameter() + (curve.LastParameter() - curve.FirstParameter()) * PROBES[::10]
    return f"{distance(np.array([[p.X(), p.Y()] for p in map(curve.Value, span.tolist())])):.1e}"


def families() -> Table:
    """Both handles over shapes, spacings and noise: how often curvature handles help, and the worst ratio."""
    rows: list[list[Cell]] = []
    for spacing in SPACINGS:
        for noise_mm in (0.0, 1e-5):
            rng = np.random.default_rng(5)
            found = [
                family_ratio(shape, spacing, count, noise_mm, rng) for shape in known_shapes() for count in (50, 200)
            ]
            ratios = np.array(found)
            rows.append([spacing, f"{noise_mm:g}", len(ratios), float(np.exp(np.log(ratios).mean())),
                         float(ratios.min()), float(ratios.max()), int((ratios > 1.0 + 1e-9).sum())])  # fmt: skip
    return Table(
        "Curvature handles over equal speed",
        ["spacing", "noise, mm", "curves", "mean ratio of errors", "best", "worst", "worse than speed"],
        rows,
        "Largest distance from the true curve with curvature handles over that with equal speed; geometric mean.",
    )


def family_ratio(shape: Shape, spacing: str, count: int, noise_mm: float, rng: np.random.Generator) -> float:
    """Error of curvature handles over that of equal speed on one shape."""
    nodes = shape.nodes(spacing, count, rng)
    points = shape.at(nodes)
    points = points + noise_mm * rng.normal(size=points.shape)
    table = contour_table([points], shape.closed, None, None, None)
    speed, curvature = (
        max(float(shape.distances(nodes, fit_table(table, matched, True)[0].control_points).max()), 1e-12)
        for matched in (False, True)
    )
    return curvature / speed


def gear_points(teeth: int) -> Floats:
    """Corners of a gear of straight flanks, (4 * teeth, 2) float, mm."""
    turn = 2.0 * np.pi * (np.arange(teeth)[:, None] + np.array([0.0, 0.2, 0.4, 0.8])) / teeth
    radius = np.array([20.0, 23.0, 23.0, 20.0])
    return np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=-1).reshape(-1, 2)


def corners() -> Table:
    """How far the curve stays from the corners and sides of polygons with points on their sides."""
    rows: list[list[Cell]] = []
    square = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    for name, tips in (
        ("cube", square),
        ("hexagon", ellipse_points(10.0, 10.0, 6)),
        ("gear of 24 teeth", gear_points(24)),
    ):
        share = np.arange(5)[:, None] / 5.0
        points = np.concatenate([p + share * (q - p) for p, q in zip(tips, np.roll(tips, -1, axis=0), strict=True)])
        for arcs in (None, 1e-6):
            curve = interpolate(points, closed=True, corners=np.arange(0, len(points), 5), arc_tolerance_mm=arcs)
            missed = float(closest_points(curve, tips)[1].max())
            rows.append([name, "-" if arcs is None else f"{arcs:g}", len(curve.control_points), f"{missed:.1e}",
                         f"{deviation(curve, tips):.1e}", "1e-6"])  # fmt: skip
    return Table(
        "Corners kept",
        ["section", "lines within, mm", "control points", "farthest corner, mm", "from the sides, both ways, mm",
         "limit, mm"],
        rows,
        "Five points per side, corners told as the mesh's creases tell them.",
    )  # fmt: skip


def deviation_times() -> Table:
    """Growth of measuring a curve against its polyline, both ways."""
    rows: list[list[Cell]] = []
    for count in (100, 1_000, 10_000):
        points = ellipse_points(30.0, 10.0, count)
        curve = interpolate(points, closed=True)
        took = cpu_seconds(lambda c=curve, p=points: deviation(c, p))  # type: ignore[misc]
        rows.append([count, 1e3 * took, 1e6 * took / count])
    return Table(
        "Deviation of a curve from its polyline", ["points", "ms", "µs per point"], rows, "True two-way maximum."
    )
