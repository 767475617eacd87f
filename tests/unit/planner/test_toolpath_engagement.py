"""Engagement of the cutter along milling passes, against closed forms and areas by polygons, and the feed that follows it."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon
from shapely.ops import substring

from planner.plan import Pass
from planner.toolpath.engagement import eased, engagement_limit_rad, engagements
from planner.toolpath.motion import process_pass, straight

RADIUS = 4.0
FEED = 6.0
SQUARE_RAD = np.radians(8.0)


def way(*points: tuple[float, float]) -> Pass:
    return process_pass(straight([(x, y, 0.0) for x, y in points]), [0.0, FEED, 0.0, 0.0, 0.0])


def block(low: float = -20.0, high: float = 20.0) -> MultiPolygon:
    return MultiPolygon([shapely.box(low, low, high, high)])


def middle(one: Pass, metal: MultiPolygon) -> float:
    seen = engagements([one], metal, RADIUS)[0]
    inside = (seen.arc_mm > 0.4 * seen.arc_mm[-1]) & (seen.arc_mm < 0.6 * seen.arc_mm[-1])
    return float(np.median(seen.angle_rad[inside]))


@pytest.mark.parametrize("depth", [0.5, 1.0, 3.0, 6.0])
def test_a_straight_cut_at_a_radial_depth_stands_in_metal_by_its_closed_form(depth: float) -> None:
    found = middle(way((-30.0, 20.0 + RADIUS - depth), (30.0, 20.0 + RADIUS - depth)), block())
    assert found == pytest.approx(engagement_limit_rad(depth, RADIUS), abs=SQUARE_RAD)


def test_a_slot_stands_in_metal_by_half_a_turn_and_the_same_way_again_by_no_more_than_its_sides() -> None:
    slot = way((-30.0, 0.0), (30.0, 0.0))
    first, again = engagements([slot, slot], block(), RADIUS)
    assert first.greatest_rad == pytest.approx(np.pi, abs=SQUARE_RAD)
    assert again.greatest_rad <= 2.5 * SQUARE_RAD


def test_a_way_round_an_inside_corner_agrees_with_arcs_cut_by_polygons() -> None:
    rng = np.random.default_rng(4)
    metal = shapely.difference(block(), shapely.box(-25.0, -25.0, 10.0, 10.0))
    points = np.array([(-22.0, 7.0), (7.0, 7.0), (7.0, -22.0)])
    one = way(*[(float(x), float(y)) for x, y in points])
    seen = engagements([one], MultiPolygon([metal]), RADIUS)[0]
    line = shapely.LineString(points)
    for k in rng.integers(5, len(seen.arc_mm), 40):
        at, before = (np.array(line.interpolate(float(seen.arc_mm[n])).coords[0]) for n in (k, k - 1))
        gone = shapely.buffer(substring(line, 0.0, float(seen.arc_mm[k - 1])), RADIUS, quad_segs=64)
        heading = np.arctan2(*(at - before)[::-1])
        angle = heading + np.linspace(-0.5 * np.pi, 0.5 * np.pi, 721)
        edge = shapely.LineString(at + RADIUS * np.column_stack([np.cos(angle), np.sin(angle)]))
        exact = shapely.intersection(edge, shapely.difference(metal, gone)).length / RADIUS
        assert seen.angle_rad[k] == pytest.approx(exact, abs=SQUARE_RAD)


def test_feed_falls_where_the_cutter_stands_in_more_metal_than_it_should_and_nowhere_else() -> None:
    limit = engagement_limit_rad(1.0, RADIUS)
    light = way((-30.0, 20.0 + RADIUS - 1.0), (30.0, 20.0 + RADIUS - 1.0))
    slot = way((-30.0, 0.0), (30.0, 0.0))
    same, slower = eased([light, slot], block(), RADIUS, limit)
    assert same is light
    rows = slower.setpoints
    in_air = (rows[:, 0] < 4.0) | (rows[:, 0] > 49.0)
    assert rows[:, 1].min() == pytest.approx(0.25 * FEED) and (np.diff(rows[:, 0]) > 0.0).all()
    assert (rows[in_air, 1] == FEED).all() and rows[0, 0] == 0.0 and rows[-1, 1] == FEED
