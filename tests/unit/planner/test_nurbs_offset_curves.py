"""Offset curves at constant distance, measured both ways by dense sampling of source and result."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from planner.errors import FitError
from planner.nurbs.construct import circle, line
from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.nurbs.offset_curves import offset_curves, offset_many

Floats = NDArray[np.float64]

ALLOWED_MM = 1e-3
SQUARE = np.array([(0, 0), (40, 0), (40, 40), (0, 40)], dtype=float)


def polygon(points: object) -> Curve:
    return Curve.from_polyline(np.asarray(points, dtype=float), closed=True)


def polar(reach: Floats, centre: tuple[float, float] = (0.0, 0.0)) -> Curve:
    t = 2.0 * np.pi * np.arange(len(reach)) / len(reach)
    return interpolate(reach[:, None] * np.column_stack([np.cos(t), np.sin(t)]) + centre, closed=True)


def wave(radius: float, depth: float, count: int, centre: tuple[float, float] = (0.0, 0.0)) -> Curve:
    return polar(radius * (1.0 + depth * np.cos(count * 2.0 * np.pi * np.arange(240) / 240)), centre)


def ellipse() -> Curve:
    t = 2.0 * np.pi * np.arange(300) / 300
    return interpolate(np.column_stack([30 * np.cos(t), 10 * np.sin(t)]), closed=True)


def gear() -> Curve:
    t = 2.0 * np.pi * (np.repeat(np.arange(12), 4) + np.tile([-0.3, -0.2, 0.2, 0.3], 12)) / 12
    reach = np.tile([12.0, 15.0, 15.0, 12.0], 12)
    return polygon(reach[:, None] * np.column_stack([np.cos(t), np.sin(t)]))


SHAPES = {
    "ellipse": [ellipse()],
    "wavy hole": [circle((0.0, 0.0), 30.0), wave(12.0, 0.3, 5)],
    "gear": [gear()],
    "eccentric": [circle((0.0, 0.0), 20.0), circle((9.0, 0.0), 8.0)],
    "plate": [polygon(SQUARE), polygon([(10, 10), (10, 20), (20, 20), (20, 10)])],
    "islands": [circle((0.0, 0.0), 5.0), circle((11.0, 0.0), 5.0), wave(25.0, 0.1, 3), wave(20.0, 0.1, 3)],
    "letter": [polygon([(0, 0), (20, 0), (20, 4), (5, 4), (5, 9), (15, 9), (15, 13), (5, 13), (5, 18), (20, 18), (20, 22), (0, 22)])],
}


def dense(curve: Curve, count: int = 12000) -> Floats:
    """Points of a closed curve, its knots among them; the last is not repeated."""
    return curve.evaluate(np.union1d(np.linspace(*curve.domain, count), curve.breaks))[:-1]


def distances(curves: list[Curve], points: Floats) -> Floats:
    """Distance of each point from the nearest curve: nearest dense sample, then the chords on both sides of it."""
    best = np.full(len(points), np.inf)
    for curve in curves:
        path = dense(curve)
        for near in cKDTree(path).query(points, k=3)[1].T:
            for step in (-1, 0):
                low = path[(near + step) % len(path)]
                chord = path[(near + step + 1) % len(path)] - low
                share = ((points - low) * chord).sum(axis=1) / np.maximum((chord**2).sum(axis=1), 1e-300)
                foot = low + np.clip(share, 0.0, 1.0)[:, None] * chord
                best = np.minimum(best, np.linalg.norm(points - foot, axis=1))
    return best


def winding(curves: list[Curve], points: Floats) -> NDArray[np.bool_]:
    """Whether points lie inside by the even-odd rule: crossings of a ray to the right."""
    inside = np.zeros(len(points), dtype=bool)
    for curve in curves:
        path = dense(curve, 2000)
        low, high = path, np.roll(path, -1, axis=0)
        for k, (x, y) in enumerate(points):
            spans = (low[:, 1] > y) != (high[:, 1] > y)
            a, b = low[spans], high[spans]
            inside[k] ^= np.sum(a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1]) > x) % 2 == 1
    return inside


def errors_both_ways(source: list[Curve], result: list[Curve], distance_mm: float) -> tuple[float, float]:
    """Result to source; and source to result, where the source's offset point is nearer to no other part of it."""
    reach = abs(distance_mm)
    there = np.abs(distances(source, np.vstack([dense(curve, 2500) for curve in result])) - reach).max() if result else 0.0
    back = 0.0
    for curve in source:
        place, speed = curve.derivatives(np.linspace(*curve.domain, 241)[:-1] + 1e-6, 1)
        normal = np.column_stack([-speed[:, 1], speed[:, 0]]) / np.linalg.norm(speed, axis=1)[:, None]
        for moved in (place + reach * normal, place - reach * normal):
            stays = (distances(source, moved) > reach - 1e-6) & (winding(source, moved) == (distance_mm < 0.0))
            if stays.any():
                assert result
                back = max(back, float(np.abs(distances(result, place[stays]) - reach).max()))
    return float(there), back


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("distance_mm", [-4.0, -1.7, -0.4, 0.7, 3.0])
def test_offset_and_source_are_the_distance_apart_both_ways(name: str, distance_mm: float) -> None:
    result = offset_curves(SHAPES[name], distance_mm)
    assert all(curve.is_closed for curve in result)
    assert max(errors_both_ways(SHAPES[name], result, distance_mm)) <= ALLOWED_MM


@pytest.mark.parametrize("seed", range(6))
def test_random_outlines_with_corners_and_tight_bends_keep_the_distance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle = 2.0 * np.pi * np.arange(36) / 36
    reach = 15.0 * np.clip(1.0 + sum(0.3 / m * rng.normal() * np.cos(m * angle + rng.uniform(0, 7)) for m in range(2, 7)), 0.2, 3)
    points = reach[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    source = [interpolate(points, closed=True, corners=rng.random(36) < 0.2)]
    for distance_mm in (-3.0, -0.6, 0.6, 4.0):
        assert max(errors_both_ways(source, offset_curves(source, distance_mm), distance_mm)) <= ALLOWED_MM


@pytest.mark.parametrize("distance_mm", [-22.0, -1.0, 5.0])
def test_offset_of_a_circle_is_a_circle_of_four_arcs(distance_mm: float) -> None:
    t = 2.0 * np.pi * np.arange(100) / 100
    fitted = interpolate(23.0 * np.column_stack([np.cos(t), np.sin(t)]), closed=True)
    for source, allowed in ((circle((4.0, 1.0), 23.0), 1e-12), (fitted.transformed(np.array([[1, 0, 4], [0, 1, 1], [0, 0, 1]])), 1e-5)):
        [result] = offset_curves([source], distance_mm)
        assert len(result.control_points) == 13
        assert np.abs(np.linalg.norm(dense(result) - [4.0, 1.0], axis=1) - 23.0 - distance_mm).max() <= allowed


def test_offset_of_a_square_has_straight_sides_and_exact_corners_or_arcs() -> None:
    [inner], [outer] = offset_curves([polygon(SQUARE)], -2.0), offset_curves([polygon(SQUARE)], 2.0)
    assert len(inner.control_points) == 13 and len(outer.control_points) == 25
    assert sorted(map(tuple, np.round(inner.evaluate(inner.breaks[:-1]), 9))) == [(2, 2), (2, 38), (38, 2), (38, 38)]
    assert outer.length == pytest.approx(160 + 4 * np.pi, rel=1e-9)


def test_offset_is_smooth_but_for_the_corners_where_it_cuts_itself_off() -> None:
    for distance_mm, corners in ((-2.0, 0), (-6.0, 2), (4.0, 0)):
        [result] = offset_curves([ellipse()], distance_mm)
        ends = result.breaks[:-1]
        left = result.derivatives(np.append(1.0, ends[1:]), 1, "left")[1]
        right = result.derivatives(ends, 1)[1]
        turn = np.arctan2(left[:, 0] * right[:, 1] - left[:, 1] * right[:, 0], (left * right).sum(axis=1))
        assert np.sum(np.abs(turn) > 5e-3) == corners


def test_holes_and_outlines_split_merge_nest_and_vanish() -> None:
    def kinds(curves: list[Curve], distance_mm: float) -> list[bool]:
        return [ring.is_hole for ring in offset_many([curves], [distance_mm])[0][0]]

    plate = SHAPES["plate"]
    assert [kinds(plate, -d) for d in (2.0, 9.5, 12.0)] == [[False, True], [False], []]
    assert kinds(plate, 6.0) == [False]
    pair = SHAPES["islands"][:2]
    assert len(kinds(pair, 0.4)) == 2 and len(kinds(pair, 0.6)) == 1
    assert [ring.parent for ring in offset_many([plate], [-2.0])[0][0]] == [-1, 0]


def test_sense_and_order_of_the_given_curves_do_not_matter_and_results_keep_material_on_the_left() -> None:
    outer, hole = circle((0.0, 0.0), 20.0), circle((3.0, 0.0), 5.0)
    usual = [curve.length for curve in offset_curves([outer, hole], -1.0)]
    turned = offset_curves([hole, outer.reversed()], -1.0)
    assert [curve.length for curve in turned] == pytest.approx(usual)
    areas = [0.5 * np.sum(p[:, 0] * np.roll(p[:, 1], -1) - p[:, 1] * np.roll(p[:, 0], -1)) for p in map(dense, turned)]
    assert areas == pytest.approx([np.pi * 19.0**2, -np.pi * 6.0**2], rel=1e-4)


def test_many_sets_and_distances_in_one_call_are_those_of_single_calls() -> None:
    sets = [SHAPES["gear"], SHAPES["eccentric"]]
    table = offset_many(sets, [-1.0, -2.0])
    for curves, row in zip(sets, table, strict=True):
        for distance_mm, rings in zip((-1.0, -2.0), row, strict=True):
            for ring, single in zip(rings, offset_curves(curves, distance_mm), strict=True):
                np.testing.assert_array_equal(ring.curve.control_points, single.control_points)


def test_curves_at_a_height_give_offsets_at_that_height_and_far_from_the_origin_too() -> None:
    up = np.eye(4)
    up[:3, 3] = 1e4, -2e4, 7.0
    [result] = offset_curves([gear().transformed(up)], 1.0)
    assert np.all(result.control_points[:, 2] == 7.0)
    [here] = offset_curves([gear()], 1.0)
    assert result.length == pytest.approx(here.length, abs=1e-6)


def test_without_arcs_all_pieces_are_plain_cubics_within_the_tolerance() -> None:
    [result] = offset_curves([circle((0.0, 0.0), 23.0)], 2.0, arcs=False)
    assert result.weights is None
    assert np.abs(np.linalg.norm(dense(result), axis=1) - 25.0).max() <= 2e-4


def test_bad_input_is_one_clear_line() -> None:
    with pytest.raises(FitError, match="open"):
        offset_curves([line((0, 0), (1, 1))], 1.0)
    tilted = circle((0.0, 0.0, 0.0), 5.0).control_points + np.outer(np.arange(9) % 8, [0, 0, 0.1])
    with pytest.raises(FitError, match="not level"):
        offset_curves([Curve(2, circle((0.0, 0.0), 5.0).knots, tilted)], 1.0)
    with pytest.raises(ValueError, match="tolerance"):
        offset_curves([gear()], 1.0, tolerance_mm=0.0)
    with pytest.raises(ValueError, match="cannot offset"):
        offset_curves([gear()], float("nan"))
    assert offset_curves([], 1.0) == [] and offset_curves([gear()], -20.0) == []
