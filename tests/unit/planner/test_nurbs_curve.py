"""The curve itself: exact conics, arc length, sampling, bounding boxes, measuring."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipe

from planner.errors import FitError
from planner.nurbs.construct import arc, circle, join, line
from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.nurbs.measure import closest_points, deviation, deviation_from_polyline, distances_to_polyline


def ellipse(count: int = 1000) -> Curve:
    t = 2.0 * np.pi * np.arange(count) / count
    return interpolate(np.column_stack([30 * np.cos(t), 10 * np.sin(t)]), closed=True)


def test_rational_circle_is_a_circle_to_rounding_in_place_speed_and_curvature() -> None:
    curve = circle((3.0, -2.0, 1.0), 7.0)
    u = np.linspace(0.0, 1.0, 5001)
    point, first, second = curve.derivatives(u, 2)
    arm = point - [3.0, -2.0, 1.0]
    np.testing.assert_allclose(np.linalg.norm(arm, axis=1), 7.0, rtol=1e-14)
    np.testing.assert_allclose(np.einsum("ij,ij->i", arm, first), 0.0, atol=1e-11)
    np.testing.assert_allclose(curve.curvature(u), 1.0 / 7.0, rtol=1e-10)
    np.testing.assert_allclose(np.einsum("ij,ij->i", arm, second), -np.einsum("ij,ij->i", first, first), rtol=1e-9)
    assert curve.length == pytest.approx(14.0 * np.pi, rel=1e-12) and curve.is_closed


def test_arc_starts_ends_and_sweeps_as_asked() -> None:
    curve = arc((1.0, 1.0), (1.0, 0.0), (0.0, 1.0), 2.0, 0.5, 2.5)
    ends = curve.evaluate([0.0, 1.0])
    np.testing.assert_allclose(ends, [[1 + 2 * np.cos(a), 1 + 2 * np.sin(a)] for a in (0.5, 3.0)], atol=1e-14)
    assert curve.length == pytest.approx(5.0, rel=1e-12)
    with pytest.raises(ValueError, match="sweeps"):
        arc((0, 0), (1, 0), (0, 1), 2.0, 0.0, 7.0)


def test_length_of_the_ellipse_is_the_elliptic_integral() -> None:
    assert ellipse().length == pytest.approx(4 * 30 * ellipe(1 - 1 / 9), rel=1e-9)


def test_arc_length_and_its_inverse_undo_each_other() -> None:
    for curve in (ellipse(50), circle((0.0, 0.0), 5.0), Curve.from_polyline([[0, 0], [1, 0], [1, 5]])):
        u = np.linspace(0.0, 1.0, 777)
        np.testing.assert_allclose(curve.at_arc_length(curve.arc_length(u)), u, atol=1e-10)
    even = np.linspace(0.0, curve.length, 13)
    np.testing.assert_allclose(curve.arc_length(curve.at_arc_length(even)), even, atol=1e-12)


def test_arc_length_inverse_survives_a_point_of_no_speed() -> None:
    cusp = Curve(3, np.array([0, 0, 0, 0, 1, 1, 1, 1.0]), np.array([[0, 0], [1, 1], [0, 1], [1, 0.0]]))
    lengths = np.linspace(0.0, cusp.length, 101)
    np.testing.assert_allclose(cusp.arc_length(cusp.at_arc_length(lengths)), lengths, atol=1e-9)


@pytest.mark.parametrize("tolerance_mm", [1e-1, 1e-3, 1e-5])
@pytest.mark.parametrize("which", ["ellipse", "circle"])
def test_chords_of_a_sample_stay_within_the_tolerance(tolerance_mm: float, which: str) -> None:
    curve = ellipse(20) if which == "ellipse" else circle((0.0, 0.0), 12.0)
    u = curve.sample(tolerance_mm)
    assert u[0] == 0.0 and u[-1] == 1.0 and np.all(np.diff(u) > 0.0)
    chords = curve.evaluate(u)
    between = np.linspace(u[:-1], u[1:], 11).T.ravel()
    assert distances_to_polyline(curve.evaluate(between), chords, closed=False).max() <= tolerance_mm
    assert len(u) < 60 + 3 * curve.length / np.sqrt(8 * tolerance_mm * 3.0)


def test_bounding_box_is_that_of_the_curve_not_of_its_control_points() -> None:
    low, high = ellipse(101).bounding_box()
    np.testing.assert_allclose([low, high], [[-30, -10], [30, 10]], atol=1e-4)
    bulge = Curve(2, np.array([0, 0, 0, 1, 1, 1.0]), np.array([[0, 0], [1, 2], [2, 0.0]]))
    np.testing.assert_allclose(bulge.bounding_box()[1], [2.0, 1.0], atol=1e-12)


def test_transforming_a_planar_curve_lifts_it_into_space() -> None:
    turn = np.array([[1, 0, 0, 5], [0, 0, -1, 6], [0, 1, 0, 7], [0, 0, 0, 1.0]])
    flat = circle((1.0, 2.0), 3.0)
    u = np.linspace(0, 1, 50)
    x, y = flat.evaluate(u).T
    np.testing.assert_allclose(
        flat.transformed(turn).evaluate(u), np.column_stack([x + 5, np.full(50, 6.0), y + 7]), atol=1e-12
    )


def test_parameters_outside_the_domain_are_refused() -> None:
    with pytest.raises(ValueError, match="leaves the domain"):
        line((0, 0), (1, 1)).evaluate([0.5, 1.5])
    with pytest.raises(ValueError, match="no curve"):
        Curve(3, np.arange(5.0), np.zeros((2, 2)))
    with pytest.raises(ValueError, match="clamped"):
        Curve(1, np.array([0.0, 1, 2, 3]), np.zeros((2, 2)))


def test_joined_lines_and_arcs_run_through_all_of_them() -> None:
    first = line((0.0, 0.0), (10.0, 0.0))
    bend = arc((10.0, 5.0), (1.0, 0.0), (0.0, 1.0), 5.0, -0.5 * np.pi, np.pi)
    back = line((10.0, 10.0), (0.0, 10.0))
    path = join([first, bend, back])
    assert path.length == pytest.approx(20 + 5 * np.pi, rel=1e-12)
    p = path.evaluate(np.linspace(*path.domain, 4001))
    assert distances_to_polyline(p[p[:, 0] < 10], [[10, 0], [0, 0], [0, 10], [10, 10]], closed=False).max() <= 1e-12
    assert np.abs(np.linalg.norm(p[p[:, 0] > 10] - [10, 5], axis=1) - 5).max() <= 1e-12
    with pytest.raises(FitError, match="starts 10 mm from the end"):
        join([first, back])


def test_closest_point_of_a_circle_is_along_the_radius() -> None:
    rng = np.random.default_rng(2)
    angle, reach = rng.uniform(0, 2 * np.pi, 500), rng.uniform(0.5, 20.0, 500)
    points = np.column_stack([np.cos(angle), np.sin(angle)]) * reach[:, None]
    u, distance = closest_points(circle((0.0, 0.0), 7.0), points)
    np.testing.assert_allclose(distance, np.abs(reach - 7.0), atol=1e-10)
    np.testing.assert_allclose(circle((0.0, 0.0), 7.0).evaluate(u) * reach[:, None] / 7.0, points, atol=1e-6)


def test_closest_point_on_a_long_side_is_found_beside_short_ones() -> None:
    corners = np.array([[0.0, 28], [60, 28], [60, 16], [0, 16]])
    plate = interpolate(corners, closed=True, corners=[0, 1, 2, 3])
    along = np.column_stack([np.linspace(0.0, 60.0, 301), np.full(301, 28.0)])
    assert closest_points(plate, along)[1].max() <= 1e-12
    assert deviation(plate, corners) <= 1e-12


def test_deviation_counts_both_ways() -> None:
    square = np.array([[0, 0], [10, 0], [10, 10], [0, 10.0]])
    exact = Curve.from_polyline(square, closed=True)
    assert deviation(exact, square) <= 1e-12
    whisker = np.array([[0, 0], [10, 0], [10, 10], [5, 10], [5, 13], [5, 10], [0, 10.0]])
    both = deviation_from_polyline(exact, whisker)
    assert both.curve_to_data <= 1e-12 and both.data_to_curve == pytest.approx(3.0) == both.largest
    ring = circle((0.0, 0.0), 10.0)
    t = 2 * np.pi * np.arange(12) / 12
    assert deviation(ring, 10 * np.column_stack([np.cos(t), np.sin(t)])) == pytest.approx(
        10 * (1 - np.cos(np.pi / 12)), rel=1e-6
    )


def test_distance_to_a_polyline_with_sides_of_very_different_length_is_exact() -> None:
    rng = np.random.default_rng(4)
    path = np.vstack([rng.uniform(-1, 1, (50, 3)) * 0.01, rng.uniform(-1, 1, (5, 3)) * 500])
    points = rng.uniform(-1, 1, (300, 3)) * 400
    low, high = path, np.roll(path, -1, axis=0)
    chord = high - low
    share = np.clip(((points[:, None] - low) * chord).sum(2) / (chord**2).sum(1), 0, 1)
    brute = np.linalg.norm(points[:, None] - low - share[..., None] * chord, axis=2).min(axis=1)
    np.testing.assert_allclose(distances_to_polyline(points, path, closed=True), brute, rtol=1e-12)
