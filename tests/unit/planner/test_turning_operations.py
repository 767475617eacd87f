"""What is done to layers that turn: metal enough everywhere, cutters on the torus and never in it, the end face in its plane."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import planner
from config import load_cell
from planner.errors import RecipeError
from planner.mesh.mesh import Mesh
from planner.pipeline import recipe_text
from planner.plan import Layer, Operation, Pass, Plan, Process
from planner.process import Settings
from planner.recipe import Recipe
from planner.slicing.turning import TurnedLayer, turned_layers
from planner.toolpath.links import Pose, linked
from planner.toolpath.motion import axis_at
from planner.toolpath.turning import TurnedWork, in_build, turned_operations
from sim import prove
from tests.unit.planner.turned_parts import BEND_MM, Floats, bend, bend_path, from_centreline

DEGREES = 20.0
ROD = bend(DEGREES, steps=12)
TUBE_MM, CUTTER_MM = 5.0, 4.0
AXIS = np.array([-BEND_MM, 0.0, 0.0])


def works(mesh: Mesh, recipe: Recipe, degrees: float = DEGREES) -> list[TurnedWork]:
    settings = Settings.from_recipe(recipe)
    layers, _ = turned_layers(mesh, bend_path(degrees, 9), settings, recipe)
    return list(turned_operations(mesh, layers, settings))


@pytest.fixture(scope="module")
def milled() -> list[TurnedWork]:
    return works(ROD, Recipe(tolerance_mm=0.2))


def lit(step: Pass) -> list[tuple[float, float, float]]:
    """Arc length from and to, mm, and cross-section of the bead, mm², of each lit stretch (mass conservation)."""
    material = Settings.from_recipe(Recipe()).material
    ends = np.append(step.setpoints[1:, 0], step.tip.length)
    return [
        (row[0], end, material.bead.catch_efficiency * row[3] / 60.0 / (material.density_g_mm3 * row[1]))
        for row, end in zip(step.setpoints, ends, strict=True)
        if row[2] > 0.0
    ]


def deposits(work: TurnedWork) -> list[Pass]:
    return [step for operation in work.operations if operation.process.is_deposit for step in operation.passes]


def test_every_layer_gets_at_least_the_metal_that_it_takes_and_little_more() -> None:
    for work in works(ROD, Recipe(process="deposit")):
        middle = work.layer.region.areas[1]
        takes = middle.area * float(work.layer.height_at([[middle.centroid.x, middle.centroid.y]])[0])
        brings = sum((end - start) * area for step in deposits(work) for start, end, area in lit(step))
        assert 1.0 <= brings / takes < 1.25
        assert work.deposited_mm3 == pytest.approx(takes * 1.08, rel=0.02)


def test_beads_are_as_much_higher_on_the_outside_of_the_bend_as_the_layer_is() -> None:
    for work in works(ROD, Recipe(process="deposit"))[2:4]:
        shares = []
        for step in deposits(work):
            for start, end, area in lit(step):
                tips = step.tip.evaluate(step.tip.at_arc_length(np.linspace(start, end, 5)))
                shares.append(area / float(work.layer.height_at(tips[:, :2]).max()))
        assert max(shares) < 1.08 * min(shares)  # one width: the cross-section goes with the height
        areas = [area for step in deposits(work) for _, _, area in lit(step)]
        assert max(areas) > 1.2 * min(areas)


def cutter_axes(work: TurnedWork, step: Pass, most_mm: float) -> tuple[Floats, Floats]:
    """Points of the cutter's axis above its end (in whose plane what is nearest lies below it), and the tips, build frame, mm."""
    u = step.tip.sample(0.02)
    matrix = work.layer.build_from_layer
    tips = step.tip.evaluate(u) @ matrix[:3, :3].T + matrix[:3, 3]
    axes = np.array([axis_at(step.axis, value) for value in u]) @ matrix[:3, :3].T
    return np.concatenate([tips + up * axes for up in np.linspace(0.25, most_mm, 13)]), tips


def sides(work: TurnedWork) -> list[Pass]:
    return [step for o in work.operations if o.process is Process.MILL_SIDE for step in o.passes]


def test_flank_of_the_cutter_touches_the_torus_in_every_band_and_never_cuts_into_it(milled: list[TurnedWork]) -> None:
    bands = [work for work in milled if sides(work)]
    assert len(bands) >= 2
    assert all(o.note == "ruled" for work in bands for o in work.operations if o.process is Process.MILL_SIDE)
    for work in bands:
        height = 3.0 + 1.5  # of a band and what it reaches under its bottom
        nearest = []
        for step in sides(work):
            axis, tips = cutter_axes(work, step, height)
            stands = (axis - work.layer.top[:3]) @ work.layer.top[3:] < 0.0  # above it there is nothing yet
            part = (axis[:, 2] > 0.0) & stands
            apart = from_centreline(axis[part]) - TUBE_MM
            assert apart.min() > CUTTER_MM - 0.3 * 0.2 - 0.01
            assert tips[:, 2].min() > -1e-3
            nearest.append(apart.min())
        assert min(nearest) < CUTTER_MM + 0.05


def test_last_plane_is_faced_in_the_end_plane_of_the_bend(milled: list[TurnedWork]) -> None:
    last = milled[-1]
    faces = [step for o in last.operations if o.process is Process.MILL_FACE for step in o.passes]
    tips = faces[-1].tip.evaluate(faces[-1].tip.sample(0.02))
    matrix = last.layer.build_from_layer
    build = tips @ matrix[:3, :3].T + matrix[:3, 3]
    normal = np.array([-np.sin(np.radians(DEGREES)), 0.0, np.cos(np.radians(DEGREES))])
    assert np.abs((build - AXIS) @ normal).max() < 1e-3
    np.testing.assert_allclose(matrix[:3, :3] @ axis_at(faces[-1].axis, faces[-1].tip.domain[0]), normal, atol=1e-6)


FIXED = Recipe(tolerance_mm=0.2, speed_mm_s=14.0, powder_g_min=9.0, laser_w=1200.0)


def test_beads_that_may_not_vary_are_laid_uniform_and_partial_and_cover_the_layer_everywhere() -> None:
    found = works(bend(10.0, 9.0, steps=8), FIXED, 10.0)
    assert any("uniform beads" in line and "mm over their planes are milled off" in line for line in found[-1].findings)
    partial = 0
    for work in found:
        bead = next(o for o in work.operations if o.process.is_deposit)
        levels = sorted({round(float(step.tip.control_points[0, 2]), 6) for step in deposits(work)})
        covered = []
        for level in levels:
            tracks = [
                shapely.LineString(step.tip.evaluate(step.tip.sample(0.02))[:, :2]).buffer(0.5 * bead.bead_width_mm)
                for step in deposits(work)
                if abs(float(step.tip.control_points[0, 2]) - level) < 1e-6
            ]
            covered.append(shapely.union_all(tracks))
        inside = [shapely.Point(x, y) for x in np.linspace(-9, 9, 37) for y in (-2.0, 0.0, 2.0)]
        for point in (place for place in inside if work.layer.region.region.contains(place)):
            made = sum(bead.bead_height_mm for area in covered if area.contains(point))
            assert made >= float(work.layer.height_at([[point.x, point.y]])[0])
        partial += len(levels) > 1 and covered[-1].area < 0.9 * covered[0].area
        assert work.operations[-1].process in (Process.MILL_FACE, Process.MILL_SIDE)
    assert partial


def test_deposition_alone_refuses_layers_that_its_window_cannot_follow() -> None:
    with pytest.raises(RecipeError, match="no beads that low and that high at once"):
        works(bend(10.0, steps=8), FIXED.model_copy(update={"process": "deposit"}), 10.0)


def test_bore_that_the_cutter_does_not_enter_stays_as_deposited_and_is_told() -> None:
    tube = works(bend(10.0, 5.0, 3.0, steps=8), Recipe(tolerance_mm=0.2), 10.0)
    assert any("narrower than the cutter" in line for line in tube[-1].findings)
    assert all(o.note == "ruled" for work in tube for o in work.operations if o.process is Process.MILL_SIDE)
    for work in tube:
        for step in sides(work):
            assert from_centreline(cutter_axes(work, step, 4.0)[0]).min() > 3.0


def plan_of(found: list[TurnedWork], mesh: Mesh, recipe: Recipe) -> Plan:
    """The work as a plan, linked layer by layer."""
    settings = Settings.from_recipe(recipe)
    here: Pose | None = None
    layers = []
    for work in found:
        operations = []
        here = None if here is None else moved(here, work.layer.layer_from_build)
        for operation in work.operations:
            done, here = linked(operation, here, work.metal_top_mm, settings)
            operations.append(in_build(done, work.layer.build_from_layer))
        here = None if here is None else moved(here, work.layer.build_from_layer)
        layers.append(plan_layer(work.layer, operations))
    return Plan(
        "bend", mesh.sha256, recipe_text(recipe), "316L", recipe.process, recipe.tolerance_mm,
        np.eye(4), mesh.bounds, tuple(layers), volumes_mm3={"part": mesh.volume, "deposited": 0.0, "milled": 0.0},
    )  # fmt: skip


def moved(pose: Pose, matrix: Floats) -> Pose:
    return Pose(matrix[:3, :3] @ pose.tip + matrix[:3, 3], matrix[:3, :3] @ pose.axis)


def plan_layer(layer: TurnedLayer, operations: list[Operation]) -> Layer:
    region = layer.region
    return Layer(
        region.index, layer.bottom, layer.top, (), (), region.overlap_mm2, region.overhang_mm2, tuple(operations),
        thickness_mm=layer.thickness_mm,
    )  # fmt: skip


def test_bent_rod_deposited_and_milled_in_turning_layers_passes_its_proof(milled: list[TurnedWork]) -> None:
    recipe = Recipe(tolerance_mm=0.2)
    proof = prove(
        planner.post(plan_of(milled, ROD, recipe), load_cell("trunnion_tcp")),
        load_cell("trunnion_tcp"),
        ROD,
        cell_mm=0.4,
    )
    assert proof.passed, proof.reasons
    assert proof.deviation.p99_mm < 0.2
    assert proof.deviation.missing_mm3 < 0.005 * ROD.volume
