"""Areas of paper Eq. 1 against figures known beforehand, and what hangs along a direction against its trigonometry."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import trimesh
from shapely import MultiPolygon, Polygon, box

from config import load_material
from planner.decompose.overhang import Holds, hanging_area, overhang, tilted_limit_deg, verdict
from planner.mesh.mesh import Mesh
from planner.slicing.regions import layer_regions
from tests.unit.planner.small_parts import frustum

FACTS = load_material("316L").deposition


def region(*pieces: Polygon) -> MultiPolygon:
    return MultiPolygon(list(pieces))


def disc(radius: float) -> Polygon:
    angle = 2.0 * np.pi * np.arange(256) / 256
    return Polygon(radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def test_cap_on_a_stem_hangs_by_the_ring_between_both_circles() -> None:
    found = overhang(region(disc(10.0)), region(disc(4.0)))
    assert found.overhang.area == pytest.approx(disc(10.0).area - disc(4.0).area, rel=1e-7)
    assert len(found.overhang.geoms) == 1 and len(found.overhang.geoms[0].interiors) == 1
    assert found.overlap.area == pytest.approx(disc(4.0).area, rel=1e-7)
    assert found.unsupported_mm == pytest.approx(6.0, abs=0.02)


def test_lintel_between_two_piers_reaches_half_of_the_gap() -> None:
    piers = region(box(0, 0, 4, 6), box(20, 0, 24, 6))
    found = overhang(region(box(0, 0, 24, 6)), piers)
    assert found.overhang.area == pytest.approx(16 * 6)
    assert found.reach_mm == pytest.approx(8.0, abs=0.3)
    assert found.afloat.is_empty


def test_nearly_equal_outlines_leave_no_slivers() -> None:
    rng = np.random.default_rng(5)
    ring = shapely.get_coordinates(disc(20.0))[:-1]
    other = Polygon(ring + rng.uniform(-5e-5, 5e-5, ring.shape))
    found = overhang(region(Polygon(ring)), region(other))
    assert found.overhang.is_empty and found.unsupported_mm == 0.0


def test_overlap_and_overhang_make_up_the_layer() -> None:
    upper, lower = region(box(0, 0, 10, 10)), region(box(3, -2, 14, 7), box(0, 8, 1, 9))
    found = overhang(upper, lower)
    assert found.overlap.area + found.overhang.area == pytest.approx(100.0, abs=1e-5)
    assert found.overhang.intersection(lower).area < 1e-4


def test_leaning_wall_is_measured_along_its_side_and_judged_by_its_angle() -> None:
    for lean_deg, holds in ((20.0, Holds.UPRIGHT), (60.0, Holds.TILTED), (89.0, Holds.NOT)):
        height = 0.5
        out = height * np.tan(np.radians(lean_deg))
        found = overhang(region(disc(30.0 + out)), region(disc(30.0)), height, region(disc(30.0)))
        assert found.level.is_empty
        assert found.unsupported_mm == pytest.approx(height / np.cos(np.radians(lean_deg)), rel=0.03)
        assert verdict(found, height, FACTS) is holds, lean_deg


def test_piece_that_begins_in_the_air_holds_in_no_way() -> None:
    found = overhang(region(box(0, 0, 5, 5), box(8, 0, 8.4, 0.4)), region(box(0, 0, 5, 5)), 0.5)
    assert found.afloat.area == pytest.approx(0.16)
    assert verdict(found, 0.5, FACTS) is Holds.NOT


def test_layers_of_a_funnel_hang_by_what_their_cone_widens() -> None:
    part = frustum(10.0, 20.0, 10.0)
    layers = layer_regions(part, np.linspace(0.0, 10.0, 11))
    assert layers[0].overhang.is_empty
    share = part.volume / (np.pi * (100 + 200 + 400) / 3 * 10)  # of the polygon's area in its circle's
    for k, layer in enumerate(layers[1:], 1):
        assert layer.overhang_mm2 == pytest.approx(share * np.pi * ((11 + k) ** 2 - (10 + k) ** 2), rel=1e-3)
        assert layer.rests.level.is_empty
        assert layer.unsupported_mm == pytest.approx(np.hypot(1.0, 1.0), rel=0.03)
        assert layer.overlap_mm2 + layer.overhang_mm2 == pytest.approx(layer.region.area, rel=1e-6)


def test_hanging_area_of_a_tilted_box_follows_from_its_angles() -> None:
    body = Mesh.from_trimesh(trimesh.creation.box((10.0, 6.0, 4.0)))
    down = np.radians(25.0)
    directions = np.array([[0.0, 0.0, 1.0], [np.sin(down), 0.0, np.cos(down)]])
    areas = hanging_area(body, directions, None, 45.0)
    assert areas[0] == 0.0
    assert areas[1] == pytest.approx(10 * 6 * np.cos(down), rel=1e-9)
    assert hanging_area(body, directions[1:], None, 70.0)[0] == 0.0
    below = hanging_area(body, directions[:1], [[0.0, 0.0, -3.0, 0.0, 0.0, 1.0]], 45.0)
    assert below[0] == pytest.approx(60.0)


def test_undersides_hang_whatever_the_material_says_about_tilt() -> None:
    body = Mesh.from_trimesh(trimesh.creation.box((10.0, 6.0, 4.0)))
    plane = [[0.0, 0.0, -5.0, 0.0, 0.0, 1.0]]
    assert hanging_area(body, [[0.0, 0.0, 1.0]], plane, 90.0)[0] == pytest.approx(60.0)
    assert tilted_limit_deg(FACTS) < 90.0
