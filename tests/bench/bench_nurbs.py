"""The NURBS kernel beside scipy, splipy, geomdl and OpenCascade, each on the same curve or surface in the same run."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from types import ModuleType

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.optimize import minimize_scalar

from planner.nurbs.batch import CurveSet
from planner.nurbs.closest import closest_points
from planner.nurbs.construct import circle
from planner.nurbs.curve import Curve
from planner.nurbs.quadrics import torus
from planner.nurbs.surface import Surface
from planner.nurbs.surface_closest import closest_on_surface
from tests.bench.table import Cell, Table

Floats = NDArray[np.float64]
Work = Callable[[], object]

SECONDS_PER_MEASUREMENT = 0.25
ABSENT = "not installed"
PER_POINT_PEERS = 40  # points given to peers that take one at a time in Python


def run() -> list[Table]:
    """The tables that `make bench` prints."""
    return [curve_rates(), surface_rates(), closest_rates(), length_times(), refinement_times(), batch_times()]


def peer(name: str) -> ModuleType | None:
    """The module, or None where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def best_seconds(*works: Work | None) -> list[float | None]:
    """Least CPU time of one call of each, taking turns, after one call each to warm up; None for what is absent."""
    best = [np.inf if work else None for work in works]
    spent = 0.0
    for turn in range(200):
        for index, work in enumerate(works):
            if work is None:
                continue
            started = time.process_time()
            work()
            took = time.process_time() - started
            spent += took
            if turn > 0:
                best[index] = min(best[index], max(took, 1e-7))  # type: ignore[type-var]
        if turn >= 1 and spent > SECONDS_PER_MEASUREMENT * len(works):
            break
    return best


def rate(count: int, seconds: float | None) -> Cell:
    """Million per second of CPU."""
    return ABSENT if seconds is None else count / seconds / 1e6


def ratio(theirs: float | None, ours: float | None) -> Cell:
    """How many times as long they take."""
    return ABSENT if theirs is None or ours is None else theirs / ours


def milliseconds(seconds: float | None) -> Cell:
    return ABSENT if seconds is None else 1e3 * seconds


def wavy_curve(pieces: int = 1000) -> Curve:
    """A cubic in space with double inner knots, as fitted contours have."""
    inner = np.repeat(np.arange(1, pieces) / pieces, 2)
    knots = np.concatenate([np.zeros(4), inner, np.ones(4)])
    at = 2.0 * np.pi * np.array([knots[i + 1 : i + 4].mean() for i in range(len(knots) - 4)])
    reach = 20.0 + 2.0 * np.cos(9.0 * at)
    return Curve(3, knots, np.column_stack([reach * np.cos(at), 0.5 * reach * np.sin(at), np.sin(3.0 * at)]))


def wavy_surface(spans: int = 20) -> Surface:
    """A bicubic sheet of spans x spans patches."""
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, spans + 1), np.ones(3)])
    at = np.array([knots[i + 1 : i + 4].mean() for i in range(spans + 3)])
    x, y = np.meshgrid(30.0 * at, 30.0 * at, indexing="ij")
    return Surface(3, 3, knots, knots, np.stack([x, y, 2.0 * np.sin(0.4 * x) * np.cos(0.3 * y)], axis=2))


def splipy_curve(curve: Curve) -> object | None:
    """The same curve in splipy."""
    splipy = peer("splipy")
    if splipy is None:
        return None
    basis = splipy.BSplineBasis(curve.degree + 1, curve.knots)
    return splipy.Curve(basis, curve.homogeneous, rational=curve.weights is not None)


def geomdl_curve(curve: Curve) -> object | None:
    """The same polynomial curve in geomdl."""
    bspline = peer("geomdl.BSpline")
    if bspline is None:
        return None
    made = bspline.Curve()
    made.degree, made.ctrlpts, made.knotvector = curve.degree, curve.control_points.tolist(), curve.knots.tolist()
    return made


def curve_rates() -> Table:
    curve, count = wavy_curve(), 100_000
    theirs = BSpline(curve.knots, curve.control_points, 3)
    splipy, geomdl = splipy_curve(curve), geomdl_curve(curve)
    ring = circle((0.0, 0.0, 0.0), 5.0)
    splipy_ring = splipy_curve(ring)
    rng = np.random.default_rng(0)
    even, mixed = np.linspace(0.0, 1.0, count), rng.random(count)
    few = mixed[:200].tolist()
    rows: list[list[Cell]] = []
    cases: list[tuple[str, Work, Work | None, Work | None]] = [
        ("points, sorted", lambda: curve.evaluate(even), lambda: theirs(even), splipy and (lambda: splipy(even))),  # type: ignore[operator]
        ("points, in no order", lambda: curve.evaluate(mixed), lambda: theirs(mixed), splipy and (lambda: splipy(mixed))),  # type: ignore[operator]
        ("points and derivatives 1, 2", lambda: curve.derivatives(even, 2),
         lambda: [theirs(even, order) for order in range(3)],
         splipy and (lambda: [splipy(even), splipy.derivative(even, 1), splipy.derivative(even, 2)])),  # type: ignore[attr-defined, operator]
        ("points of a circle (rational)", lambda: ring.evaluate(even), None, splipy_ring and (lambda: splipy_ring(even))),  # type: ignore[operator]
    ]  # fmt: skip
    for name, ours, scipys, splipys in cases:
        seconds = best_seconds(ours, scipys, splipys)
        scipy_cells: list[Cell] = [rate(count, seconds[1]), ratio(seconds[1], seconds[0])] if scipys else ["-", "-"]
        rows.append(
            [name, rate(count, seconds[0]), *scipy_cells, rate(count, seconds[2]), ratio(seconds[2], seconds[0])]
        )
    seconds = best_seconds(lambda: curve.evaluate(few), geomdl and (lambda: geomdl.evaluate_list(few)))  # type: ignore[attr-defined]
    note = (
        "geomdl not installed"
        if geomdl is None
        else f"200 points in geomdl take {seconds[1] / seconds[0]:.0f} times as long"
    )  # type: ignore[operator]
    return Table(
        "NURBS curve evaluation",
        ["what", "ours, million/s", "scipy BSpline, million/s", "ratio", "splipy, million/s", "ratio to splipy"],
        rows,
        f"A cubic in space of 1,000 pieces, {count:,} parameters, per second of CPU, best of turns; {note}.",
    )


def surface_rates() -> Table:
    splipy, geomdl_bspline = peer("splipy"), peer("geomdl.BSpline")
    rows: list[list[Cell]] = []
    u = np.linspace(0.0, 1.0, 400)
    for name, surface in (
        ("bicubic, 20 x 20 patches", wavy_surface()),
        ("torus (rational)", torus((0, 0, 0), (0, 0, 1), 9, 2)),
    ):
        rational = surface.weights is not None
        theirs, slow = None, None
        if splipy is not None:
            bases = [
                splipy.BSplineBasis(degree + 1, knots)
                for degree, knots in ((surface.degree_u, surface.knots_u), (surface.degree_v, surface.knots_v))
            ]
            net = surface.homogeneous.transpose(1, 0, 2).reshape(-1, surface.homogeneous.shape[2])
            theirs = splipy.Surface(*bases, net, rational=rational)
        if geomdl_bspline is not None and not rational:
            slow = geomdl_bspline.Surface()
            slow.degree_u, slow.degree_v = surface.degree_u, surface.degree_v
            slow.set_ctrlpts(surface.control_points.reshape(-1, 3).tolist(), *surface.control_points.shape[:2])
            slow.knotvector_u, slow.knotvector_v = surface.knots_u.tolist(), surface.knots_v.tolist()
            slow.sample_size = 20
        seconds = best_seconds(
            lambda s=surface: s.evaluate_grid(u, u),  # type: ignore[misc]
            theirs and (lambda t=theirs: t(u, u)),  # type: ignore[misc]
            slow and (lambda g=slow: g.evaluate()),  # type: ignore[misc]
            lambda s=surface: s.derivatives(np.repeat(u, 400), np.tile(u, 400), 1),  # type: ignore[misc]
        )
        many = len(u) ** 2
        geomdl_cell: Cell = "-" if rational else ABSENT if slow is None else rate(400, seconds[2])
        rows.append(
            [
                name,
                rate(many, seconds[0]),
                rate(many, seconds[1]),
                ratio(seconds[1], seconds[0]),
                geomdl_cell,
                rate(many, seconds[3]),
            ]
        )
    return Table(
        "NURBS surface evaluation",
        ["surface", "grid, ours, million/s", "grid, splipy, million/s", "ratio", "grid 20 x 20, geomdl, million/s",
         "pairs with first derivatives, ours, million/s"],
        rows,
        "A grid of 400 x 400 parameters, points per second of CPU, best of turns.",
    )  # fmt: skip


def closest_rates() -> Table:
    rows: list[list[Cell]] = []
    curve, sheet, rng = wavy_curve(200), wavy_surface(), np.random.default_rng(1)
    clouds = {
        "near": curve.evaluate(rng.random(5000)) + rng.normal(size=(5000, 3)) * 0.05,
        "far": rng.normal(size=(5000, 3)) * 15,
    }
    for name, points in clouds.items():
        few = points[:PER_POINT_PEERS]
        seconds = best_seconds(lambda p=points: closest_points(curve, p), lambda p=few: brute_closest(curve, p))  # type: ignore[misc]
        ours = seconds[0] / len(points) if seconds[0] else None
        brute = seconds[1] / len(few) if seconds[1] else None
        found, brutes = closest_points(curve, few)[1], brute_closest(curve, few)
        occ, occ_found = occ_curve(curve, few)
        worse = max(
            float((found - brutes).max()), float((found - occ_found).max()) if occ_found is not None else -np.inf
        )
        rows.append(
            [
                f"curve of 200 pieces, {name}",
                1e6 * (ours or 0.0),
                ratio(brute, ours),
                ratio(occ, ours),
                f"{max(worse, 0.0):.1e}",
            ]
        )
    clouds = {
        "near": sheet.evaluate(*rng.random((2, 2000))) + rng.normal(size=(2000, 3)) * 0.05,
        "far": rng.normal(size=(2000, 3)) * 20,
    }
    for name, points in clouds.items():
        few = points[:PER_POINT_PEERS]
        ours = (best_seconds(lambda p=points: closest_on_surface(sheet, p))[0] or 0.0) / len(points)  # type: ignore[misc]
        occ, occ_found = occ_surface(sheet, few)
        excess = (
            "-"
            if occ_found is None
            else f"{max(float((closest_on_surface(sheet, few)[2] - occ_found).max()), 0.0):.1e}"
        )
        rows.append([f"sheet of 400 patches, {name}", 1e6 * ours, "-", ratio(occ, ours), excess])
    return Table(
        "NURBS closest point",
        ["what", "ours, µs per point", "scipy sampling + minimize_scalar, times ours", "OpenCascade projection, times ours",
         "our distance above the best of them, mm"],
        rows,
        f"CPU time per point; peers on {PER_POINT_PEERS} of the same points.",
    )  # fmt: skip


def brute_closest(curve: Curve, points: Floats) -> Floats:
    """Distances by 2,000 samples and scipy's bounded minimizer round the best of them."""
    u = np.linspace(0.0, 1.0, 2001)
    samples = curve.evaluate(u)
    found = []
    for point in points:
        at = int(np.argmin(((samples - point) ** 2).sum(axis=1)))
        bounds = (u[max(at - 1, 0)], u[min(at + 1, 2000)])
        best = minimize_scalar(
            lambda t, p=point: ((curve.evaluate(t)[0] - p) ** 2).sum(),
            bounds=bounds,
            method="bounded",
            options={"xatol": 1e-10},
        )
        found.append(np.sqrt(best.fun))
    return np.array(found)


def _occ_knots(knots: Floats) -> tuple[object, object]:
    """Distinct knots and multiplicities as OpenCascade's arrays."""
    arrays = importlib.import_module("OCP.collections")
    distinct, counts = np.unique(knots, return_counts=True)
    values, repeats = arrays.Array1_double(1, len(distinct)), arrays.Array1_int(1, len(distinct))
    for index, (value, count) in enumerate(zip(distinct.tolist(), counts.tolist(), strict=True), start=1):
        values.SetValue(index, value)
        repeats.SetValue(index, count)
    return values, repeats


def occ_curve(curve: Curve, points: Floats) -> tuple[float | None, Floats | None]:
    """OpenCascade's CPU seconds per projected point and the distances; None where it is not installed."""
    if peer("OCP") is None:
        return None, None
    gp, geom, api, arrays = (
        importlib.import_module(f"OCP.{name}") for name in ("gp", "Geom", "GeomAPI", "collections")
    )
    poles = arrays.Array1_gp_Pnt(1, len(curve.control_points))
    for index, point in enumerate(curve.control_points.tolist(), start=1):
        poles.SetValue(index, gp.gp_Pnt(*point))
    made = geom.Geom_BSplineCurve(poles, *_occ_knots(curve.knots), curve.degree)

    def work() -> list[float]:
        found = []
        for point in points.tolist():
            target = gp.gp_Pnt(*point)
            ends = [made.Value(0.0).Distance(target), made.Value(1.0).Distance(target)]
            projection = api.GeomAPI_ProjectPointOnCurve(target, made)
            found.append(min([projection.LowerDistance(), *ends] if projection.NbPoints() else ends))
        return found

    seconds = best_seconds(work)[0]
    return (seconds or 0.0) / len(points), np.array(work())


def occ_surface(surface: Surface, points: Floats) -> tuple[float | None, Floats | None]:
    """As occ_curve, for a polynomial surface; distances are infinite where no foot was found inside the domain."""
    if peer("OCP") is None:
        return None, None
    gp, geom, api, arrays = (
        importlib.import_module(f"OCP.{name}") for name in ("gp", "Geom", "GeomAPI", "collections")
    )
    n, m = surface.control_points.shape[:2]
    poles = arrays.Array2_gp_Pnt(1, n, 1, m)
    for i in range(n):
        for j in range(m):
            poles.SetValue(i + 1, j + 1, gp.gp_Pnt(*surface.control_points[i, j].tolist()))
    u, times_u = _occ_knots(surface.knots_u)
    v, times_v = _occ_knots(surface.knots_v)
    made = geom.Geom_BSplineSurface(poles, u, v, times_u, times_v, surface.degree_u, surface.degree_v)

    def work() -> list[float]:
        found = []
        for point in points.tolist():
            projection = api.GeomAPI_ProjectPointOnSurf(gp.gp_Pnt(*point), made)
            found.append(projection.LowerDistance() if projection.NbPoints() else np.inf)
        return found

    seconds = best_seconds(work)[0]
    return (seconds or 0.0) / len(points), np.array(work())


def length_times() -> Table:
    curve = wavy_curve()
    splipy, u = splipy_curve(curve), np.linspace(0.0, 1.0, 1001)

    def fresh() -> Curve:
        return Curve.trusted(curve.degree, curve.knots, curve.control_points)

    whole = best_seconds(lambda: fresh().length, splipy and (lambda: splipy.length()))  # type: ignore[attr-defined]
    lengths = np.linspace(0.0, curve.length, 1001)
    many = best_seconds(lambda: curve.arc_length(u), lambda: curve.at_arc_length(lengths))
    dense = np.linspace(0.0, 1.0, 1_000_001)
    truth = float(np.linalg.norm(np.diff(curve.evaluate(dense), axis=0), axis=1).sum())
    off, back = abs(curve.length / truth - 1.0), np.abs(curve.arc_length(curve.at_arc_length(lengths)) - lengths).max()
    rows: list[list[Cell]] = [
        ["length of the whole curve", *map(milliseconds, whole), ratio(whole[1], whole[0]), f"{off:.1e}"],
        ["length up to 1,001 parameters", milliseconds(many[0]), "-", "-", "-"],
        ["parameter at 1,001 lengths", milliseconds(many[1]), "-", "-", f"{back:.1e}"],
    ]
    return Table(
        "NURBS arc length",
        ["what", "ours, ms", "splipy, ms", "ratio", "error"],
        rows,
        "A cubic of 1,000 pieces. Error: of the whole, relative to a polyline of 1,000,001 points; of the inverse, mm, gone back.",
    )


def refinement_times() -> Table:
    curve = wavy_curve(100)
    new = (np.arange(100) + 0.37) / 100
    splipy, geomdl = splipy_curve(curve), geomdl_curve(curve)
    operations = peer("geomdl.operations")

    def by_geomdl() -> object:
        made = geomdl_curve(curve)
        for value in new[:10].tolist():
            operations.insert_knot(made, [value], [1])  # type: ignore[union-attr]
        return made

    inserted = best_seconds(
        lambda: curve.with_knots(new),
        splipy and (lambda: splipy.clone().insert_knot(new)),  # type: ignore[attr-defined]
        by_geomdl if geomdl is not None and operations is not None else None,
    )
    raised = best_seconds(lambda: curve.with_degree(5), splipy and (lambda: splipy.clone().raise_order(2)))  # type: ignore[attr-defined]
    finer = curve.with_knots(new)
    removed = best_seconds(lambda: finer.without_knots(1e-9))
    geomdl_seconds = None if inserted[2] is None else 10.0 * inserted[2]
    dense = wavy_curve()
    less, bound = dense.without_knots(1e-3)
    insertion = [milliseconds(inserted[0]), milliseconds(inserted[1]), ratio(inserted[1], inserted[0])]
    rows: list[list[Cell]] = [
        ["insert 100 knots", *insertion, milliseconds(geomdl_seconds), ratio(geomdl_seconds, inserted[0])],
        ["raise the degree by 2", *map(milliseconds, raised), ratio(raised[1], raised[0]), "-", "-"],
        ["remove these 100 knots", milliseconds(removed[0]), "-", "-", "-", "-"],
    ]
    return Table(
        "NURBS refinement",
        ["what", "ours, ms", "splipy, ms", "ratio", "geomdl, ms", "ratio to geomdl"],
        rows,
        f"A cubic of 100 pieces; geomdl inserts 10, times 10. Of 1,000 pieces {len(dense.knots)} knots become, within 1e-3 mm, "
        f"{len(less.knots)}, moved by {bound:.1e} mm at most.",
    )


def batch_times() -> Table:
    rng = np.random.default_rng(3)
    base = wavy_curve(20)
    curves = [Curve(3, base.knots, base.control_points * rng.uniform(0.5, 2.0)) for _ in range(1000)]
    u, points = np.linspace(0.0, 1.0, 20), rng.normal(size=(20, 3)) * 15.0

    def fresh() -> list[Curve]:
        return [Curve.trusted(3, curve.knots, curve.control_points) for curve in curves]

    rows: list[list[Cell]] = []
    cases: list[tuple[str, Work, Work]] = [
        ("20 points each", lambda: CurveSet(curves).evaluate(u), lambda: [curve.evaluate(u) for curve in curves]),
        ("length", lambda: CurveSet(curves).lengths, lambda: [curve.length for curve in fresh()]),
        ("box", lambda: CurveSet(curves).bounding_boxes(), lambda: [curve.bounding_box() for curve in fresh()]),
        ("sampling within 1e-3 mm", lambda: CurveSet(curves).sample(1e-3), lambda: [curve.sample(1e-3) for curve in fresh()]),
        ("20 closest points each", lambda: CurveSet(curves).closest_points(points), lambda: [closest_points(curve, points) for curve in fresh()]),
    ]  # fmt: skip
    for name, together, apart in cases:
        seconds = best_seconds(together, apart)
        rows.append([name, milliseconds(seconds[0]), milliseconds(seconds[1]), ratio(seconds[1], seconds[0])])
    return Table(
        "NURBS batches",
        ["what", "1,000 curves in one call, ms", "one by one, ms", "ratio"],
        rows,
        "Cubics of 20 pieces, nothing kept from call to call.",
    )
