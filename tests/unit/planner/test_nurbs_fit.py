"""Contours to curves: the paper's local cubic interpolation against analytic shapes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from planner.errors import FitError
from planner.nurbs.corners import by_turning_angle
from planner.nurbs.curve import Curve
from planner.nurbs.densify import densify, drop_collinear
from planner.nurbs.fit import interpolate, interpolate_many
from planner.nurbs.handles import equal_speed
from planner.nurbs.measure import closest_points, deviation
from planner.slicing.contours import section_curves_many
from tests.unit.planner import smooth_surfaces as known

Floats = NDArray[np.float64]
FINE = np.linspace(0.0, 1.0, 20_001)


def circle_points(radius: float, count: int) -> Floats:
    t = 2.0 * np.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(t), np.sin(t)])


def ellipse_points(count: int) -> Floats:
    return circle_points(1.0, count) * [30.0, 10.0]


def from_circle(curve: Curve, radius: float) -> float:
    return float(np.abs(np.linalg.norm(curve.evaluate(FINE), axis=1) - radius).max())


def from_ellipse(curve: Curve) -> float:
    """Distance from the 30 x 10 ellipse by Newton on its angle: independent of the kernel's closest point."""
    x, y = curve.evaluate(FINE).T
    t = np.arctan2(y / 10.0, x / 30.0)
    for _ in range(20):
        cos, sin = np.cos(t), np.sin(t)
        slope = (30 * cos - x) * -30 * sin + (10 * sin - y) * 10 * cos
        bend = 900 * sin**2 + 100 * cos**2 - (30 * cos - x) * 30 * cos - (10 * sin - y) * 10 * sin
        t = t - slope / bend
    return float(np.hypot(30 * np.cos(t) - x, 10 * np.sin(t) - y).max())


@pytest.mark.parametrize(
    ("handles", "radius", "count", "allowed_mm"),
    [
        ("speed", 23.0, 100, 1e-6),
        ("speed", 10.0, 12, 0.0021),
        ("curvature", 23.0, 100, 1e-8),
        ("curvature", 10.0, 12, 1e-4),
    ],
)
def test_circle_points_give_the_circle(handles: str, radius: float, count: int, allowed_mm: float) -> None:
    curve = interpolate(circle_points(radius, count), closed=True, handles=handles)  # type: ignore[arg-type]
    assert from_circle(curve, radius) <= allowed_mm


@pytest.mark.parametrize(
    ("handles", "count", "allowed_mm"), [("speed", 100, 4e-5), ("curvature", 100, 1e-5), ("curvature", 1000, 1e-11)]
)
def test_ellipse_points_give_the_ellipse(handles: str, count: int, allowed_mm: float) -> None:
    curve = interpolate(ellipse_points(count), closed=True, handles=handles)  # type: ignore[arg-type]
    assert from_ellipse(curve) <= allowed_mm


def test_curvature_handles_are_not_worse_on_a_coarse_ellipse() -> None:
    for count in (20, 30, 50):
        points = ellipse_points(count)
        speed, curvature = (interpolate(points, closed=True, handles=h) for h in ("speed", "curvature"))
        assert from_ellipse(curvature) <= from_ellipse(speed) * (1.0 + 1e-6)


@pytest.mark.parametrize("closed", [True, False])
def test_smooth_contour_has_2n_plus_2_control_points_and_2n_plus_6_knots(closed: bool) -> None:
    points = ellipse_points(37)
    curve = interpolate(points, closed=closed, handles="speed")
    pieces = 37 if closed else 36
    assert len(curve.control_points) == 2 * pieces + 2
    assert len(curve.knots) == 2 * pieces + 6
    assert curve.domain == (0.0, 1.0)


def test_speed_is_equal_at_joints_and_midpoints() -> None:
    rng = np.random.default_rng(5)
    t = np.sort(rng.uniform(0.0, 2.0 * np.pi, 60))
    curve = interpolate(
        np.column_stack([30 * np.cos(t), 10 * np.sin(t), 3 * np.sin(2 * t)]), closed=True, handles="speed"
    )
    edges = curve.breaks
    places = np.concatenate([edges, 0.5 * (edges[1:] + edges[:-1])])
    speeds = np.linalg.norm(curve.derivatives(places, 1)[1], axis=1)
    assert np.ptp(speeds) <= 1e-12 * speeds.mean() * len(edges)
    before, after = curve.derivatives(edges, 1, side="left")[1], curve.derivatives(edges, 1)[1]
    assert np.abs(before - after)[1:-1].max() <= 1e-9 * speeds.mean()


def test_speed_root_makes_both_ends_and_the_middle_equally_fast_for_any_tangents() -> None:
    rng = np.random.default_rng(3)
    chord = rng.normal(size=(2000, 3)) * 10.0 ** rng.uniform(-3, 3, (2000, 1))
    first, last = (v / np.linalg.norm(v, axis=1)[:, None] for v in rng.normal(size=(2, 2000, 3)))
    speed = equal_speed(chord, first, last)
    middle = 1.5 * chord - 0.25 * speed[:, None] * (first + last)
    assert np.all(speed > 0.0)
    np.testing.assert_allclose(np.linalg.norm(middle, axis=1), speed, rtol=1e-12)


def test_curve_goes_through_its_points_with_no_kink_at_the_seam() -> None:
    points = ellipse_points(40)
    curve = interpolate(points, closed=True)
    np.testing.assert_allclose(curve.evaluate(curve.breaks[:-1]), points, atol=1e-12)
    assert curve.is_closed
    start, end = curve.derivatives(0.0, 1)[1], curve.derivatives(1.0, 1, side="left")[1]
    np.testing.assert_allclose(start, end, rtol=1e-10)


def test_square_with_corners_stays_exactly_square() -> None:
    square = densify([[0, 0], [10, 0], [10, 10], [0, 10]], 1.0, closed=True)
    curve = interpolate(square, closed=True, corners=by_turning_angle(square, 30.0), handles="speed")
    x, y = curve.evaluate(FINE).T
    assert np.minimum.reduce([abs(x), abs(x - 10), abs(y), abs(y - 10)]).max() <= 1e-9
    reached, _ = closest_points(curve, [[10.0, 10.0], [0.0, 10.0]])
    assert np.abs(curve.evaluate(reached) - [[10.0, 10.0], [0.0, 10.0]]).max() <= 1e-9
    assert sorted(np.unique(curve.knots, return_counts=True)[1]) == [2] * 36 + [3] * 3 + [4] * 2


def test_corner_between_arcs_does_not_bend_the_arcs() -> None:
    t = np.linspace(0.0, np.pi, 41)
    upper = np.column_stack([np.cos(t), np.sin(t)]) * 5.0
    half_disc = np.vstack([upper, [[-2.5, 0.0], [0.0, 0.0], [2.5, 0.0]]])
    curve = interpolate(half_disc, closed=True, corners=[0, 40])
    p = curve.evaluate(FINE)
    on_arc = p[:, 1] > 1e-9
    assert np.abs(np.linalg.norm(p[on_arc], axis=1) - 5.0).max() <= 2e-5
    assert p[:, 1].min() >= -1e-12


def test_straight_sides_between_arcs_stay_straight() -> None:
    t = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 21)
    right = np.column_stack([50.0 + 5.0 * np.cos(t), 5.0 * np.sin(t)])
    curve = interpolate(np.vstack([right, -right + [50.0, 0.0]]), closed=True)
    x, y = curve.evaluate(FINE).T
    beside = np.where(x > 50.0, np.hypot(x - 50.0, y), np.where(x < 0.0, np.hypot(x, y), np.abs(y)))
    assert np.abs(beside - 5.0).max() <= 4e-3


def test_two_points_make_a_straight_line() -> None:
    curve = interpolate([[0, 0, 0], [3, 4, 0]], closed=False)
    np.testing.assert_allclose(curve.evaluate(FINE), FINE[:, None] * [[3.0, 4.0, 0.0]], atol=1e-12)


def test_uneven_collinear_points_never_run_backwards() -> None:
    points = np.array([[0.0, 0], [1, 0], [11, 0], [11.5, 0], [40, 0]])
    x = interpolate(points, closed=False).evaluate(FINE)[:, 0]
    assert np.all(np.diff(x) > 0.0)


def test_contour_that_turns_back_on_itself_keeps_its_cusp() -> None:
    curve = interpolate([[0, 0], [5, 0], [10, 0], [5, 0], [0, 0], [0, 3]], closed=False)
    p = curve.evaluate(np.union1d(FINE, curve.breaks))
    assert np.isfinite(p).all() and p[:, 0].max() == pytest.approx(10.0, abs=1e-9)


def test_repeated_points_change_nothing() -> None:
    points = ellipse_points(30)
    repeated = np.vstack([np.repeat(points, 2, axis=0), points[:1]])
    plain, doubled = interpolate(points, closed=True), interpolate(repeated, closed=True)
    np.testing.assert_allclose(doubled.control_points, plain.control_points, atol=1e-12)
    square = [[0, 0], [0, 0], [4, 0], [4, 4], [4, 4], [0, 4], [0, 0]]
    assert interpolate(square, closed=True, corners=[1, 2, 4, 5]).length == pytest.approx(16.0, abs=1e-12)


@pytest.mark.parametrize(
    ("points", "closed", "said"),
    [
        ([[1, 1], [1, 1], [1, 1]], False, "1 distinct"),
        ([[0, 0], [1, 0], [0, 0]], True, "2 distinct"),
        ([[0, 0], [np.nan, 0], [1, 1]], True, "point 1 is not finite"),
        ([[0.0], [1.0]], False, "shape"),
    ],
)
def test_points_that_make_no_curve_are_refused_with_one_line(
    points: list[list[float]], closed: bool, said: str
) -> None:
    with pytest.raises(FitError, match=said) as refusal:
        interpolate(points, closed=closed)
    assert "\n" not in refusal.value.message


def test_fitting_many_contours_at_once_gives_what_one_by_one_gives() -> None:
    contours = [circle_points(3.0, 17), ellipse_points(40), np.array([[0.0, 0], [1, 0]]), circle_points(1.0, 4)]
    closed, corners = [True, True, False, True], [None, [0, 20], None, [0, 1, 2, 3]]
    for curve, points, loop, marks in zip(
        interpolate_many(contours, closed=closed, corners=corners), contours, closed, corners, strict=True
    ):
        alone = interpolate(points, closed=loop, corners=marks)
        np.testing.assert_allclose(curve.control_points, alone.control_points, atol=1e-14)
        np.testing.assert_allclose(curve.knots, alone.knots, atol=1e-13)


def test_known_tangents_are_taken() -> None:
    t = np.array([0.0, 0.4, 1.5, 1.7, 3.0, 4.4, 5.0])
    points, tangents = np.column_stack([np.cos(t), np.sin(t)]), np.column_stack([-np.sin(t), np.cos(t)])
    guessed, told = interpolate(points, closed=True), interpolate(points, closed=True, tangents=tangents)
    assert from_circle(told, 1.0) < 0.02 < from_circle(guessed, 1.0)


def test_densified_sides_are_no_longer_than_the_spacing_and_repeat_no_point() -> None:
    points = ellipse_points(7)
    dense = densify(points, 0.7, closed=True)
    sides = np.linalg.norm(np.roll(dense, -1, axis=0) - dense, axis=1)
    expected = np.ceil(np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1) / 0.7).sum()
    assert len(dense) == expected and sides.min() > 0.0 and sides.max() <= 0.7
    assert len(densify([[0, 0], [1, 0]], 0.25, closed=False)) == 5


def test_densifying_drives_the_curve_onto_the_facets() -> None:
    twelve = circle_points(10.0, 12)
    on_facets = interpolate(densify(twelve, 0.5, closed=True), closed=True)
    assert from_circle(on_facets, 10.0) == pytest.approx(10.0 * (1.0 - np.cos(np.pi / 12)), rel=0.01)


def test_points_of_facet_diagonals_are_dropped_and_the_circle_comes_back() -> None:
    ring = circle_points(10.0, 48)
    with_diagonals = np.empty((96, 2))
    with_diagonals[::2] = ring
    with_diagonals[1::2] = ring + 0.37 * (np.roll(ring, -1, axis=0) - ring)
    kept, index = drop_collinear(with_diagonals, 1e-6, closed=True)
    np.testing.assert_array_equal(index, np.arange(0, 96, 2))
    assert (
        from_circle(interpolate(kept, closed=True), 10.0)
        < 1.5e-5
        < from_circle(interpolate(with_diagonals, closed=True), 10.0)
    )


def test_dropping_collinear_points_never_leaves_the_tolerance() -> None:
    fine = circle_points(10.0, 3000)
    kept, index = drop_collinear(fine, 1e-3, closed=True)
    assert len(index) < 600
    middle = 0.5 * (kept + np.roll(kept, -1, axis=0))
    assert 10.0 - np.linalg.norm(middle, axis=1).min() <= 1e-3


def test_dropping_collinear_points_keeps_a_spike() -> None:
    kept, _ = drop_collinear([[0, 0], [5, 0], [10, 0], [4, 0], [4, 4]], 1e-6, closed=False)
    np.testing.assert_array_equal(kept, [[0, 0], [10, 0], [4, 0], [4, 4]])


def test_arcs_and_lines_become_exact_and_meet_smoothly() -> None:
    quarter = np.linspace(0.0, 0.5 * np.pi, 9)
    rounded = np.vstack(
        [
            np.column_stack([x + 5.0 * np.cos(quarter + turn), y + 5.0 * np.sin(quarter + turn)])
            for x, y, turn in ((20, 10, 0), (-20, 10, 0.5 * np.pi), (-20, -10, np.pi), (20, -10, 1.5 * np.pi))
        ]
    )
    curve = interpolate(rounded, closed=True, arc_tolerance_mm=1e-6)
    beyond = np.abs(curve.evaluate(FINE)) - [20.0, 10.0]
    away = np.hypot(*np.maximum(beyond, 0.0).T) + np.minimum(beyond.max(axis=1), 0.0) - 5.0
    assert len(curve.control_points) == 25 and np.abs(away).max() <= 1e-12
    before, after = (curve.derivatives(curve.breaks[1:-1], 1, side=s)[1] for s in ("left", "right"))
    turning = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    assert np.abs(turning).max() <= 1e-12 * np.einsum("ij,ij->i", before, after).max()


def test_a_full_circle_in_a_tilted_plane_becomes_four_exact_arcs() -> None:
    x, y = circle_points(23.0, 100).T
    curve = interpolate(np.column_stack([x, 0.6 * y, 0.8 * y]), closed=True, arc_tolerance_mm=1e-7)
    assert len(curve.control_points) == 13
    assert np.abs(np.linalg.norm(curve.evaluate(FINE), axis=1) - 23.0).max() <= 1e-12


def test_neither_a_square_nor_a_polygon_of_creases_nor_an_ellipse_is_taken_for_arcs() -> None:
    for points, corners in ((circle_points(5.0, 4), None), (circle_points(5.0, 12), np.ones(12, dtype=bool))):
        assert interpolate(points, closed=True, corners=corners, arc_tolerance_mm=1e-3).weights is None
    assert interpolate(ellipse_points(100), closed=True, arc_tolerance_mm=1e-6).weights is None


def test_known_curvatures_are_taken() -> None:
    t = np.array([0.0, 0.9, 1.5, 2.6, 3.5, 4.4, 5.4])
    points, tangents = np.column_stack([np.cos(t), np.sin(t)]), np.column_stack([-np.sin(t), np.cos(t)])
    told = interpolate(points, closed=True, tangents=tangents, curvatures=-points)
    equal_speed = interpolate(points, closed=True, tangents=tangents, handles="speed")
    assert from_circle(told, 1.0) <= 5e-4 < from_circle(equal_speed, 1.0)
    flatter = interpolate(points, closed=True, tangents=tangents, curvatures=-0.9 * points)
    assert flatter.curvature(flatter.breaks[1:-1]) == pytest.approx(0.9, rel=1e-6)


def test_one_sided_tangents_are_taken_at_corners() -> None:
    t = np.linspace(0.0, np.pi, 5)
    points = np.column_stack([np.cos(t), np.sin(t)])
    sided = np.full((5, 2, 2), np.nan)
    sided[0, 1], sided[4, 0] = (0.0, 1.0), (0.0, -1.0)
    curve = interpolate(points, closed=True, corners=[0, 4], tangents=sided)
    above = curve.evaluate(FINE)
    above = above[above[:, 1] > 1e-9]
    assert np.abs(np.linalg.norm(above, axis=1) - 1.0).max() <= 1.5e-3


def test_sections_of_a_cylinder_with_facet_diagonals_are_circles_of_four_exact_arcs() -> None:
    shape = known.cylinder()
    sections = known.sections_across(shape.mesh, np.array([0.0, 0.0, 1.0]))
    for made in section_curves_many(sections, shape.mesh):
        curve = made[0].curve
        across = np.hypot(*curve.evaluate(FINE)[:, :2].T)
        assert curve.weights is not None and len(curve.control_points) == 13
        assert np.abs(across - known.RADIUS).max() <= 1e-5


def test_a_point_that_is_nearly_there_twice_makes_no_arc() -> None:
    zigzag = np.array([[0.0, 0.0], [1.0, 0.2], [1.0 + 1e-7, 0.2], [2.0, 0.0], [3.0, 0.5], [4.0, -0.3], [5.0, 0.9]])
    curve = interpolate(zigzag, closed=False, arc_tolerance_mm=1e-6)
    assert curve.weights is None


def test_deviation_from_the_facets_falls_with_the_spacing_and_ends_at_the_circles_sagitta() -> None:
    twelve = circle_points(10.0, 12)
    sagitta = 10.0 * (1.0 - np.cos(np.pi / 12))
    plain = deviation(interpolate(twelve, closed=True), twelve)
    found = [deviation(interpolate(densify(twelve, e, closed=True), closed=True), twelve) for e in (2.0, 1.0, 0.5, 0.1)]
    assert plain == pytest.approx(sagitta, rel=1e-3)
    assert found == sorted(found, reverse=True) and found[0] < plain and found[-1] < 0.02 * plain


def test_deviation_is_the_true_maximum_both_ways() -> None:
    spike = np.array([[0.0, 0.0], [4.3, 0.0], [5.0, 7.0], [5.7, 0.0], [10.0, 0.0]])
    chord = Curve.from_polyline(spike[[0, 4]])
    assert deviation(chord, spike, closed=False) == pytest.approx(7.0, abs=1e-12)
    assert deviation(Curve.from_polyline(spike), spike[[0, 4]], closed=False) == pytest.approx(7.0, abs=1e-12)
    arc = interpolate(circle_points(10.0, 200)[:67], closed=False, handles="curvature")
    ends = arc.evaluate(np.array([0.0, 1.0]))
    height = 10.0 * (1.0 - np.cos(0.5 * 66 * 2.0 * np.pi / 200))
    assert deviation(arc, ends, closed=False) == pytest.approx(height, rel=1e-6)
