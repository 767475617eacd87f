"""Several pieces in one plan: numbered through, each clear of what stands, joined without a step, the same every time."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import planner.pipeline
from planner.collide.reach import HeadShape, PointTree, reach, surface_points
from planner.compose.lean import CLEARANCE_MM
from planner.compose.plate import on_plate
from planner.compose.setups import setups_of, turn_in_words
from planner.compose.standing import Standing
from planner.decompose.pieces import Division, Piece
from planner.errors import RecipeError
from planner.files.plan_file import plan_bytes
from planner.mesh.mesh import Mesh
from planner.plan import Pass, Plan, Process, Skeleton
from planner.process import Settings
from planner.recipe import Recipe
from planner.toolpath.motion import axis_at
from planner.toolpath.roughing import box_mesh
from tests.unit.planner.small_parts import points_of

Floats = np.ndarray
RECIPE = Recipe(layer_height_mm=0.8, small_cutter_diameter_mm=4.0, shift_mm=(0.0, 0.0), substrate_mm=(24.0, 24.0))
SETTINGS = Settings.from_recipe(RECIPE)
UP = (0.0, 0.0, 1.0)
NOTHING = Skeleton(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 2), dtype=np.int64))


def cuboid(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    return box_mesh(np.array(low), np.array(high))


def piece(name: str, mesh: Mesh, parent: int, point: tuple[float, float, float], direction: tuple[float, float, float]) -> Piece:
    base = np.array([*point, *direction])
    return Piece(name, mesh, parent, base, 1.0, np.array([base[:3], base[:3] + base[3:]]))


WALL = piece("1", cuboid((-6, -6, 0), (6, 6, 16)), -1, (0, 0, 0), UP)
ARM = piece("2", cuboid((6, -6, 12), (9.2, 6, 16)), 0, (6, 0, 14), (1.0, 0.0, 0.0))  # flush with three of the wall's faces
TOWER = piece("3", cuboid((-6, -6, 16), (-2, 6, 17.6)), 0, (-4, 0, 16), UP)


def divided(*pieces: Piece) -> Division:
    return Division(np.eye(4), pieces, NOTHING)


def plan_of(monkeypatch: pytest.MonkeyPatch, division: Division, recipe: Recipe = RECIPE) -> Plan:
    monkeypatch.setattr(planner.pipeline, "divide", lambda mesh, recipe, settings: division)
    whole = Mesh(
        np.vstack([p.mesh.vertices for p in division.pieces]),
        np.vstack([p.mesh.facets + 8 * k for k, p in enumerate(division.pieces)]),
    )
    return planner.pipeline.plan(whole, recipe)


@pytest.fixture(scope="module")
def made() -> Plan:
    with pytest.MonkeyPatch.context() as patch:
        return plan_of(patch, divided(WALL, ARM, TOWER))


def steps(made: Plan, number: int, *, cuts: bool) -> list[tuple[float, Pass]]:
    """Working passes of a subcomponent, each with its cutter's radius."""
    first, last = made.subcomponents[number].layers
    return [
        (0.5 * operation.cutter_diameter_mm, step)
        for layer in made.layers[first:last]
        for operation in layer.operations
        if operation.process.is_deposit is not cuts
        for step in operation.passes
        if not step.is_link
    ]


def test_layers_are_numbered_through_and_belong_to_their_pieces(made: Plan) -> None:
    assert [layer.index for layer in made.layers] == list(range(len(made.layers)))
    assert [sub.layers for sub in made.subcomponents] == [(0, 20), (20, 24), (24, 26)]
    assert [layer.subcomponent for layer in made.layers] == [0] * 20 + [1] * 4 + [2] * 2
    for layer in made.layers:
        assert all(operation.layer == layer.index for operation in layer.operations)
    assert [sub.parent for sub in made.subcomponents] == [-1, 0, 0]
    assert sum(sub.volume_mm3 for sub in made.subcomponents) == pytest.approx(made.volumes_mm3["part"])


def test_a_piece_grows_from_its_base_in_its_direction(made: Plan) -> None:
    arm = made.layers[20:24]
    for k, layer in enumerate(arm):
        assert layer.bottom == pytest.approx([6.0 + 0.8 * k, 0.0, 14.0, 1.0, 0.0, 0.0], abs=1e-9)
        for contour in layer.contours:
            assert contour.curve.evaluate([0.0, 0.3])[:, 0] == pytest.approx(6.0 + 0.8 * k, abs=1e-6)
    for _, step in steps(made, 1, cuts=True):
        assert axis_at(step.axis, step.tip.domain[0]) == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)


def test_a_piece_is_milled_before_the_next_begins(made: Plan) -> None:
    for sub in made.subcomponents:
        last = [operation.process for operation in made.layers[sub.layers[1] - 1].operations]
        assert last[-1] is Process.MILL_SIDE and Process.MILL_FACE in last


def test_no_cutter_enters_what_stands(made: Plan) -> None:
    low, high = WALL.mesh.bounds
    for number in (1, 2):
        for radius, step in steps(made, number, cuts=True):
            tips = points_of(step)
            axis = axis_at(step.axis, step.tip.domain[0])
            turn = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
            across = np.linalg.svd(axis[None, :])[2][1:]
            rim = (np.cos(turn)[:, None] * across[0] + np.sin(turn)[:, None] * across[1]) * (radius - 0.05)
            for up in (0.05, 2.0, 8.0):
                cutter = (tips[:, None, :] + rim[None, :, :] + up * axis).reshape(-1, 3)
                assert not ((cutter > low + 0.03) & (cutter < high - 0.03)).all(axis=1).any()


def test_the_wall_of_a_flush_joint_is_milled_on_into_the_parent_s(made: Plan) -> None:
    tips = np.vstack([points_of(step) for _, step in steps(made, 1, cuts=True)])
    beside = np.abs(tips[:, 1]) > 7.5
    assert tips[beside, 0].min() < 6.0 - 0.5
    assert tips[tips[:, 2] < 10.5, 0].min() > 6.0 - 1e-6  # on the lower side the parent's face goes on


def test_plans_of_several_pieces_are_the_same_every_time(monkeypatch: pytest.MonkeyPatch) -> None:
    division = divided(WALL, TOWER)
    first, second = (plan_bytes(plan_of(monkeypatch, division)) for _ in range(2))
    assert first == second


def test_layers_are_handed_out_in_order_as_they_stand_in_the_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planner.pipeline, "divide", lambda mesh, recipe, settings: divided(TOWER_ALONE, TOWER_ABOVE))
    handed: list[object] = []
    made = planner.pipeline.plan(TOWER_ALONE.mesh, RECIPE, on_layer=handed.append)
    assert handed == list(made.layers)


TOWER_ALONE = piece("1", cuboid((-4, -4, 0), (4, 4, 1.6)), -1, (0, 0, 0), UP)
TOWER_ABOVE = piece("2", cuboid((-3, -3, 1.6), (3, 3, 3.2)), 0, (0, 0, 1.6), UP)


@pytest.mark.parametrize(
    ("direction", "words"),
    [
        (UP, "as clamped"),
        ((0.0, -1.0, 0.0), "-90° about X"),
        ((0.0, 1.0, 0.0), "90° about X"),
        ((1.0, 0.0, 0.0), "-90° about Y"),
        ((0.0, 0.0, -1.0), "180° about Y"),
        ((0.0, np.sin(0.5), np.cos(0.5)), "29° about X"),
        ((np.sqrt(0.5), np.sqrt(0.5), 0.0), "90° about (0.71, -0.71, 0)"),
    ],
)
def test_a_set_up_says_how_the_part_is_turned(direction: tuple[float, float, float], words: str) -> None:
    assert turn_in_words(np.array(direction)) == words


def test_pieces_that_follow_in_one_direction_share_a_set_up() -> None:
    ways = [np.array(way) for way in (UP, UP, (1.0, 0.0, 0.0), UP)]
    setups, number = setups_of(ways)
    assert [setup.subcomponents for setup in setups] == [(0, 1), (2,), (3,)]
    assert number == [0, 0, 1, 2]


def test_what_stands_is_seen_from_the_piece() -> None:
    standing = Standing.before((WALL, ARM), 1, (120.0, 120.0))
    walls = 120.0 * 10.0 + 240.0 * 10.0  # plate and table are walls beside the arm
    assert walls <= standing.shadow(0.0).area <= walls + 2.0 * 10.0  # the table's round, with room for a holder at its rim
    free = Standing.before((WALL, TOWER), 1, (120.0, 120.0))
    assert free.shadow(0.0).is_empty and free.keep_out(0.0, SETTINGS).is_empty
    assert free.shadow(-4.0).area == pytest.approx(144.0)
    assert free.keep_out(-4.0, SETTINGS).area == pytest.approx(144.0 + 48.0 * 3.98 + np.pi * 3.98**2, rel=1e-3)
    assert free.height_over(shapely.MultiPolygon([shapely.box(-1, -1, 1, 1)]), 1.0) == 0.0
    under = free.layers_under(1.2, 0.8)
    assert [layer.z_top for layer in under] == pytest.approx([-0.8, 0.0])
    assert under[0].region.area == pytest.approx(144.0)


def test_the_head_leans_away_from_a_wall_beside_it_and_stands_upright_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    low = piece("1", cuboid((-12, -5, 0), (6, 5, 1.6)), -1, (0, 0, 0), UP)
    wall = piece("2", cuboid((-12, -5, 1.6), (-6, 5, 40)), 0, (-9, 0, 1.6), UP)
    beside = piece("3", cuboid((-1, -5, 1.6), (6, 5, 3.2)), 0, (2, 0, 1.6), UP)
    recipe = RECIPE.model_copy(update={"layer_height_mm": 1.6, "process": "deposit", "laser_w": None})
    standing = Standing.before((low, wall, beside), 2, (120.0, 120.0))
    upright = reach([[-0.2, 0.0, 0.1]], [UP], standing.tree, None, HeadShape())
    assert upright.clearance_mm[0] < 0.0
    made = plan_of(monkeypatch, divided(low, wall, beside), recipe.model_copy(update={"layer_height_mm": 0.8}))
    tree = PointTree.over(surface_points(wall.mesh, 1.0))
    for _, step in steps(made, 2, cuts=False):
        u = np.linspace(*step.tip.domain, 9)
        found = reach(step.tip.evaluate(u), np.tile(axis_at(step.axis, u[0]), (9, 1)), tree, None, HeadShape())
        assert found.clearance_mm.min() > 0.5 * CLEARANCE_MM
    assert any("the head leans" in line for line in made.findings)
    for _, step in steps(made, 1, cuts=False):
        assert axis_at(step.axis, step.tip.domain[0]) == pytest.approx(UP)


def test_a_part_with_a_sideways_piece_stands_at_that_edge_in_the_corner_of_its_plate() -> None:
    division = divided(WALL, ARM)
    moved, told = on_plate(division, Recipe())
    assert moved.pieces[0].mesh.bounds[1, 0] == pytest.approx(57.0)
    assert moved.pieces[0].mesh.bounds[1, 1] == pytest.approx(57.0)
    assert moved.pieces[1].base[:3] == pytest.approx([57.0, 51.0, 14.0])
    assert moved.build_from_part[:3, 3] == pytest.approx([51.0, 51.0, 0.0])
    assert len(told) == 1
    same, nothing = on_plate(divided(WALL, TOWER), Recipe())
    assert same.pieces[0] is WALL and not nothing
    other = piece("3", cuboid((-9.2, -6, 12), (-6, 6, 16)), 0, (-6, 0, 14), (-1.0, 0.0, 0.0))
    both, nothing = on_plate(divided(WALL, ARM, other), Recipe())
    assert both.pieces[0] is WALL and not nothing


def test_pieces_over_two_edges_take_the_part_to_the_corner_between_them() -> None:
    small = piece("3", cuboid((-2, -8, 12), (2, -6, 14)), 0, (0, -6, 13), (0.0, -1.0, 0.0))
    moved, _ = on_plate(divided(WALL, ARM, small), Recipe())
    assert moved.pieces[0].mesh.bounds[1, 0] == pytest.approx(57.0)
    assert moved.pieces[0].mesh.bounds[0, 1] == pytest.approx(-57.0)


def test_a_shift_off_the_plate_is_refused() -> None:
    with pytest.raises(RecipeError, match="shift_mm"):
        on_plate(divided(WALL), Recipe(shift_mm=(58.0, 0.0)))
