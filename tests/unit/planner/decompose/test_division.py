"""Divisions found without help, and what holds for every one of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from planner.decompose.overhang import hanging_area
from planner.errors import RecipeError
from planner.recipe import Cut, Recipe
from tests.unit.planner.decompose.shapes import angle_deg, disturbed, divided, divided_with, part

NAMES = ["hinge", "double_arc", "tee", "cross", "y_branch", "l_bracket", "branched_tube", "bladed_hub", "table", "two_bodies"]
PIECES = {
    "hinge": 5,
    "double_arc": 3,
    "tee": 2,
    "cross": 5,
    "y_branch": 3,
    "l_bracket": 1,
    "branched_tube": 3,
    "bladed_hub": 7,
    "table": 5,
    "two_bodies": 1,
}


@pytest.mark.parametrize("name", NAMES)
def test_pieces_are_closed_make_up_the_part_and_stand_on_what_is_built_before(name: str) -> None:
    division, mesh = divided(name), part(name)
    pieces = division.pieces
    assert len(pieces) == PIECES[name]
    assert sum(piece.mesh.volume for piece in pieces) == pytest.approx(mesh.volume, rel=1e-6)
    for number, piece in enumerate(pieces):
        assert piece.name == str(number + 1)
        assert piece.mesh.is_closed and piece.joint_mm2 > 1.0
        assert piece.parent == -1 if number == 0 else 0 <= piece.parent < number
        assert angle_deg(piece.direction, pieces[0].direction) <= 100.0
        assert piece.support is None and piece.why
        height = (piece.mesh.vertices - piece.base[:3]) @ piece.direction
        assert height.min() > -1e-3


@pytest.mark.parametrize("name", [name for name in NAMES if name != "double_arc"])
def test_nothing_level_hangs_of_any_piece(name: str) -> None:
    for piece in divided(name).pieces:
        hangs = hanging_area(piece.mesh, piece.direction, piece.base, 85.0)[0]
        assert hangs < 20.0, piece.name  # roofs of bores that are cut from the side, poles that close from their rims


def test_hinge_is_the_five_pieces_of_the_paper() -> None:
    block, *others = divided("hinge").pieces
    assert sorted(np.round(block.mesh.size, 3).tolist()) == [12.0, 24.0, 60.0]
    knuckles, pins = others[:2], others[2:]
    assert all(np.allclose(sorted(knuckle.mesh.size), (12.0, 12.0, 24.0), atol=1e-3) for knuckle in knuckles)
    assert all(np.allclose(sorted(pin.mesh.size), (10.0, 10.0, 16.0), atol=1e-3) for pin in pins)
    assert all(angle_deg(pin.direction, block.direction) == pytest.approx(90.0) for pin in pins)
    assert [piece.parent for piece in others] == [0, 0, 0, 0]


def test_double_arc_is_a_stem_and_two_arms_whose_layers_turn() -> None:
    stem, *arms = divided("double_arc").pieces
    assert stem.path is None
    for arm in arms:
        assert arm.path is not None
        assert angle_deg(arm.path[0, 3:], arm.path[-1, 3:]) > 80.0
    assert arms[0].mesh.volume == pytest.approx(arms[1].mesh.volume, rel=1e-6)


def test_table_on_its_legs_is_built_upside_down() -> None:
    division = divided("table")
    assert np.allclose(division.build_from_part[:3, :3] @ (0.0, 0.0, -1.0), (0.0, 0.0, 1.0))
    assert np.allclose(division.pieces[0].mesh.size, (44.0, 44.0, 5.0), atol=1e-6)


@pytest.mark.parametrize("name", ["leaning_wall", "dome", "spherical_shell", "bent_pipe"])
def test_walls_that_hold_with_the_head_tilted_stay_in_one_piece(name: str) -> None:
    recipe = Recipe(process="deposit", build_direction=(0.0, 0.0, 1.0))
    pieces = divided_with(part(name), recipe).pieces
    assert len(pieces) == 1 and pieces[0].support is None
    assert (pieces[0].path is not None) == (name == "bent_pipe")


@pytest.mark.parametrize(("name", "direction"), [("pipe", (1.0, 0.0, 0.0)), ("bearing", (0.0, 0.0, 1.0))])
def test_parts_of_one_direction_stay_in_one_piece(name: str, direction: tuple[float, float, float]) -> None:
    pieces = divided_with(part(name), Recipe(build_direction=direction)).pieces
    assert len(pieces) == 1 and pieces[0].path is None and pieces[0].support is None


def test_underside_that_no_direction_makes_gets_support() -> None:
    division = divided("mushroom")
    support = [piece.support for piece in division.pieces if piece.support is not None]
    assert len(support) == 1 and support[0].is_closed
    assert support[0].volume < part("mushroom").volume
    assert any("sacrificial" in line for line in division.findings)


def test_same_part_gives_the_same_division_to_the_byte() -> None:
    first, second = divided("hinge"), divided_with(part("hinge"), Recipe(material="316L", process="hybrid"))
    assert [piece.mesh.sha256 for piece in first.pieces] == [piece.mesh.sha256 for piece in second.pieces]
    assert first.candidates == second.candidates and first.findings == second.findings


@pytest.mark.parametrize("name", ["hinge"])
def test_small_change_of_the_mesh_gives_the_same_division(name: str) -> None:
    recipe = Recipe(material="316L", process="hybrid")
    first, second = divided(name), divided_with(disturbed(part(name), 1e-4), recipe)
    assert len(first.pieces) == len(second.pieces)
    for one, other in zip(first.pieces, second.pieces, strict=True):
        assert np.allclose(one.base[3:], other.base[3:], atol=1e-3)
        assert np.allclose(one.base[:3], other.base[:3], atol=0.01)
        assert one.mesh.volume == pytest.approx(other.mesh.volume, rel=1e-3)


def test_candidates_name_what_was_weighed_and_one_is_chosen() -> None:
    candidates = divided("hinge").candidates
    assert sum(candidate.chosen for candidate in candidates) == 1
    chosen = next(candidate for candidate in candidates if candidate.chosen)
    assert chosen.score == min(candidate.score for candidate in candidates)
    assert all(candidate.note and candidate.time_s > 0.0 for candidate in candidates)
    assert any("plate" in candidate.note for candidate in candidates)


def test_never_decomposed_part_is_one_piece() -> None:
    division = divided_with(part("table"), Recipe(decompose="never"))
    assert len(division.pieces) == 1
    assert np.allclose(division.build_from_part[:3, :3] @ (0.0, 0.0, -1.0), (0.0, 0.0, 1.0))


def test_pinned_cuts_are_used_with_their_order() -> None:
    pins = Cut(point_mm=(0.0, 0.0, 16.0), normal=(0.0, 0.0, -1.0), order=2)
    recipe = Recipe(build_direction=(0.0, -1.0, 0.0), cuts=(pins,))
    pieces = divided_with(part("hinge"), recipe).pieces
    assert [round(piece.mesh.volume) for piece in pieces] == [23142, 1256, 1256]
    assert all("recipe" in piece.why[0] for piece in pieces[1:])


@pytest.mark.parametrize(
    ("cut", "words"),
    [
        (Cut(point_mm=(0.0, 0.0, 90.0), normal=(0.0, 0.0, 1.0)), "misses the part"),
        (Cut(point_mm=(0.0, 24.0, 0.0), normal=(0.0, 1.0, 0.0)), "100°"),
        (Cut(point_mm=(0.0, 0.0, 16.0), normal=(0.0, 0.0, -1.0), direction=(1.0, 0.0, 0.0)), "away from the cut"),
        (Cut(point_mm=(0.0, 0.0, 16.0), normal=(0.0, 0.0, -1.0), direction=(0.3, 0.0, -0.9)), "off the cut's normal"),
    ],
)
def test_cut_that_cannot_be_used_is_told_in_one_line(cut: Cut, words: str) -> None:
    with pytest.raises(RecipeError, match=words) as caught:
        divided_with(part("hinge"), Recipe(build_direction=(0.0, -1.0, 0.0), cuts=(cut,)))
    assert "cuts[0]" in caught.value.message and "\n" not in caught.value.message


def test_pinned_cut_whose_point_lies_in_one_bodys_joint_takes_that_body_alone() -> None:
    lean = math.radians(32.2)
    cuts = tuple(
        Cut(point_mm=(side * 4.306, 0.0, 34.921), normal=(side * math.sin(lean), 0.0, math.cos(lean)), order=order)
        for side, order in ((-1, 2), (1, 3))
    )
    stem, left, right = divided_with(part("double_arc"), Recipe(build_direction=(0.0, 0.0, 1.0), cuts=cuts)).pieces
    assert left.mesh.bounds[1, 0] < 1.0 and right.mesh.bounds[0, 0] > -1.0
    assert abs(left.mesh.volume - right.mesh.volume) < 1.0 and stem.mesh.bounds[1, 2] < 38.0
