"""What holds for every curve and every surface of the kernel, on random ones."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import NdBSpline
from scipy.spatial import cKDTree

from planner.nurbs.batch import CurveSet
from planner.nurbs.closest import closest_points
from planner.nurbs.construct import join
from planner.nurbs.curve import Curve
from planner.nurbs.surface import Surface
from planner.nurbs.surface_closest import closest_on_surface

Floats = NDArray[np.float64]
RUNS = settings(max_examples=20, deadline=None)
U = np.linspace(0.0, 1.0, 101)
SIZE = 30.0  # mm, about what the random shapes measure


def random_knots(rng: np.random.Generator, degree: int, most: int) -> Floats:
    inner = np.unique(rng.integers(1, 100, rng.integers(0, most + 1))) / 100.0
    inner = np.repeat(inner, rng.integers(1, degree + 1, len(inner)))
    return np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])


def random_curve(rng: np.random.Generator, dimension: int = 3, rational: bool | None = None) -> Curve:
    degree = int(rng.integers(1, 6))
    knots = random_knots(rng, degree, 8)
    count = len(knots) - degree - 1
    weighted = rng.random() < 0.5 if rational is None else rational
    points = rng.normal(size=(count, dimension)) * 10.0
    return Curve(degree, knots, points, rng.uniform(0.3, 3.0, count) if weighted else None)


def random_surface(rng: np.random.Generator, rational: bool | None = None) -> Surface:
    degrees = rng.integers(1, 4, 2)
    knots = [random_knots(rng, int(degree), 4) for degree in degrees]
    n, m = (len(own) - degree - 1 for own, degree in zip(knots, degrees, strict=True))
    flat = np.stack(np.meshgrid(np.linspace(0, SIZE, n), np.linspace(0, SIZE, m), indexing="ij"), axis=-1)
    points = np.concatenate([flat, np.zeros((n, m, 1))], axis=2) + rng.normal(size=(n, m, 3)) * 3.0
    weighted = rng.random() < 0.5 if rational is None else rational
    weights = rng.uniform(0.4, 2.5, (n, m)) if weighted else None
    return Surface(int(degrees[0]), int(degrees[1]), knots[0], knots[1], points, weights)


generators = st.integers(0, 2**32 - 1).map(np.random.default_rng)


@RUNS
@given(generators)
def test_knots_that_were_inserted_are_all_removed_again(rng: np.random.Generator) -> None:
    curve = random_curve(rng)
    added = rng.choice(np.arange(1, 1000), 4, replace=False) / 1000.0 + 3e-4
    again, moved = curve.with_knots(added).without_knots(1e-8)
    if not len(again.knots) < len(curve.knots):
        np.testing.assert_array_equal(again.knots, curve.knots)
        np.testing.assert_allclose(again.control_points, curve.control_points, atol=1e-7)
    assert moved <= 1e-8
    np.testing.assert_allclose(again.evaluate(U), curve.evaluate(U), atol=1e-8)


@RUNS
@given(generators, st.floats(0.01, 20.0))
def test_removing_knots_moves_the_curve_less_than_the_bound_and_the_bound_keeps_the_tolerance(
    rng: np.random.Generator, tolerance_mm: float
) -> None:
    curve = random_curve(rng)
    less, bound = curve.without_knots(tolerance_mm)
    fine = np.linspace(0.0, 1.0, 2001)
    moved = np.linalg.norm(less.evaluate(fine) - curve.evaluate(fine), axis=1).max()
    assert moved <= bound + 1e-9 and bound <= tolerance_mm


@RUNS
@given(generators, st.lists(st.integers(1, 99), min_size=1, max_size=3, unique=True))
def test_joining_the_parts_of_a_split_curve_gives_the_curve_that_was_split(
    rng: np.random.Generator, at: list[int]
) -> None:
    curve = random_curve(rng)
    cuts = np.array(at) / 100.0
    parts = curve.split(cuts)
    assert [part.domain[0] for part in parts] == [0.0, *sorted(cuts)]
    again = join(parts, smooth_within_mm=1e-9)
    np.testing.assert_allclose(again.evaluate(U), curve.evaluate(U), atol=1e-9)
    if curve.without_knots(1e-9)[0].knots.size == curve.knots.size:
        np.testing.assert_array_equal(again.knots, curve.knots)
        np.testing.assert_allclose(again.homogeneous, curve.homogeneous, atol=1e-8)


@RUNS
@given(generators)
def test_no_sample_of_the_curve_is_nearer_than_its_closest_point(rng: np.random.Generator) -> None:
    curve = random_curve(rng, dimension=int(rng.integers(2, 4)))
    points = rng.normal(size=(60, curve.dimension)) * 12.0
    u, distance = closest_points(curve, points)
    np.testing.assert_allclose(np.linalg.norm(curve.evaluate(u) - points, axis=1), distance, atol=1e-10)
    samples = curve.evaluate(np.linspace(0.0, 1.0, 5001))
    assert np.all(distance <= cKDTree(samples).query(points)[0] + 1e-10)
    on_curve = closest_points(curve, curve.evaluate(U))[1]
    assert on_curve.max() <= 1e-10


@RUNS
@given(generators)
def test_true_box_holds_the_curve_and_is_reached(rng: np.random.Generator) -> None:
    curve = random_curve(rng)
    low, high = curve.bounding_box()
    points = curve.evaluate(np.linspace(0.0, 1.0, 20001))
    assert np.all(points >= low - 1e-11) and np.all(points <= high + 1e-11)
    assert np.all(points.min(axis=0) - low <= 1e-3) and np.all(high - points.max(axis=0) <= 1e-3)


@RUNS
@given(generators, st.integers(1, 12), st.booleans())
def test_many_curves_in_one_call_are_as_each_by_itself(rng: np.random.Generator, count: int, mixed: bool) -> None:
    curves = [random_curve(rng, rational=bool(index % 2) and mixed) for index in range(count)]
    u = [np.sort(rng.random(int(rng.integers(1, 9)))) for _ in curves]
    points = rng.normal(size=(7, 3)) * 15.0
    together = CurveSet(curves)
    boxes, lengths = together.bounding_boxes(), together.lengths
    nearest = together.closest_points(points)
    for index, curve in enumerate(curves):
        np.testing.assert_allclose(together.evaluate(u)[index], curve.evaluate(u[index]), atol=1e-12)
        np.testing.assert_allclose(together.derivatives(u, 2)[index], curve.derivatives(u[index], 2), rtol=1e-9)
        np.testing.assert_allclose(together.arc_length(u)[index], curve.arc_length(u[index]), atol=1e-8)
        s = np.linspace(0.0, curve.length, 5)
        np.testing.assert_allclose(together.at_arc_length(s)[index], curve.at_arc_length(s), atol=1e-8)
        np.testing.assert_allclose([boxes[0][index], boxes[1][index]], curve.bounding_box(), atol=1e-11)
        assert lengths[index] == pytest.approx(curve.length, rel=1e-9)
        np.testing.assert_allclose(nearest[1][index], closest_points(curve, points)[1], atol=1e-10)


@RUNS
@given(generators)
def test_surface_values_and_derivatives_agree_with_scipy(rng: np.random.Generator) -> None:
    surface = random_surface(rng, rational=False)
    peer = NdBSpline((surface.knots_u, surface.knots_v), surface.control_points, (surface.degree_u, surface.degree_v))
    u, v = rng.random(50), rng.random(50)
    ours = surface.derivatives(u, v, 2)
    for a, b in ((0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2)):
        theirs = np.zeros_like(ours[a, b])
        if a <= surface.degree_u and b <= surface.degree_v:
            theirs = peer(np.column_stack([u, v]), nu=(a, b))
        np.testing.assert_allclose(ours[a, b], theirs, atol=1e-10 * max(1.0, float(np.abs(theirs).max())))


@RUNS
@given(generators)
def test_rational_surface_derivatives_agree_with_finite_differences(rng: np.random.Generator) -> None:
    surface, step = random_surface(rng, rational=True), 1e-5
    u, v = rng.uniform(0.01, 0.99, (2, 60))
    clear = np.abs(u[:, None] - surface.knots_u).min(axis=1) > 2 * step
    clear &= np.abs(v[:, None] - surface.knots_v).min(axis=1) > 2 * step
    u, v = u[clear], v[clear]
    exact = surface.derivatives(u, v, 4)
    for (a, b), (du, dv) in (((1, 0), (step, 0.0)), ((0, 1), (0.0, step))):
        lower, upper = (surface.derivatives(u + s * du, v + s * dv, 1) for s in (-1, 1))
        for c, d in ((0, 0), (1, 0), (0, 1)):
            difference = (upper[c, d] - lower[c, d]) / (2 * step)
            third = np.abs(exact[c + 3 * a, d + 3 * b]).max(initial=0.0)
            scale = max(1.0, float(np.abs(lower[c, d]).max(initial=0.0)))
            np.testing.assert_allclose(difference, exact[c + a, d + b], atol=1e-9 * scale / step + third * step**2)


@RUNS
@given(generators)
def test_surface_keeps_its_shape_through_knots_degrees_turns_and_cuts(rng: np.random.Generator) -> None:
    surface = random_surface(rng)
    grid = surface.evaluate_grid(U, U)
    u, v = rng.random(40), rng.random(40)
    here = surface.evaluate(u, v)
    np.testing.assert_allclose(
        grid, surface.evaluate(np.repeat(U, 101), np.tile(U, 101)).reshape(grid.shape), atol=1e-11
    )
    finer = surface.with_knots("u", [0.1234, 0.5678]).with_knots("v", [0.4321])
    again, moved = finer.without_knots(1e-8)
    assert len(again.knots_u) <= len(surface.knots_u) and len(again.knots_v) <= len(surface.knots_v) and moved <= 1e-8
    for other in (finer, again, surface.with_degree("u", surface.degree_u + 2), surface.with_degree("v", 4)):
        np.testing.assert_allclose(other.evaluate(u, v), here, atol=1e-8)
    np.testing.assert_allclose(surface.reversed("u").evaluate(1.0 - u, v), here, atol=1e-11)
    np.testing.assert_allclose(surface.reversed("v").evaluate(u, 1.0 - v), here, atol=1e-11)
    np.testing.assert_allclose(surface.transposed().evaluate(v, u), here, atol=1e-11)
    np.testing.assert_allclose(surface.isocurve("u", 0.37).evaluate(U), surface.evaluate(0.37, U), atol=1e-11)
    np.testing.assert_allclose(surface.isocurve("v", 0.37).evaluate(U), surface.evaluate(U, 0.37), atol=1e-11)
    for axis, at in (("u", u), ("v", v)):
        for part, low, high in zip(surface.split(axis, [0.3, 0.7]), (0.0, 0.3, 0.7), (0.3, 0.7, 1.0), strict=True):  # type: ignore[arg-type]
            inside = (at >= low) & (at < high)
            np.testing.assert_allclose(part.evaluate(u[inside], v[inside]), here[inside], atol=1e-10)


@RUNS
@given(generators)
def test_moving_the_net_moves_the_surface(rng: np.random.Generator) -> None:
    surface, matrix = random_surface(rng), np.eye(4)
    matrix[:3] = rng.normal(size=(3, 4))
    u, v = rng.random(40), rng.random(40)
    expected = surface.evaluate(u, v) @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(surface.transformed(matrix).evaluate(u, v), expected, atol=1e-10)


@RUNS
@given(generators)
def test_no_sample_of_the_surface_is_nearer_than_its_closest_point_nor_outside_its_box(
    rng: np.random.Generator,
) -> None:
    surface = random_surface(rng)
    points = rng.normal(size=(40, 3)) * 15.0 + [15.0, 15.0, 0.0]
    u, v, distance = closest_on_surface(surface, points)
    np.testing.assert_allclose(np.linalg.norm(surface.evaluate(u, v) - points, axis=1), distance, atol=1e-10)
    own = [np.union1d(np.linspace(0.0, 1.0, 151), knots) for knots in (surface.knots_u, surface.knots_v)]
    samples = surface.evaluate_grid(*own).reshape(-1, 3)
    assert np.all(distance <= cKDTree(samples).query(points)[0] + 1e-9)
    low, high = surface.bounding_box()
    assert np.all(samples >= low - 1e-11) and np.all(samples <= high + 1e-11)
    assert np.all(samples.min(axis=0) - low <= 0.3) and np.all(high - samples.max(axis=0) <= 0.3)
