"""Planning as a whole: frames, determinism, volumes, directions, refusals."""

from __future__ import annotations

import inspect
from pathlib import Path

import numpy as np
import pytest

import planner
from planner.decompose.direction import best_direction
from planner.errors import PlanningError, RecipeError
from planner.files.plan_file import plan_bytes
from planner.mesh import load_checked
from planner.mesh.mesh import Mesh
from planner.nurbs.ruled import RuledSurface
from planner.pipeline import plan
from planner.plan import Plan, Process
from planner.recipe import Recipe, load_recipe
from planner.toolpath.pattern import TOP_DENSER
from planner.toolpath.tops import TOP_RESERVE
from tests.unit.planner.small_parts import box, frustum, tube

PARTS = Path(__file__).resolve().parents[3] / "config" / "parts"
QUICK = Recipe(layer_height_mm=0.8, build_direction=(0.0, 0.0, 1.0))


@pytest.fixture(scope="module")
def pipe() -> Plan:
    return plan(load_checked(PARTS / "pipe.stl"), load_recipe(PARTS / "pipe.toml"), part_name="pipe")


def test_pipe_lies_down_with_x_up_and_its_base_at_zero(pipe: Plan) -> None:
    turn = pipe.build_from_part[:3, :3]
    assert np.allclose(turn @ [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    assert np.allclose(turn @ turn.T, np.eye(3)) and np.linalg.det(turn) == pytest.approx(1.0)
    assert np.allclose(pipe.bounds, [[-23.0, -23.0, 0.0], [23.0, 23.0, 11.0]], atol=1e-4)


def test_pipe_is_spirals_and_milled_in_an_order_that_builds_it(pipe: Plan) -> None:
    assert {operation.process for operation in pipe.operations} == {Process.DEPOSIT_CONTOUR, Process.MILL_FACE, Process.MILL_SIDE}
    assert [op.layer for op in pipe.operations] == sorted(op.layer for op in pipe.operations)
    last = [operation.process for operation in pipe.layers[-1].operations]
    assert last[-2:] == [Process.MILL_FACE, Process.MILL_SIDE]
    for layer in pipe.layers:
        milling = [not operation.process.is_deposit for operation in layer.operations]
        assert milling == sorted(milling)


def test_contours_of_the_pipe_follow_its_section_within_microns(pipe: Plan) -> None:
    for layer in pipe.layers:
        assert [contour.is_hole for contour in layer.contours].count(True) == 1
        for contour in layer.contours:
            assert contour.deviation_mm < 0.01
            radii = np.linalg.norm(contour.curve.evaluate(np.linspace(0, 1, 400))[:, :2], axis=1)
            assert np.abs(radii - (17.0 if contour.is_hole else 23.0)).max() < 0.01


def test_walls_join_bottom_and_top_of_every_layer(pipe: Plan) -> None:
    for layer in pipe.layers:
        assert len(layer.walls) == len(layer.contours)
        for wall in layer.walls:
            surface = RuledSurface(wall.bottom, wall.top)
            assert np.allclose(surface.evaluate([0.1, 0.6], 0.0)[:, 2], layer.bottom[2])
            assert np.allclose(surface.evaluate([0.1, 0.6], 1.0)[:, 2], layer.top[2])


def test_volumes_add_up(pipe: Plan) -> None:
    volumes = pipe.volumes_mm3
    assert volumes["part"] == pytest.approx(8292.12, abs=0.1)
    below = np.pi * (23.6**2 - 16.4**2) * 11.0 * 13.0 / 14.0 * 1.08
    last = next(o for o in pipe.layers[-1].operations if o.process.is_deposit)
    edge = 0.5 * 0.62 * (1.0 - 1.0 / TOP_DENSER) * last.bead_width_mm  # denser beads' edge of full height lies so much farther inside
    top = np.pi * ((23.6 - edge) ** 2 - (16.4 + edge) ** 2) * 11.0 / 14.0 * (1.08 + TOP_RESERVE) * TOP_DENSER
    assert volumes["deposited"] == pytest.approx(below + top, rel=6e-3)
    assert volumes["milled"] == pytest.approx(volumes["deposited"] - volumes["part"])


def test_same_mesh_and_recipe_give_the_same_bytes() -> None:
    mesh = frustum(12.0, 11.0, 2.4, sections=40)
    assert plan_bytes(plan(mesh, QUICK)) == plan_bytes(plan(mesh, QUICK))


def test_plan_does_not_depend_on_where_the_part_lies() -> None:
    mesh = tube(8.0, 13.0, 1.6)
    moved = mesh.transformed([[1, 0, 0, 64.0], [0, 1, 0, -32.0], [0, 0, 1, 16.0], [0, 0, 0, 1]])
    first, second = plan(mesh, QUICK), plan(moved, QUICK)
    assert [op.process for op in first.operations] == [op.process for op in second.operations]
    lengths = [sum(step.tip.length for op in p.operations for step in op.passes if not step.is_link) for p in (first, second)]
    assert lengths[0] == pytest.approx(lengths[1], rel=0.02)
    assert first.volumes_mm3 == pytest.approx(second.volumes_mm3, rel=5e-4)  # links between rounds begin at the nearest of sampled points


def test_progress_names_the_stages_and_never_goes_back() -> None:
    told: list[tuple[str, float]] = []
    plan(box(12.0, 12.0, 1.6), QUICK, progress=lambda stage, share: told.append((stage, share)))
    assert [share for _, share in told] == sorted(share for _, share in told)
    assert told[-1] == ("done", 1.0)
    assert {"orient", "layers", "sections", "contours", "toolpaths"} <= {stage for stage, _ in told}


def test_findings_of_the_mesh_are_carried_into_the_plan() -> None:
    loaded = load_checked(PARTS / "pipe.stl")
    assert plan(loaded.mesh, QUICK.model_copy(update={"build_direction": (1.0, 0.0, 0.0)}), findings=["seen"]).findings[0] == "seen"


def test_automatic_direction_lays_a_tilted_plate_flat() -> None:
    tilt = np.eye(4)
    c, s = np.cos(0.4), np.sin(0.4)
    tilt[:3, :3] = [[1, 0, 0], [0, c, -s], [0, s, c]]
    direction, findings = best_direction(box(40.0, 30.0, 3.0).transformed(tilt))
    assert abs(direction @ (tilt[:3, :3] @ [0.0, 0.0, 1.0])) == pytest.approx(1.0, abs=1e-6)
    assert len(findings) == 1


def test_automatic_direction_stands_a_frustum_on_its_broad_end() -> None:
    assert np.allclose(best_direction(frustum(20.0, 10.0, 8.0))[0], [0.0, 0.0, 1.0])
    turned = frustum(10.0, 20.0, 8.0)
    assert np.allclose(best_direction(turned)[0], [0.0, 0.0, -1.0])


def test_leaning_layers_are_as_wide_as_their_widest_section() -> None:
    made = plan(frustum(14.0, 12.0, 1.6, sections=180), QUICK)
    for layer in made.layers:
        widest = 14.0 - 2.0 / 1.6 * layer.bottom[2]
        radii = np.linalg.norm(layer.contours[0].curve.evaluate(np.linspace(0, 1, 100))[:, :2], axis=1)
        assert np.abs(radii - widest).max() < 0.005
        assert np.allclose(layer.contours[0].curve.evaluate([0.3])[:, 2], layer.bottom[2])


def test_walls_too_thin_for_any_bead_are_refused() -> None:
    with pytest.raises(PlanningError, match="thinner than"):
        plan(tube(9.7, 10.0, 1.6), QUICK.model_copy(update={"process": "deposit"}))


def test_direction_without_length_is_refused() -> None:
    with pytest.raises(RecipeError, match="build_direction"):
        plan(box(5.0, 5.0, 5.0), Recipe(build_direction=(0.0, 0.0, 0.0)))


def test_bodies_with_air_between_them_in_height_are_refused() -> None:
    low, high = box(10.0, 10.0, 2.0), box(10.0, 10.0, 2.0).transformed(np.array(
        [[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 8.0], [0, 0, 0, 1]]))  # fmt: skip
    both = Mesh(np.vstack([low.vertices, high.vertices]), np.vstack([low.facets, high.facets + len(low.vertices)]))
    with pytest.raises(PlanningError, match="nothing of the part"):
        plan(both, QUICK)


def test_a_small_change_of_the_mesh_is_a_small_change_of_the_plan() -> None:
    mesh = frustum(12.0, 11.0, 2.4, sections=40)
    along = np.random.default_rng(5).uniform(-1e-4, 1e-4, mesh.vertices.shape) * (1.0, 1.0, 0.0)
    shaken = Mesh(mesh.vertices * (1.0, 1.0, 1.0 + 5e-5) + along, mesh.facets)
    first, second = plan(mesh, QUICK), plan(shaken, QUICK)
    assert len(first.layers) == len(second.layers)
    assert len(first.subcomponents) == len(second.subcomponents) == 1
    assert [op.process for op in first.operations] == [op.process for op in second.operations]
    for name, volume in first.volumes_mm3.items():
        assert second.volumes_mm3[name] == pytest.approx(volume, rel=0.01)


def test_bodies_side_by_side_are_built_layer_by_layer_together() -> None:
    one = box(8.0, 8.0, 1.6).transformed([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.8], [0, 0, 0, 1]])
    other = one.transformed([[1, 0, 0, 20.0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    both = Mesh(np.vstack([one.vertices, other.vertices]), np.vstack([one.facets, other.facets + len(one.vertices)]))
    made = plan(both, QUICK)
    assert len(made.layers) == 2
    for layer in made.layers:
        assert [contour.parent for contour in layer.contours] == [-1, -1]
        assert layer.overhang_mm2 == pytest.approx(0.0)


def test_a_plan_names_its_one_piece_and_set_up() -> None:
    made = plan(box(12.0, 12.0, 1.6), QUICK)
    (piece,), (setup,) = made.subcomponents, made.setups
    assert piece.layers == (0, len(made.layers)) and piece.parent == -1 and piece.support_mm3 == 0.0
    assert setup.turn == "as clamped" and setup.subcomponents == (0,)
    assert piece.volume_mm3 == pytest.approx(12.0 * 12.0 * 1.6)
    assert all(layer.thickness_mm == pytest.approx((0.8, 0.8)) for layer in made.layers)


def test_names_of_the_package_are_the_functions() -> None:
    assert inspect.isfunction(planner.plan) and inspect.isfunction(planner.post)
    assert inspect.signature(planner.plan).parameters.keys() == inspect.signature(plan).parameters.keys()
