"""What holds for every spline, contour and region, on random ones."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from planner.nurbs.basis import basis_derivatives, basis_functions, find_spans
from planner.nurbs.construct import join
from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.nurbs.measure import deviation
from planner.nurbs.offset import inset, outset
from planner.nurbs.rings import curves_from_region

Floats = NDArray[np.float64]
RUNS = settings(max_examples=25, deadline=None)
U = np.linspace(0.0, 1.0, 201)


@st.composite
def splines(draw: st.DrawFn, rational: bool | None = None) -> Curve:
    """Random degree, multiplicities up to the degree, uneven knots, points and (perhaps) weights."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    degree = draw(st.integers(1, 5))
    inner = np.unique(rng.integers(1, 1000, draw(st.integers(0, 8)))) / 1000.0
    inner = np.repeat(inner, rng.integers(1, degree + 1, len(inner)))
    knots = np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])
    count = len(knots) - degree - 1
    points = rng.normal(size=(count, draw(st.integers(2, 3)))) * 10.0
    weighted = draw(st.booleans()) if rational is None else rational
    return Curve(degree, knots, points, rng.uniform(0.3, 3.0, count) if weighted else None)


@st.composite
def star_contours(draw: st.DrawFn, least: int = 3) -> Floats:
    """Points round the origin at random angles and distances: a simple closed contour."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count = draw(st.integers(least, 40))
    angle = (np.arange(count) + rng.uniform(0.0, 0.7, count)) * 2.0 * np.pi / count
    return rng.uniform(5.0, 20.0, count)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


@RUNS
@given(splines(rational=False))
def test_basis_functions_are_a_partition_of_unity_and_their_derivatives_sum_to_zero(curve: Curve) -> None:
    spans = find_spans(curve.degree, curve.knots, U)
    assert np.all(curve.knots[spans] < curve.knots[spans + 1])
    values = basis_functions(curve.degree, curve.knots, spans, U)
    assert values.min() >= 0.0
    np.testing.assert_allclose(values.sum(axis=1), 1.0, atol=1e-13)
    derivatives = basis_derivatives(curve.degree, curve.knots, spans, U, curve.degree + 1)
    np.testing.assert_allclose(derivatives[0], values)
    scale = np.abs(derivatives[1:]).max(axis=(1, 2), keepdims=True)
    assert np.all(np.abs(derivatives[1:].sum(axis=2)) <= 1e-11 * np.maximum(scale[..., 0], 1.0))


@RUNS
@given(splines(rational=False))
def test_values_and_derivatives_agree_with_scipy_and_with_the_basis(curve: Curve) -> None:
    inside = U[~np.isin(U, curve.knots)]
    peer = BSpline(curve.knots, curve.control_points, curve.degree)
    spans = find_spans(curve.degree, curve.knots, inside)
    basis = basis_derivatives(curve.degree, curve.knots, spans, inside, 3)
    rows = spans[:, None] - curve.degree + np.arange(curve.degree + 1)
    ours = curve.derivatives(inside, 3)
    for order in range(4):
        theirs = peer(inside, order) if order <= curve.degree else np.zeros_like(ours[order])
        allowed = 1e-9 * max(1.0, float(np.abs(theirs).max()))
        np.testing.assert_allclose(ours[order], theirs, atol=allowed)
        by_basis = np.einsum("kj,kjd->kd", basis[order], curve.control_points[rows])
        np.testing.assert_allclose(ours[order], by_basis, atol=allowed)


@RUNS
@given(splines())
def test_derivatives_agree_with_finite_differences(curve: Curve) -> None:
    step = 1e-5
    away = np.abs(U[:, None] - curve.breaks).min(axis=1) > 2 * step
    u = U[away]
    first, second = curve.derivatives(u, 2)[1:]
    before, here, after = (curve.evaluate(u + shift) for shift in (-step, 0.0, step))
    third = np.abs(curve.derivatives(u, 4)[3:]).max(axis=0)
    np.testing.assert_array_less(np.abs((after - before) / (2 * step) - first), 1e-4 + third * step)
    np.testing.assert_array_less(np.abs((after - 2 * here + before) / step**2 - second), 1e-2 + third * step)


@RUNS
@given(splines(), st.lists(st.floats(0.01, 0.99), min_size=1, max_size=4), st.integers(1, 2))
def test_inserting_knots_raising_the_degree_and_reversing_keep_the_curve(
    curve: Curve, values: list[float], more: int
) -> None:
    expected = curve.evaluate(U)
    new = [value for value in set(values) if np.abs(curve.knots - value).min() > 1e-3]
    np.testing.assert_allclose(curve.with_knots(new).evaluate(U), expected, atol=1e-9)
    raised = curve.with_degree(curve.degree + more)
    assert raised.degree == curve.degree + more
    np.testing.assert_allclose(raised.evaluate(U), expected, atol=1e-9)
    np.testing.assert_allclose(curve.reversed().evaluate(1.0 - U), expected, atol=1e-9)


@RUNS
@given(splines(), st.floats(0.05, 0.95))
def test_splitting_and_joining_are_inverse(curve: Curve, at: float) -> None:
    at = float(curve.knots[np.abs(curve.knots - at).argmin()]) if np.abs(curve.knots - at).min() < 1e-3 else at
    before, after = curve.split(at)
    assert before.domain == (0.0, at) and after.domain == (at, 1.0)
    left, right = U[at > U], U[at < U]
    np.testing.assert_allclose(before.evaluate(left), curve.evaluate(left), atol=1e-9)
    np.testing.assert_allclose(after.evaluate(right), curve.evaluate(right), atol=1e-9)
    np.testing.assert_allclose(join([before, after]).evaluate(U), curve.evaluate(U), atol=1e-9)
    assert before.length + after.length == pytest.approx(curve.length, rel=1e-6)


@RUNS
@given(splines(), st.integers(0, 2**32 - 1))
def test_moving_the_control_points_moves_the_curve(curve: Curve, seed: int) -> None:
    rng = np.random.default_rng(seed)
    size = curve.dimension
    matrix = np.eye(size + 1)
    matrix[:size] = rng.normal(size=(size, size + 1))
    expected = curve.evaluate(U) @ matrix[:size, :size].T + matrix[:size, size]
    np.testing.assert_allclose(curve.transformed(matrix).evaluate(U), expected, atol=1e-10)


@RUNS
@given(splines())
def test_curve_stays_in_its_bounding_box_and_touches_it(curve: Curve) -> None:
    low, high = curve.bounding_box()
    points = curve.evaluate(np.linspace(0.0, 1.0, 5001))
    assert np.all(points >= low - 1e-6) and np.all(points <= high + 1e-6)
    assert np.all(points.min(axis=0) - low <= 1e-2) and np.all(high - points.max(axis=0) <= 1e-2)


@RUNS
@given(star_contours(), st.integers(0, 2**32 - 1), st.sampled_from(["speed", "curvature"]))
def test_fitting_commutes_with_rigid_motion_and_scale(points: Floats, seed: int, handles: str) -> None:
    rng = np.random.default_rng(seed)
    angle, scale, shift = rng.uniform(0, 6), 10.0 ** rng.uniform(-2, 2), rng.uniform(-50, 50, 2)
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    corners = rng.random(len(points)) < 0.3
    here = interpolate(points, closed=True, corners=corners, handles=handles)  # type: ignore[arg-type]
    there = interpolate(points @ turn.T + shift, closed=True, corners=corners, handles=handles)  # type: ignore[arg-type]
    moved = here.evaluate(U) @ turn.T + shift
    np.testing.assert_allclose(there.evaluate(U), moved, atol=1e-6 * max(scale, 1.0))


@RUNS
@given(star_contours(), st.booleans())
def test_fitted_curve_goes_through_every_point_in_order(points: Floats, closed: bool) -> None:
    curve = interpolate(points, closed=closed)
    through = curve.evaluate(curve.breaks)
    np.testing.assert_allclose(through[: len(points)], points, atol=1e-10)
    assert curve.is_closed == closed


@settings(max_examples=20, deadline=None)
@given(star_contours(least=5), st.floats(0.05, 6.0))
def test_offset_of_any_simple_contour_lies_at_the_distance_and_on_the_right_side(points: Floats, away: float) -> None:
    region = shapely.Polygon(points)
    for move, sign in ((inset, -1.0), (outset, 1.0)):
        moved = move(region, away)
        assert moved.is_valid
        rim = shapely.points(shapely.get_coordinates(moved))
        assert np.all(np.abs(shapely.distance(region.boundary, rim) - away) <= 1e-3)
        probes = shapely.points(np.random.default_rng(1).uniform(-30, 30, (1500, 2)))
        signed = np.where(shapely.covers(region, probes), -1.0, 1.0) * shapely.distance(region.boundary, probes)
        decided = np.abs(signed - sign * away) > 2e-3
        np.testing.assert_array_equal(shapely.covers(moved, probes)[decided], (signed < sign * away)[decided])


@settings(max_examples=20, deadline=None)
@given(star_contours(least=5), st.floats(0.05, 6.0), st.sampled_from([1e-2, 2e-3, 1e-3]))
def test_curves_of_any_region_stay_within_the_tolerance_of_its_rings(
    points: Floats, away: float, tolerance_mm: float
) -> None:
    for region in (inset(shapely.Polygon(points), away), outset(shapely.Polygon(points), away)):
        outlines = [line for part in region.geoms for line in (part.exterior, *part.interiors)]
        rings = curves_from_region(region, tolerance_mm)
        assert [ring.is_hole for ring in rings] == [i > 0 for p in region.geoms for i in range(1 + len(p.interiors))]
        for ring, outline in zip(rings, outlines, strict=True):
            path = shapely.get_coordinates(outline)[:-1]
            assert deviation(ring.curve, path, closed=True) <= 1.1 * tolerance_mm
            middle = ring.curve.evaluate(ring.curve.sample(1e-3))
            sense = np.sum(middle[:-1, 0] * middle[1:, 1] - middle[1:, 0] * middle[:-1, 1])
            assert (sense < 0.0) == ring.is_hole
