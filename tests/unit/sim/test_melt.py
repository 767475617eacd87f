"""The bead, the twin's and the planner's: conservation of mass, limits, directions of every influence, and that the two agree."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from config import Material, Tool, load_cell, load_material
from sim.process.jet import jet_radius_mm, share_in_pool
from sim.process.melt import NO_BEAD, STEEPEST, bead_at, bead_section, catch_at, melt_law, pool_at

MATERIALS = ("316L", "inconel718", "ti6al4v")
HEAD: Tool = next(tool for tool in load_cell("trunnion_tcp").tools if tool.kind == "deposition")
LAWS = {name: melt_law(load_material(name), HEAD) for name in MATERIALS}
COLD_K = 293.0


def usual(material: Material) -> tuple[float, float, float]:
    window = material.deposition
    return window.laser_w.usual, window.powder_g_min.usual, window.speed_mm_s.usual


@pytest.mark.parametrize("name", MATERIALS)
@given(power=st.floats(600.0, 2000.0), powder=st.floats(1.0, 30.0), speed=st.floats(3.0, 30.0))
def test_caught_powder_is_the_metal_of_the_bead(name: str, power: float, powder: float, speed: float) -> None:
    material = load_material(name)
    bead = bead_section(material, power, powder, speed)
    caught_g_per_s = material.bead.catch_efficiency * powder / 60.0
    assert bead.area_mm2 * speed * material.density_g_mm3 == pytest.approx(caught_g_per_s)
    assert 2.0 / 3.0 * bead.width_mm * bead.height_mm == pytest.approx(bead.area_mm2)  # area under a parabola


@pytest.mark.parametrize("name", MATERIALS)
def test_usual_bead_fits_the_layer_that_the_material_file_states(name: str) -> None:
    material = load_material(name)
    window = material.deposition
    bead = bead_section(material, window.laser_w.usual, window.powder_g_min.usual, window.speed_mm_s.usual)
    layer = bead.area_mm2 / (material.bead.step_over * bead.width_mm)
    assert 1.0 < bead.width_mm < 4.0
    assert window.layer_height_mm.min <= layer <= 1.3 * window.layer_height_mm.max


def test_more_power_widens_and_more_speed_narrows_the_bead() -> None:
    material = load_material("316L")
    usual = bead_section(material, 1200.0, 12.0, 12.0)
    assert (
        bead_section(material, 1500.0, 12.0, 12.0).width_mm
        > usual.width_mm
        > bead_section(material, 1200.0, 12.0, 15.0).width_mm
    )


def test_below_its_least_power_and_at_standstill_nothing_is_laid_down() -> None:
    material = load_material("316L")
    assert bead_section(material, material.bead.min_power_w - 1.0, 12.0, 12.0) == NO_BEAD
    assert bead_section(material, 1200.0, 12.0, 0.0) == NO_BEAD


def test_laser_without_powder_melts_but_adds_nothing() -> None:
    bead = bead_section(load_material("316L"), 1200.0, 0.0, 12.0)
    assert bead.area_mm2 == bead.height_mm == 0.0
    assert bead.width_mm > 1.0


@pytest.mark.parametrize("name", MATERIALS)
@given(
    power=st.floats(100.0, 3000.0),
    powder=st.floats(0.0, 40.0),
    speed=st.floats(1.0, 40.0),
    defocus=st.floats(-8.0, 8.0),
    cosine=st.floats(0.05, 1.0),
    base=st.floats(280.0, 900.0),
)
def test_the_twins_bead_is_the_powder_that_its_pool_caught(
    name: str, power: float, powder: float, speed: float, defocus: float, cosine: float, base: float
) -> None:
    material, law = load_material(name), LAWS[name]
    width, height, area, depth = bead_at(law, power, powder, speed, defocus, cosine, base)
    pool, bare_depth = pool_at(law, power, speed, defocus, cosine, base)
    caught_g_per_s = catch_at(law, pool, defocus, cosine) * powder / 60.0
    assert area * speed * material.density_g_mm3 == pytest.approx(caught_g_per_s, rel=1e-9, abs=1e-12)
    assert 2.0 / 3.0 * width * height == pytest.approx(area, rel=1e-9, abs=1e-12)
    assert width >= pool and area <= STEEPEST * width * width * (1.0 + 1e-9)
    assert 0.0 <= depth <= bare_depth


@pytest.mark.parametrize("name", MATERIALS)
def test_at_the_usual_set_points_twin_and_planner_agree(name: str) -> None:
    material = load_material(name)
    power, powder, speed = usual(material)
    planned = bead_section(material, power, powder, speed)
    width, height, area, depth = bead_at(LAWS[name], power, powder, speed, 0.0, 1.0, COLD_K)
    assert (width, height, area) == pytest.approx((planned.width_mm, planned.height_mm, planned.area_mm2), rel=0.03)
    assert depth > 0.05  # it is welded to what lies below


@pytest.mark.parametrize("name", MATERIALS)
def test_over_the_window_twin_and_planner_agree(name: str) -> None:
    material, law = load_material(name), LAWS[name]
    window = material.deposition
    for power in (window.laser_w.min, window.laser_w.usual, window.laser_w.max):
        for speed in (window.speed_mm_s.min, window.speed_mm_s.usual, window.speed_mm_s.max):
            planned = bead_section(material, power, window.powder_g_min.min, speed)
            width, _, area, _ = bead_at(law, power, window.powder_g_min.min, speed, 0.0, 1.0, COLD_K)
            assert width == pytest.approx(planned.width_mm, rel=0.10), (power, speed)
            assert area == pytest.approx(planned.area_mm2, rel=0.10), (power, speed)


@pytest.mark.parametrize("name", MATERIALS)
def test_the_planners_least_power_is_where_the_twin_begins_to_melt(name: str) -> None:
    material = load_material(name)
    _, powder, speed = usual(material)
    least = material.bead.min_power_w
    assert bead_at(LAWS[name], least, powder, speed, 0.0, 1.0, COLD_K)[0] > 0.0
    assert bead_at(LAWS[name], 0.75 * least, powder, speed, 0.0, 1.0, COLD_K) == (0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("name", MATERIALS)
def test_more_power_slower_motion_and_a_warmer_part_widen_and_deepen_the_pool(name: str) -> None:
    law = LAWS[name]
    power, _, speed = usual(load_material(name))
    by_power = [pool_at(law, power * f, speed, 0.0, 1.0, COLD_K) for f in (0.5, 0.8, 1.0, 1.5, 2.0)]
    by_speed = [pool_at(law, power, speed / f, 0.0, 1.0, COLD_K) for f in (0.5, 0.8, 1.0, 1.5, 3.0)]
    by_base = [pool_at(law, power, speed, 0.0, 1.0, base) for base in (293.0, 350.0, 450.0, 600.0, 900.0)]
    for series in (by_power, by_speed, by_base):
        assert all(a[0] < b[0] and a[1] < b[1] for a, b in pairwise(series))
    assert by_base[2][0] < 1.06 * by_base[0][0]  # a part at 180 degC: a few per cent


@pytest.mark.parametrize("name", MATERIALS)
def test_off_focus_and_off_axis_less_metal_is_laid_down(name: str) -> None:
    law = LAWS[name]
    power, powder, speed = usual(load_material(name))
    off_focus = [
        bead_at(law, power, powder, speed, defocus, 1.0, COLD_K)[2] for defocus in (0.0, 1.0, 2.0, 4.0, 8.0, 12.0)
    ]
    off_axis = [bead_at(law, power, powder, speed, 0.0, cosine, COLD_K)[2] for cosine in (1.0, 0.9, 0.7, 0.5, 0.2)]
    assert (
        off_focus == sorted(off_focus, reverse=True)
        and off_focus[3] < 0.9 * off_focus[0]
        and off_focus[-1] < 0.3 * off_focus[0]
    )
    assert off_axis == sorted(off_axis, reverse=True) and off_axis[-1] < 0.9 * off_axis[0]
    assert bead_at(law, power, powder, speed, -4.0, 1.0, COLD_K)[2] == off_focus[3]


def test_what_does_not_melt_leaves_nothing() -> None:
    law, nothing = LAWS["316L"], (0.0, 0.0, 0.0, 0.0)
    assert bead_at(law, 0.0, 12.0, 12.0, 0.0, 1.0, COLD_K) == nothing
    assert bead_at(law, 150.0, 12.0, 12.0, 0.0, 1.0, COLD_K) == nothing
    assert bead_at(law, 1200.0, 12.0, 0.0, 0.0, 1.0, COLD_K) == nothing
    assert bead_at(law, 1200.0, 12.0, 12.0, 0.0, -0.3, COLD_K) == nothing
    assert bead_at(law, 1200.0, 12.0, 12.0, 300.0, 1.0, COLD_K) == nothing  # the spot is as large as a plate


def test_without_powder_the_track_is_melted_and_no_metal_is_added() -> None:
    width, height, area, depth = bead_at(LAWS["316L"], 1200.0, 0.0, 12.0, 0.0, 1.0, COLD_K)
    assert height == area == 0.0
    assert width > 1.0 and depth == pool_at(LAWS["316L"], 1200.0, 12.0, 0.0, 1.0, COLD_K)[1]


def test_more_metal_than_a_half_round_holds_wets_beyond_the_pool() -> None:
    law = LAWS["316L"]
    pool, _ = pool_at(law, 800.0, 3.0, 0.0, 1.0, COLD_K)
    width, height, area, _ = bead_at(law, 800.0, 40.0, 3.0, 0.0, 1.0, COLD_K)
    assert width > pool and area == pytest.approx(STEEPEST * width * width)
    assert height / width == pytest.approx(1.5 * STEEPEST)


def test_the_catch_is_the_jets_share_in_the_pool_that_sticks() -> None:
    law = LAWS["316L"]
    radius = jet_radius_mm(law.jet_mm, law.jet_tan, 3.0)
    assert catch_at(law, 2.0, 3.0, 0.8) == law.sticking * share_in_pool(2.0, radius, 0.8)


@pytest.mark.parametrize("name", MATERIALS)
def test_every_figure_of_metal_and_head_has_its_source(name: str) -> None:
    material = load_material(name)
    wanted = [f"thermal.{field}" for field in type(material.thermal).model_fields]
    wanted += [f"head.{field}" for field in type(material.head).model_fields] + [
        "part_heat",
        "bead",
        "deposition",
        "milling",
        "density_g_mm3",
    ]
    assert [field for field in wanted if not material.source.get(field, "").strip()] == []
