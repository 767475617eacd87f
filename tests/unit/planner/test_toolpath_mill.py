"""Milling: what the cutter leaves is the part; leaning walls tilt the tool; nothing that must stand is cut."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import trimesh
from shapely import MultiPolygon, Point

from planner.errors import RecipeError
from planner.mesh.mesh import Mesh
from planner.nurbs.offset import outset
from planner.pipeline import plan
from planner.plan import Plan, Process
from planner.process import Settings
from planner.recipe import Recipe
from planner.toolpath.face import face_passes
from planner.toolpath.links import end_of, start_of
from planner.toolpath.motion import straight
from planner.toolpath.order import RUNS_DOWN
from planner.toolpath.side import stretches_within, unreached, wall_offsets
from tests.unit.planner.small_parts import box, frustum, points_of, steps_of, tube

RADIUS = 4.0
QUICK = Recipe(layer_height_mm=0.8)
SETTINGS = Settings.from_recipe(QUICK)


@pytest.fixture(scope="module")
def ring() -> Plan:
    return plan(tube(8.0, 15.0, 5.6, sections=360), QUICK)


@pytest.fixture(scope="module")
def cone() -> Plan:
    return plan(frustum(16.0, 12.0, 8.0, sections=180), QUICK)


def side_passes(made: Plan) -> list[list[np.ndarray]]:
    """Points of the side passes, operation by operation."""
    return [
        [points_of(step) for step in operation.passes if not step.is_link]
        for operation in made.operations
        if operation.process is Process.MILL_SIDE
    ]


def test_flank_passes_leave_exactly_the_ring(ring: Plan) -> None:
    for passes in side_passes(ring):
        radii = np.concatenate([np.linalg.norm(points[:, :2], axis=1) for points in passes])
        outside, inside = radii[radii > 11.5], radii[radii < 11.5]
        assert outside.min() == pytest.approx(15.0 + RADIUS, abs=0.004)
        assert inside.max() == pytest.approx(8.0 - RADIUS, abs=0.004)


def test_bands_reach_from_the_substrate_to_the_top_without_a_gap_within_the_axial_depth(ring: Plan) -> None:
    bottoms, tops = [], []
    for layer in ring.layers:
        for operation in layer.operations:
            if operation.process is Process.MILL_SIDE:
                heights = np.concatenate([points_of(s)[:, 2] for s in operation.passes if not s.is_link])
                bottoms.append(heights.min())
                tops.append(float(layer.top[2]))
    assert bottoms[0] == pytest.approx(0.0, abs=1e-12)
    assert tops[-1] == pytest.approx(5.6)
    crest = 1.5 * SETTINGS.step_over * max(operation.bead_height_mm for operation in ring.operations)
    run_down = RUNS_DOWN * crest + 1e-9
    assert all(0.1 - 1e-9 <= high - low <= run_down for low, high in zip(bottoms[1:], tops[:-1], strict=True))
    assert all(high - low <= SETTINGS.mill_every_mm + run_down for low, high in zip(bottoms, tops, strict=True))


def test_side_milling_is_climb_milling_with_the_part_on_the_right(ring: Plan) -> None:
    for passes in side_passes(ring):
        for points in passes:
            loop = points[np.abs(np.linalg.norm(points[:, :2], axis=1) - np.median(np.linalg.norm(points[:, :2], axis=1))) < 0.05]
            x, y = loop[:, 0], loop[:, 1]
            swept = float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum())
            assert (swept < 0.0) == (np.median(np.hypot(x, y)) > 11.5)


def test_cutter_comes_on_and_off_the_wall_along_arcs_off_the_metal(ring: Plan) -> None:
    for operation, step in steps_of(ring):
        if operation.process is Process.MILL_SIDE and not step.is_link:
            for pose in (start_of(step), end_of(step)):
                radius = float(np.hypot(*pose.tip[:2]))
                away = radius - RADIUS - 15.0 if radius > 11.5 else 8.0 - RADIUS - radius
                assert away > 0.5


def test_roughing_goes_before_finishing_where_one_cut_does_not_take_it_all() -> None:
    assert wall_offsets(0.9, 1.0) == [0.0]
    cuts = wall_offsets(2.4, 1.0)
    assert cuts[-1] == 0.0 and cuts[-2] == pytest.approx(0.2)
    assert max(-np.diff([2.4, *cuts])) <= 1.0 + 1e-12


def test_faces_sweep_all_metal_in_the_plane_and_come_in_from_outside() -> None:
    metal = MultiPolygon([Point(0, 0).buffer(24, quad_segs=64).difference(Point(0, 0).buffer(16, quad_segs=64))])
    for region in (metal, MultiPolygon([shapely.box(0, 0, 40, 30)]), MultiPolygon([shapely.box(0, 0, 40, 3)])):
        passes = face_passes(region, 3.0, SETTINGS)
        assert len(passes) == 1
        points = points_of(passes[0])
        assert np.abs(points[:, 2] - 3.0).max() < 1e-9
        swept = shapely.LineString(points[:, :2]).buffer(RADIUS, quad_segs=32)
        assert shapely.difference(region, swept).area < 1e-3
        assert region.distance(Point(points[0, :2])) > RADIUS


def test_last_top_is_faced_to_the_parts_height(ring: Plan) -> None:
    last = [op for op in ring.layers[-1].operations if op.process is Process.MILL_FACE]
    heights = {round(float(z), 9) for s in last[0].passes if not s.is_link for z in points_of(s)[:, 2]}
    assert heights == {5.6}


def test_axis_follows_the_rulings_of_a_cone_and_the_flank_touches_it(cone: Plan) -> None:
    slope = np.array([4.0, 8.0]) / np.hypot(4.0, 8.0)
    for operation in cone.operations:
        gaps = []
        for step in operation.passes:
            if operation.process is not Process.MILL_SIDE or step.is_link or isinstance(step.axis, np.ndarray):
                continue
            u = np.linspace(*step.tip.domain, 200)[20:-20]
            tips, axes = step.tip.evaluate(u), step.axis.evaluate(u)
            axes /= np.linalg.norm(axes, axis=1)[:, None]
            from_centre = np.linalg.norm(tips[:, :2], axis=1)
            leaning_in = -(axes[:, :2] * tips[:, :2]).sum(axis=1) / from_centre
            assert np.abs(leaning_in - slope[0]).max() < 0.01
            assert np.abs(axes[:, 2] - slope[1]).max() < 0.01
            gaps.append(float(((from_centre - (16.0 - 0.5 * tips[:, 2])) * slope[1]).min()))
        if operation.process is Process.MILL_SIDE:
            assert min(gaps) == pytest.approx(RADIUS, abs=0.02)


def test_leaning_cutter_stays_above_the_substrate(cone: Plan) -> None:
    for operation, step in steps_of(cone):
        if operation.process is Process.MILL_SIDE and not step.is_link:
            u = np.linspace(*step.tip.domain, 300)
            tips = step.tip.evaluate(u)
            axes = np.broadcast_to(step.axis, tips.shape) if isinstance(step.axis, np.ndarray) else step.axis.evaluate(u)
            axes = axes / np.linalg.norm(axes, axis=1)[:, None]
            assert (tips[:, 2] - RADIUS * np.hypot(axes[:, 0], axes[:, 1])).min() > -1e-6


def test_ledge_is_not_cut_by_the_wall_that_stands_on_it() -> None:
    stepped = trimesh.boolean.union(
        [trimesh.creation.box(bounds=[[-15, -15, 0], [15, 15, 2.4]]), trimesh.creation.box(bounds=[[-8, -8, 2.4], [8, 8, 4.8]])]
    )
    made = plan(Mesh.from_trimesh(stepped), QUICK)
    upper = [op for layer in made.layers[3:] for op in layer.operations if op.process is Process.MILL_SIDE]
    assert upper
    for operation in upper:
        for step in operation.passes:
            if not step.is_link:
                assert points_of(step)[:, 2].min() >= 2.4 - 1e-9


def test_hole_narrower_than_the_cutter_and_inside_corners_are_told() -> None:
    plate = shapely.box(0, 0, 30, 30).difference(Point(10, 10).buffer(3.0))
    left = unreached(MultiPolygon([plate]), RADIUS)
    assert left.closed.area == pytest.approx(np.pi * 9.0, rel=0.05) and left.corners.is_empty
    angle = shapely.box(0, 0, 30, 30).difference(shapely.box(15, 15, 30, 30))
    corner = unreached(MultiPolygon([angle]), RADIUS)
    assert corner.corners.area == pytest.approx(16.0 * (1 - np.pi / 4), rel=0.1) and corner.closed.is_empty
    body = Mesh.from_trimesh(trimesh.creation.extrude_polygon(plate, 1.6))
    findings = plan(body, QUICK).findings
    assert len([f for f in findings if "narrower than the cutter" in f]) == 1


def test_block_is_milled_down_to_the_part_and_nothing_of_it_is_cut() -> None:
    made = plan(box(20.0, 14.0, 5.0), Recipe(process="mill"))
    part = shapely.box(-10, -7, 10, 7)
    for layer in made.layers:
        sweeps = [
            shapely.LineString(points_of(step)[:, :2]).buffer(RADIUS, quad_segs=32)
            for operation in layer.operations
            for step in operation.passes
            if not step.is_link and points_of(step)[0, 2] < layer.top[2] - 1e-6
        ]
        swept = shapely.union_all(sweeps)
        assert shapely.intersection(swept, part).area < 0.05
        stock = outset(MultiPolygon([part]), 1.0)
        assert shapely.difference(stock, shapely.union(swept, part.buffer(0.01))).area < 0.05
    assert made.volumes_mm3["milled"] == pytest.approx(22 * 16 * 6 - 20 * 14 * 5)


def test_stock_that_does_not_hold_the_part_or_is_absent_is_refused(tmp_path) -> None:  # type: ignore[no-untyped-def]
    small = tmp_path / "small.stl"
    trimesh.creation.box((5, 5, 5)).export(small)
    with pytest.raises(RecipeError, match="stock"):
        plan(box(20.0, 14.0, 5.0), Recipe(process="mill", stock=str(small)))
    with pytest.raises(RecipeError, match="absent"):
        plan(box(20.0, 14.0, 5.0), Recipe(process="mill", stock=str(tmp_path / "absent.stl")))


def test_flank_rolls_round_the_corners_of_a_drafted_block_without_cutting_them() -> None:
    body = trimesh.creation.box((20.0, 16.0, 4.0))
    vertices = np.add(body.vertices, (0.0, 0.0, 2.0))
    vertices[:, :2] *= np.where(vertices[:, 2:] > 2.0, 0.75, 1.0)
    made = plan(Mesh(np.asarray(vertices), np.asarray(body.faces)), QUICK)
    leaning = [
        step
        for operation in made.operations
        if operation.process is Process.MILL_SIDE and operation.note == "ruled"
        for step in operation.passes
        if not step.is_link and not isinstance(step.axis, np.ndarray)
    ]
    assert leaning
    foot = np.array([[x, y, 0.0] for x in (-10.0, 10.0) for y in (-8.0, 8.0)])
    peak = foot * [0.75, 0.75, 1.0] + [0.0, 0.0, 4.0]
    share = np.linspace(0.0, 1.0, 9)[:, None, None]
    ridges = (foot + share * (peak - foot)).reshape(-1, 3)
    for step in leaning:
        u = step.tip.sample(0.005)
        tips, axes = step.tip.evaluate(u), step.axis.evaluate(u)
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        away = ridges[None] - tips[:, None]
        along = np.einsum("nrk,nk->nr", away, axes)
        across = np.linalg.norm(away - along[..., None] * axes[:, None], axis=2)
        assert across[along > 0.0].min() > RADIUS - 0.05


def test_leaning_wall_too_near_to_another_body_is_not_milled_along_its_rulings_into_that_body() -> None:
    shapes = []
    for x in (0.0, 26.5):
        cone = frustum(12.0, 11.5, 1.6, sections=60).to_trimesh()
        cone.apply_translation([x, 0.0, 0.0])
        shapes.append(cone)
    made = plan(Mesh.from_trimesh(trimesh.util.concatenate(shapes)), QUICK)
    assert any("cannot follow" in finding for finding in made.findings)
    feet = shapely.union_all([shapely.Point(x, 0.0).buffer(12.0) for x in (-13.25, 13.25)])
    for passes in side_passes(made):
        for points in passes:
            assert shapely.LineString(points[:, :2]).distance(feet) > RADIUS - 0.05


def test_stretches_of_a_loop_of_long_straight_walls_reach_to_where_it_is_blocked() -> None:
    loop = straight(np.array([[0.0, 0, 2], [20, 0, 2], [20, 10, 2], [0, 10, 2], [0, 0, 2]]))
    free = MultiPolygon([shapely.box(-5.0, -5.0, 25.0, 6.0)])
    (found,) = stretches_within(loop, free)
    assert found.length == pytest.approx(20.0 + 2 * 6.0, abs=0.41)
    assert stretches_within(loop, MultiPolygon([shapely.box(-5.0, -5.0, 25.0, 15.0)])) == [loop]
    beside = stretches_within(loop, MultiPolygon([shapely.box(-5.0, -5.0, 8.0, 15.0), shapely.box(12.0, -5.0, 25.0, 15.0)]))
    assert sum(motion.length for motion in beside) == pytest.approx(60.0 - 8.0, abs=0.81)
