"""Recipes: validated, completed from the material, refused with one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from planner.errors import RecipeError
from planner.process import Settings
from planner.recipe import Recipe, load_recipe, parse_recipe

ROOT = Path(__file__).resolve().parents[3]


def test_shipped_recipe_of_the_pipe_is_valid_and_builds_along_x() -> None:
    recipe = load_recipe(ROOT / "config" / "parts" / "pipe.toml")
    assert recipe.build_direction == (1.0, 0.0, 0.0)
    assert Settings.from_recipe(recipe).is_milled


def test_empty_recipe_takes_everything_from_the_material() -> None:
    settings = Settings.from_recipe(parse_recipe(""))
    facts = settings.material.deposition
    assert (settings.layer_min_mm, settings.layer_max_mm) == (facts.layer_height_mm.min, facts.layer_height_mm.max)
    assert settings.allowance_mm == facts.stock_allowance_mm
    assert settings.overbuild == facts.overbuild
    assert settings.cutter_diameter_mm == settings.material.milling.cutter_diameter_mm


def test_deposit_process_has_no_stock_allowance() -> None:
    assert Settings.from_recipe(Recipe(process="deposit", stock_allowance_mm=0.5)).allowance_mm == 0.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("layer_height_mm = 2.0", ["layer_height_mm", "2 mm", "0.3", "1 mm"]),
        ("speed_mm_s = 99.0", ["speed_mm_s", "99", "20 mm/s"]),
        ("laser_w = 10.0", ["laser_w", "10 W", "600"]),
        ("powder_g_min = 100.0", ["powder_g_min", "100", "20 g/min"]),
        ("mill_every_mm = 30.0", ["mill_every_mm", "30 mm", "3 mm"]),
        ("step_over = 0.05", ["step_over", "0.05", "0.3"]),
        ('material = "unobtainium"', ["material", "unobtainium"]),
        ("layer_height = 1.0", ["layer_height", "unknown key"]),
        ("tolerance_mm = -1.0", ["tolerance_mm"]),
        ("tolerance_mm = nan", ["tolerance_mm"]),
        ("process = 'print'", ["process"]),
        ("schema_version = 2", ["schema_version"]),
        ("contours = [", ["not TOML"]),
    ],
)
def test_bad_recipe_is_refused_with_one_line_that_names_field_and_bound(text: str, words: list[str]) -> None:
    with pytest.raises(RecipeError) as caught:
        Settings.from_recipe(parse_recipe(text))
    assert "\n" not in caught.value.message
    for word in words:
        assert word in caught.value.message


def test_absent_recipe_file_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(RecipeError, match=r"none\.toml"):
        load_recipe(tmp_path / "none.toml")


@pytest.mark.parametrize("height", [0.3, 0.5, 0.8, 1.0])
def test_bead_carries_the_powder_that_its_area_needs_and_fills_the_layer_with_overbuild(height: float) -> None:
    settings = Settings.from_recipe(Recipe())
    bead, law, facts = settings.bead_for(height), settings.material.bead, settings.material.deposition
    assert bead.height_mm == pytest.approx(height * (1.0 + settings.overbuild), rel=1e-9)
    caught_mm3_s = law.catch_efficiency * bead.powder_g_min / 60.0 / settings.material.density_g_mm3
    assert bead.area_mm2 * bead.speed_mm_s == pytest.approx(caught_mm3_s, rel=1e-12)
    assert facts.speed_mm_s.min <= bead.speed_mm_s <= facts.speed_mm_s.max
    assert facts.powder_g_min.min <= bead.powder_g_min <= facts.powder_g_min.max
    assert facts.laser_w.min <= bead.laser_w <= facts.laser_w.max


def test_what_the_recipe_fixes_stays_and_the_rest_adapts() -> None:
    bead = Settings.from_recipe(Recipe(speed_mm_s=10.0)).bead_for(0.6)
    assert bead.speed_mm_s == 10.0
    assert bead.height_mm == pytest.approx(0.6 * 1.08, rel=1e-9)


def test_layer_that_no_bead_fills_is_refused() -> None:
    settings = Settings.from_recipe(Recipe(speed_mm_s=20.0, powder_g_min=4.0, laser_w=2000.0))
    with pytest.raises(RecipeError, match="fill at most"):
        settings.bead_for(1.0)


def test_bead_that_cannot_be_low_enough_is_the_nearest_one() -> None:
    settings = Settings.from_recipe(Recipe(speed_mm_s=6.0, powder_g_min=20.0))
    bead = settings.bead_for(0.3)
    assert bead.laser_w == settings.material.deposition.laser_w.max
    assert bead.height_mm > 0.3 * 1.08


CUT = "[[cuts]]\npoint_mm = [0.0, 0.0, 1.0]\nnormal = [0.0, 0.0, 1.0]\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (CUT.replace("normal = [0.0, 0.0, 1.0]", "normal = [0.0, 0.0, 0.0]"), ["normal", "length"]),
        (CUT + "direction = [0.0, 0.0, 0.0]\n", ["direction", "length"]),
        ('decompose = "never"\n' + CUT, ["cuts", "decompose"]),
        ('process = "mill"\n' + CUT, ["cuts", "milled"]),
        ((CUT + "order = 2\n") * 2, ["cuts", "same order"]),
        (CUT + "order = 1\n", ["order", "2"]),
    ],
)
def test_cuts_that_cannot_be_are_refused_with_one_line(text: str, words: list[str]) -> None:
    with pytest.raises(RecipeError) as refused:
        parse_recipe(text)
    assert "\n" not in str(refused.value)
    assert all(word in str(refused.value) for word in words)


def test_cuts_are_taken_as_they_are_given() -> None:
    (cut,) = parse_recipe(CUT + "direction = [0.0, 1.0, 1.0]\norder = 3\n").cuts
    assert (cut.point_mm, cut.normal, cut.direction, cut.order) == ((0, 0, 1), (0, 0, 1), (0, 1, 1), 3)
