"""Constant-distance offsets, measured from the exact source curves both ways."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, Polygon

from planner.errors import FitError
from planner.nurbs.construct import circle, line
from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.nurbs.measure import closest_points
from planner.nurbs.offset import inset, inset_rings, outset
from planner.nurbs.rings import Ring, curves_from_region, region_from_curves, region_from_loops

ALLOWED_MM = 2e-3
PLATE = Polygon([(0, 0), (40, 0), (40, 40), (0, 40)], [[(10, 10), (10, 20), (20, 20), (20, 10)]])


def ellipse() -> Curve:
    t = 2.0 * np.pi * np.arange(400) / 400
    return interpolate(np.column_stack([30 * np.cos(t), 10 * np.sin(t)]), closed=True)


def worst_distance_error(source: Curve, rings: list[Ring], distance_mm: float) -> float:
    points = np.vstack([ring.curve.evaluate(ring.curve.sample(1e-4)) for ring in rings])
    return float(np.abs(closest_points(source, points)[1] - distance_mm).max())


@pytest.mark.parametrize("move", [inset, outset])
@pytest.mark.parametrize("distance_mm", [0.25, 1.0, 3.0, 6.0])
def test_offset_of_a_circle_is_the_circle_at_that_distance(move: object, distance_mm: float) -> None:
    source = circle((4.0, 1.0), 23.0)
    [ring] = curves_from_region(move(region_from_curves([source]), distance_mm))  # type: ignore[operator]
    radius = 23.0 + (distance_mm if move is outset else -distance_mm)
    reach = np.linalg.norm(ring.curve.evaluate(np.linspace(0, 1, 4001)) - [4.0, 1.0], axis=1)
    assert np.abs(reach - radius).max() <= ALLOWED_MM
    assert ring.curve.length == pytest.approx(2 * np.pi * radius, rel=1e-4)
    assert len(ring.curve.breaks) <= 40


@pytest.mark.parametrize("distance_mm", [0.25, 1.0, 2.5, 3.0])
def test_offset_of_an_ellipse_and_the_ellipse_are_that_far_apart_both_ways(distance_mm: float) -> None:
    source = ellipse()
    for move in (inset, outset):
        rings = curves_from_region(move(region_from_curves([source]), distance_mm))
        assert len(rings) == 1 and not rings[0].is_hole
        assert worst_distance_error(source, rings, distance_mm) <= ALLOWED_MM
        back = closest_points(rings[0].curve, source.evaluate(np.linspace(0, 1, 3000)))[1]
        assert np.abs(back - distance_mm).max() <= ALLOWED_MM


@pytest.mark.parametrize("distance_mm", [0.5, 2.0, 4.0])
def test_offsets_of_a_wavy_outline_keep_the_distance_in_its_hollows_too(distance_mm: float) -> None:
    t = 2.0 * np.pi * np.arange(400) / 400
    reach = 15.0 * (1.0 + 0.5 * np.cos(3.0 * t))
    source = interpolate(reach[:, None] * np.column_stack([np.cos(t), np.sin(t)]), closed=True)
    for move in (inset, outset):
        rings = curves_from_region(move(region_from_curves([source]), distance_mm))
        assert rings and worst_distance_error(source, rings, distance_mm) <= ALLOWED_MM


def test_inset_beyond_the_radius_of_curvature_trims_to_a_corner_and_stays_at_the_distance() -> None:
    source = ellipse()  # smallest radius of curvature 100/30
    rings = curves_from_region(inset(region_from_curves([source]), 6.0))
    assert len(rings) == 1 and worst_distance_error(source, rings, 6.0) <= ALLOWED_MM
    low, high = rings[0].curve.bounding_box()
    assert high[0] < 30 - 6.0 and high[1] == pytest.approx(4.0, abs=ALLOWED_MM) == -low[1]


@pytest.mark.parametrize("distance_mm", [0.5, 1.0, 4.0, 5.5, 9.5])
def test_offsets_of_a_plate_with_a_hole_agree_with_distances_everywhere(distance_mm: float) -> None:
    for move in (inset, outset):
        region = move(PLATE, distance_mm)
        for ring in curves_from_region(region):
            points = shapely.points(ring.curve.evaluate(ring.curve.sample(1e-4)))
            assert np.abs(shapely.distance(PLATE.boundary, points) - distance_mm).max() <= ALLOWED_MM
        rng = np.random.default_rng(0)
        probes = shapely.points(rng.uniform(-15, 55, (4000, 2)))
        away = np.where(shapely.covers(PLATE, probes), -1.0, 1.0) * shapely.distance(PLATE.boundary, probes)
        decided = np.abs(away - (distance_mm if move is outset else -distance_mm)) > ALLOWED_MM
        wanted = away < (distance_mm if move is outset else -distance_mm)
        np.testing.assert_array_equal(shapely.covers(region, probes)[decided], wanted[decided])


def test_inset_of_a_plate_keeps_holes_then_loses_them_then_vanishes() -> None:
    kinds = [[ring.is_hole for ring in curves_from_region(inset(PLATE, d))] for d in (2.0, 9.5, 12.0)]
    assert kinds == [[False, True], [False], []]
    outer, hole = curves_from_region(inset(PLATE, 2.0))
    assert hole.parent == 0 and outer.parent == -1
    np.testing.assert_allclose(outer.curve.bounding_box(), [[2, 2], [38, 38]], atol=1e-9)


def test_inset_of_a_dumbbell_splits_in_two() -> None:
    dumbbell = shapely.union_all([shapely.box(0, 0, 10, 10), shapely.box(9, 4, 21, 6), shapely.box(20, 0, 30, 10)])
    assert len(inset(dumbbell, 0.9).geoms) == 1
    rings = curves_from_region(inset(dumbbell, 1.1))
    assert len(rings) == 2
    starts = sorted(float(ring.curve.bounding_box()[0][0]) for ring in rings)
    tip = 20.0 + np.sqrt(1.1**2 - 1.0)  # 1.1 from both corners of the neck, which lie 1 above and below
    assert starts == pytest.approx([1.1, tip], abs=ALLOWED_MM)


def test_outset_of_two_discs_joins_them() -> None:
    pair = region_from_curves([circle((0.0, 0.0), 5.0), circle((11.0, 0.0), 5.0)])
    assert len(outset(pair, 0.4).geoms) == 2 and len(outset(pair, 0.6).geoms) == 1
    rings = curves_from_region(outset(pair, 0.6))
    p = rings[0].curve.evaluate(np.linspace(0, 1, 5000))
    reach = np.minimum(np.linalg.norm(p, axis=1), np.linalg.norm(p - [11.0, 0.0], axis=1))
    assert np.abs(reach - 5.6).max() <= ALLOWED_MM


def test_inset_rings_step_evenly_until_nothing_is_left() -> None:
    rings = inset_rings(region_from_curves([circle((0.0, 0.0), 5.0)]), 0.5, 1.0, 20)
    assert len(rings) == 5
    for index, ring in enumerate(rings):
        assert ring.area == pytest.approx(np.pi * (4.5 - index) ** 2, abs=0.02)


def test_square_outset_has_round_corners_and_straight_sides() -> None:
    [ring] = curves_from_region(outset(shapely.box(0, 0, 10, 10), 2.0))
    assert ring.curve.length == pytest.approx(40 + 4 * np.pi, rel=1e-4)
    p = ring.curve.evaluate(np.linspace(0, 1, 4001))
    middle = p[(p[:, 0] > 0.01) & (p[:, 0] < 9.99)]
    assert np.abs(np.abs(middle[:, 1] - 5.0) - 7.0).max() <= 1e-9


def test_curves_of_a_region_come_back_as_the_same_region() -> None:
    region = inset(PLATE, 1.5)
    again = region_from_curves([ring.curve for ring in curves_from_region(region, 5e-4)])
    assert again.symmetric_difference(region).area <= 5e-4 * region.length


def test_a_region_of_nested_loops_alternates_between_metal_and_hole() -> None:
    loops = [np.array([[-r, -r], [r, -r], [r, r], [-r, r]], dtype=float) for r in (1, 3, 2, 4)]
    region = region_from_loops(loops)
    assert region.area == pytest.approx(4 * (16 - 9 + 4 - 1)) and len(region.geoms) == 2


def test_bad_offsets_are_refused_and_empty_ones_are_empty() -> None:
    with pytest.raises(ValueError, match="cannot offset"):
        inset(PLATE, -1.0)
    with pytest.raises(ValueError, match="step"):
        inset_rings(PLATE, 1.0, 0.0, 3)
    with pytest.raises(FitError, match="open"):
        region_from_curves([line((0, 0), (1, 1))])
    assert inset(MultiPolygon(), 1.0).is_empty and curves_from_region(MultiPolygon()) == []
    assert outset(PLATE, 0.0).equals(PLATE)
