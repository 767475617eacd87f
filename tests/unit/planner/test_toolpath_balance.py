"""Patterns of beads: metal as the region takes it, no voids, no bead upon a bead; seen in the twin's metal as well."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import MultiPolygon, Polygon

from planner.nurbs.offset import inset
from planner.plan import Pass
from planner.process import Settings
from planner.recipe import FillRegion, Recipe
from planner.toolpath.balance import LayerBalance, balance_of, lit_beads
from planner.toolpath.books import books_findings
from planner.toolpath.contour import edge_mm
from planner.toolpath.islands import MOST_TRAVEL, islands_in_order, travel_mm
from planner.toolpath.pattern import part_passes
from planner.toolpath.ramps import ramped
from sim.process.deposit import deposit
from tests.unit.sim.metal_bench import LAW, UP, height, plate

HEIGHT_MM = 0.8
WIDTH_MM = 2.4  # about a bead


def settings_of(**fields: object) -> Settings:
    return Settings.from_recipe(Recipe.model_validate({"layer_height_mm": HEIGHT_MM, **fields}))


def disc(radius: float, x: float = 0.0) -> Polygon:
    return shapely.Point(x, 0.0).buffer(radius, quad_segs=48)


@st.composite
def regions(draw: st.DrawFn) -> Polygon:
    """Star-shaped polygons, rings, letters, walls and wedges, wider than two beads."""
    kind = draw(st.sampled_from(["star", "ring", "L", "U", "wall", "wedge"]))
    a, b, c = (draw(st.floats(0.0, 1.0)) for _ in range(3))
    if kind == "star":
        radii = np.array(draw(st.lists(st.floats(8.0, 16.0), min_size=8, max_size=8)))
        angle = 2.0 * np.pi * np.arange(8) / 8
        return Polygon(radii[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))
    if kind == "ring":
        return disc(14.0 + 6.0 * a).difference(disc(14.0 + 6.0 * a - WIDTH_MM * (2.1 + 3.9 * b)))
    if kind == "wall":
        return shapely.box(0.0, 0.0, 20.0 + 20.0 * a, WIDTH_MM * (2.1 + 3.9 * b))
    if kind == "wedge":
        return Polygon([(0.0, -6.0 - 3.0 * a), (30.0, -2.6 - b), (30.0, 2.6 + b), (0.0, 6.0 + 3.0 * a)])
    thick = 5.2 + 6.0 * a
    arms = [shapely.box(0.0, 0.0, 34.0 + 6.0 * b, thick), shapely.box(0.0, 0.0, thick, 25.0 + 5.0 * c)]
    arms += [shapely.box(34.0 + 6.0 * b - thick, 0.0, 34.0 + 6.0 * b, 25.0)] if kind == "U" else []
    whole = shapely.union_all(arms)
    assert isinstance(whole, Polygon)
    return whole


def laid(part: Polygon, asked: Settings, layer: int = 0) -> tuple[list[Pass], LayerBalance]:
    """The passes of a region, allowance and edge strip included, and their books."""
    bead = asked.bead_for(HEIGHT_MM)
    rings, fill = part_passes(part, 0.0, layer, bead, asked)
    passes = [*rings, *fill]
    full = inset(part, edge_mm(bead, asked)) if asked.is_milled else MultiPolygon([part])
    return passes, balance_of(full, lit_beads(passes, asked), bead.height_mm, asked)


@settings(max_examples=6, deadline=None)
@given(regions(), st.sampled_from(["auto", "raster", "contour", "spiral"]), st.integers(0, 3))
def test_every_pattern_brings_the_metal_that_a_region_takes_within_two_percent_and_leaves_no_gap(part: Polygon, fill: str, layer: int) -> None:
    passes, books = laid(part, settings_of(fill=fill), layer)
    assert books.ratio == pytest.approx(1.0, abs=0.02)
    assert books.void_beads <= 0.1 or fill == "contour"  # asked for in corners that its rings turn round
    assert books.double_share < 0.05
    assert all(len(step.setpoints) and (np.diff(step.setpoints[:, 0]) > 0.0).all() for step in passes)


@pytest.mark.parametrize("process", ["hybrid", "deposit"])
@pytest.mark.parametrize("beads", [2.2, 3.5, 5.1])
def test_ring_of_even_width_is_one_bead_without_a_break(process: str, beads: float) -> None:
    ring = disc(16.0).difference(disc(16.0 - beads * WIDTH_MM))
    passes, books = laid(ring, settings_of(process=process))
    [step] = passes
    lit = step.setpoints[:, 2] > 0.0
    assert lit[1:-1].all()  # lead-in and lead-out are dark, nothing between
    assert books.ratio == pytest.approx(1.0, abs=0.02) and books.void_beads == 0.0
    radii = np.linalg.norm(step.tip.evaluate(step.tip.sample(0.01))[:, :2], axis=1)
    rounds = radii[(radii > radii.min() + 0.01) & (radii < radii.max() - 0.01)]
    assert np.ptp(radii) == pytest.approx(beads * WIDTH_MM - settings_of(process=process).bead_for(HEIGHT_MM).width_mm, abs=0.15)
    assert len(rounds)


def test_raster_is_asked_for_in_one_region_and_by_height_in_another() -> None:
    ring = disc(16.0).difference(disc(8.0))
    rules = ({"pattern": "raster", "point_mm": (12.0, 0.0, 5.0)}, {"pattern": "contour", "z_mm": (10.0, 20.0)})
    asked = settings_of(fill_regions=rules)
    moved = np.eye(4)
    moved[0, 3] = 100.0
    assert asked.pattern_of(ring, 0.0) == "raster" and asked.pattern_of(disc(3.0), 0.0) == "auto"
    assert asked.pattern_of(ring, 12.0) == "contour" and asked.pattern_of(ring, 20.0) == "raster"
    assert asked.placed(moved, np.eye(4)).pattern_of(ring, 0.0) == "auto"
    assert asked.placed(np.eye(4), moved).pattern_of(shapely.affinity.translate(ring, 100.0), 0.0) == "raster"
    assert len(laid(ring, asked)[0]) > 10 and len(laid(ring, settings_of())[0]) == 1


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"pattern": "raster"}, "point_mm or z_mm"),
        ({"pattern": "zigzag", "z_mm": (0.0, 1.0)}, "pattern"),
        ({"pattern": "raster", "z_mm": (3.0, 1.0)}, "greater"),
    ],
)
def test_rule_without_a_place_or_with_an_unknown_pattern_is_refused(fields: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        FillRegion.model_validate(fields)


def test_islands_cool_while_others_are_built_and_the_way_stays_short() -> None:
    row = MultiPolygon([shapely.box(10.0 * k, 0.0, 10.0 * k + 5.0, 5.0) for k in range(7)])
    for layer in range(3):
        order = islands_in_order(row, layer)
        places = np.array([[part.centroid.x, part.centroid.y] for part in order])
        assert len({part.wkb for part in order}) == 7
        nearest = travel_mm(places, sorted(range(7), key=lambda k: places[k, 0]))
        assert travel_mm(places, list(range(7))) <= MOST_TRAVEL * 2.0 * nearest
    far = MultiPolygon([shapely.box(0, 0, 5, 5), shapely.box(8, 0, 13, 5), shapely.box(200, 0, 205, 5), shapely.box(208, 0, 213, 5)])
    xs = [part.centroid.x for part in islands_in_order(far, 0)]
    assert travel_mm(np.column_stack([xs, np.zeros(4)]), [0, 1, 2, 3]) <= MOST_TRAVEL * 208.0


def test_power_rises_over_the_start_of_a_bead_and_falls_over_its_end_never_below_the_window() -> None:
    plain = settings_of(ramp_mm=1.0)
    assert plain.material.deposition.ramp_power == 0.6
    rows = np.array([[0.0, 12.0, 0.0, 12.0, 15.0], [2.0, 12.0, 1200.0, 12.0, 15.0], [22.0, 12.0, 0.0, 12.0, 15.0]])
    made = ramped(rows, 24.0, plain)
    assert np.allclose(made[:, 0], [0.0, 2.0, 2.5, 3.0, 21.0, 21.5, 22.0])
    assert np.allclose(made[:, 2], [0.0, 720.0, 960.0, 1200.0, 960.0, 720.0, 0.0])
    assert np.allclose(made[:, [1, 3, 4]], [12.0, 12.0, 15.0])
    weak = rows.copy()
    weak[1, 2] = 700.0
    assert ramped(weak, 24.0, plain)[1, 2] == plain.material.deposition.laser_w.min


@pytest.mark.parametrize("fill", ["raster", "spiral"])
def test_ring_laid_in_the_twin_is_as_high_as_its_layer_everywhere_between_its_walls(fill: str) -> None:
    asked = settings_of(fill=fill)
    bead = asked.bead_for(HEIGHT_MM)
    ring = disc(9.5).difference(disc(2.2))
    stock = plate(26.0, 0.25, 2.5)
    before = stock.volume_mm3(-1.0)
    for layer in range(2):
        rings, inside = part_passes(ring, layer * bead.height_mm, layer, bead, asked)
        for step in [*rings, *inside]:
            ends = np.append(step.setpoints[1:, 0], step.tip.length)
            for (at, feed, power, powder, _), end in zip(step.setpoints.tolist(), ends.tolist(), strict=True):
                if power > 0.0:
                    arcs = np.linspace(at, end, max(2, math.ceil((end - at) / 0.5) + 1))
                    tips = step.tip.evaluate(step.tip.at_arc_length(arcs))
                    for a, b in itertools.pairwise(tips):
                        deposit(stock, LAW, a, b, UP, power, powder, float(np.linalg.norm(b - a)) / feed)
    full = inset(ring, edge_mm(bead, asked))
    held = stock.volume_mm3(-1.0) - before
    assert held == pytest.approx(2.0 * full.area * bead.height_mm, rel=0.06)
    places = [(r * np.cos(a), r * np.sin(a)) for r in np.arange(4.0, 8.1, 0.5) for a in np.arange(0.0, 2.0 * np.pi, 0.5)]
    heights = np.array([height(stock, x, y, 2.4) for x, y in places])
    assert heights.mean() == pytest.approx(2.0 * bead.height_mm, rel=0.06)
    assert heights.min() > 1.3 * bead.height_mm  # no groove reaches down to the layer below


@pytest.mark.parametrize("hollow", [False, True])
def test_beads_under_a_finished_face_bring_more_metal_without_lying_double(hollow: bool) -> None:
    part = disc(12.0).difference(disc(4.0)) if hollow else disc(12.0)
    asked = settings_of()
    bead = asked.bead_for(HEIGHT_MM)
    rings, fill = part_passes(part, 0.0, 0, bead, asked, is_top=True)
    books = balance_of(inset(part, edge_mm(bead, asked)), lit_beads([*rings, *fill], asked), bead.height_mm, asked)
    assert 1.15 < books.ratio < 1.4 and books.void_beads == 0.0
    assert books.double_share < 0.03


def test_layers_off_balance_are_one_finding_and_tops_are_not_among_them() -> None:
    books = [LayerBalance(0, 100.0, 101.0, 0.0, 2.0, 0.0), LayerBalance(1, 100.0, 104.0, 0.3, 2.0, 0.0)]
    books.append(LayerBalance(2, 100.0, 125.0, 0.0, 2.0, 0.0, True))
    [line] = books_findings(books, [], settings_of())
    assert "1 layer has more than 2 %" in line and "1.040 times (layer 1" in line and "0.15 bead (layer 1)" in line
    assert books_findings(books[:1], [], settings_of()) == []
