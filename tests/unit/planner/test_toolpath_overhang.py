"""Overhang passes: the head along the side surface, inner first, the metal of what hangs and no more."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import trimesh
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.nurbs.curve import Curve
from planner.plan import Operation, Pass, Process
from planner.process import Settings
from planner.recipe import Recipe
from planner.slicing.regions import LayerRegion, layer_regions
from planner.toolpath.clearance import cleared_tilt
from planner.toolpath.deposit import deposit_operations
from planner.toolpath.tilt import growth_share, tilt_deg
from tests.unit.planner.small_parts import box, frustum

Floats = NDArray[np.float64]

SETTINGS = Settings.from_recipe(Recipe(process="deposit"))
UPRIGHT = Settings.from_recipe(Recipe(process="deposit", overhang="upright"))
HEIGHT_MM = 0.8
FACTS = SETTINGS.material.deposition


def wall(lean_deg: float, thick_mm: float = 3.0, length_mm: float = 16.0, height_mm: float = 4.0) -> Mesh:
    """A wall along y that leans towards +x."""
    out, wide = np.tan(np.radians(lean_deg)) * height_mm, thick_mm / np.cos(np.radians(lean_deg))
    body = trimesh.creation.extrude_polygon(
        shapely.Polygon([(0, 0), (wide, 0), (wide + out, height_mm), (out, height_mm)]), length_mm
    )
    body.apply_transform(np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]]))
    return Mesh.from_trimesh(body)


def layers_of(mesh: Mesh, side: str = "both") -> list[LayerRegion]:
    low, high = mesh.bounds[:, 2]
    count = round((high - low) / HEIGHT_MM)
    return layer_regions(mesh, np.linspace(low, high, count + 1), side=side)  # type: ignore[arg-type]


def made(layer: LayerRegion, settings: Settings = SETTINGS) -> list[Operation]:
    return deposit_operations(layer, settings.bead_for(layer.height_mm), settings)[0]


def overhang_of(operations: list[Operation]) -> list[Pass]:
    return [
        step for operation in operations if operation.process is Process.DEPOSIT_OVERHANG for step in operation.passes
    ]


def poses(step: Pass, spacing_mm: float = 0.2) -> tuple[Floats, Floats]:
    """Tips and unit axes along a pass, evenly spaced."""
    u = step.tip.at_arc_length(np.linspace(0.0, step.tip.length, max(3, int(step.tip.length / spacing_mm))))
    tips = step.tip.evaluate(u)
    axes = step.axis.evaluate(u) if isinstance(step.axis, Curve) else np.tile(step.axis, (len(u), 1))
    return tips, axes / np.linalg.norm(axes, axis=1)[:, None]


def laid_mm3(operations: list[Operation]) -> float:
    """Metal of all passes by conservation of mass."""
    law, total = SETTINGS.material.bead, 0.0
    for operation in operations:
        for step in operation.passes:
            rows = step.setpoints
            ways = np.diff(np.append(rows[:, 0], step.tip.length)) * (rows[:, 2] > 0.0)
            areas = law.catch_efficiency * rows[:, 3] / 60.0 / (SETTINGS.material.density_g_mm3 * rows[:, 1])
            total += float((ways * areas).sum())
    return total


def test_head_points_along_the_tangent_of_a_wall_that_leans_sixty_degrees_and_upright_elsewhere() -> None:
    operations = made(layers_of(wall(60.0, 6.0))[2])
    tilted = overhang_of(operations)
    assert tilted and operations[-1].process is Process.DEPOSIT_OVERHANG
    tangent = np.array([np.sin(np.radians(60.0)), 0.0, np.cos(np.radians(60.0))])
    for step in tilted:
        assert np.degrees(np.arccos((poses(step)[1] @ tangent).min())) < 1.0
    for operation in operations[:-1]:
        for step in operation.passes:
            np.testing.assert_allclose(poses(step)[1][:, 2], 1.0)


def test_each_overhang_pass_lies_farther_along_the_wall_than_the_one_before() -> None:
    tangent = np.array([np.sin(np.radians(60.0)), 0.0, np.cos(np.radians(60.0))])
    along = [float((poses(step)[0] @ tangent).mean()) for step in overhang_of(made(layers_of(wall(60.0))[2]))]
    assert len(along) > 1
    assert (np.diff(along) > 0.3).all() and np.ptp(np.diff(along)) < 0.01


@pytest.mark.parametrize("lean_deg", [35.0, 50.0, 60.0])
def test_tilted_and_upright_beads_together_bring_the_layer_s_metal(lean_deg: float) -> None:
    layer = layers_of(wall(lean_deg, 5.0))[2]
    wanted = layer.region.area * layer.height_mm * (1.0 + SETTINGS.overbuild)
    assert laid_mm3(made(layer)) == pytest.approx(wanted, rel=0.15)


def test_axis_goes_round_a_funnel_with_its_outline_smoothly_and_no_farther_over_than_the_material_allows() -> None:
    funnel = frustum(10.0, 10.0 + 4.0 * np.tan(np.radians(60.0)), 4.0)
    tilted = overhang_of(made(layers_of(funnel)[2]))
    assert tilted
    for step in tilted:
        tips, axes = poses(step)
        assert np.degrees(np.arccos(axes[:, 2].clip(-1.0, 1.0))).max() <= FACTS.max_tilt_deg + 1e-6
        lit = (np.linalg.norm(np.diff(tips, axis=0), axis=1) > 1e-6).nonzero()[0]
        turn = np.degrees(np.arccos((axes[1:] * axes[:-1]).sum(axis=1).clip(-1.0, 1.0)))[lit]
        way = np.linalg.norm(np.diff(tips, axis=0), axis=1)[lit]
        assert (turn / way).max() < 12.0  # deg per mm
        middle = slice(len(tips) // 4, 3 * len(tips) // 4)
        radial = tips[middle, :2] / np.linalg.norm(tips[middle, :2], axis=1)[:, None]
        across = axes[middle, :2] / np.linalg.norm(axes[middle, :2], axis=1)[:, None]
        assert (radial * across).sum(axis=1).min() > np.cos(np.radians(4.0))


def test_walls_that_hold_by_themselves_and_recipes_that_say_upright_get_no_tilt() -> None:
    assert not overhang_of(made(layers_of(wall(25.0))[2]))
    assert not overhang_of(made(layers_of(box(12.0, 8.0, 2.4))[1]))
    leaning = layers_of(wall(60.0))[2]
    assert not overhang_of(made(leaning, UPRIGHT))
    assert not overhang_of(made(layers_of(wall(60.0))[0]))  # on the plate


def test_underside_is_closed_by_level_passes_at_one_distance_each_carried_by_the_one_before() -> None:
    post, flange = trimesh.creation.box((8.0, 8.0, 2.4)), trimesh.creation.box((12.0, 8.0, 0.8))
    flange.apply_translation([2.0, 0.0, 1.6])
    body = Mesh.from_trimesh(trimesh.boolean.union([post, flange]))
    layer = layers_of(body)[3]
    assert layer.overhang.area == pytest.approx(32.0, abs=0.5)
    tilted = overhang_of(made(layer))
    x = [float(poses(step)[0][:, 0].mean()) for step in tilted]
    steps = np.diff(x)
    assert (steps > 0.0).all() and np.ptp(steps) < 0.01
    assert steps.max() <= FACTS.max_unsupported_mm
    assert x[0] == pytest.approx(4.0, abs=0.05) and x[-1] + steps[-1] == pytest.approx(8.0, abs=0.05)
    for step in tilted:
        assert (poses(step)[1][:, 0] > 0.8).all()


def test_tilt_grows_with_the_lean_and_stays_inside_the_material_s_limits() -> None:
    lean = np.linspace(0.0, 90.0, 361)
    tilt = tilt_deg(lean, SETTINGS)
    assert (tilt[lean <= FACTS.max_overhang_deg] == 0.0).all()
    assert (np.diff(tilt) >= -1e-9).all() and tilt.max() == FACTS.max_tilt_deg
    assert (lean - tilt <= FACTS.max_overhang_deg).all()


def test_bead_along_the_wall_is_as_long_as_the_step_of_the_wall() -> None:
    assert growth_share(np.array([60.0]), np.array([60.0]))[0] == pytest.approx(2.0)
    assert growth_share(np.array([40.0]), np.array([0.0]))[0] == pytest.approx(1.0)


def test_tilt_is_less_where_the_nozzle_would_meet_the_layer_on_the_other_side_of_a_bore() -> None:
    around = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    radial = np.column_stack([np.cos(around), np.sin(around)])
    asked = np.full(24, 75.0)  # at 13 mm stand-off a nozzle end of 6 mm radius is then 2.4 mm under its focus
    bore = Mesh.from_trimesh(trimesh.creation.annulus(5.0, 25.0, 2.4, sections=64))
    allowed = cleared_tilt(5.0 * radial, -radial, asked, layers_of(bore)[1])
    assert (allowed < asked).all()
    low = 13.0 * np.cos(np.radians(allowed)) - 6.0 * np.sin(np.radians(allowed))
    assert low.min() > HEIGHT_MM  # above the metal on the other side
    free = cleared_tilt(25.0 * radial, radial, np.full(24, 50.0), layers_of(bore)[1])
    np.testing.assert_allclose(free, 50.0)


def test_starts_of_closed_overhang_passes_do_not_line_up_over_layers() -> None:
    cone = layers_of(frustum(8.0, 8.0 + 4.0 * np.tan(np.radians(50.0)), 4.0))
    starts = []
    for layer in cone[1:]:
        first = overhang_of(made(layer))[0]
        at = first.setpoints[int(np.argmax(first.setpoints[:, 2] > 0.0)), 0]
        tip = first.tip.evaluate(first.tip.at_arc_length(np.array([at])))[0]
        starts.append(np.arctan2(tip[1], tip[0]))
    apart = np.abs(np.angle(np.exp(1j * (np.array(starts)[:, None] - np.array(starts)))))
    assert np.degrees(apart[~np.eye(len(starts), dtype=bool)]).min() > 40.0


def test_wedge_where_a_wall_begins_to_lean_is_filled_from_above() -> None:
    first, second, third = layers_of(wall(60.0))[:3]
    bead = SETTINGS.bead_for(HEIGHT_MM)
    plain, heeled = (overhang_of(deposit_operations(second, bead, SETTINGS, below=below)[0]) for below in (None, first))
    again = overhang_of(deposit_operations(third, bead, SETTINGS, below=second)[0])
    assert len(heeled) == len(plain) + 1 and len(again) == len(plain)
    tips, axes = poses(heeled[0])
    assert axes[:, 2].min() > 0.999 and np.ptp(tips[:, 2]) < 1e-9
    wedge = [Operation(Process.DEPOSIT_OVERHANG, 1, (heeled[0],))]
    length = heeled[0].tip.length - FACTS.lead_in_mm - FACTS.lead_out_mm
    most = min(bead.area_mm2, 0.5 * 3.0 * 1.5 * np.sin(np.radians(60.0)))  # one bead, however large the wedge
    assert laid_mm3(wedge) / length == pytest.approx(most, rel=0.06)


@pytest.mark.parametrize("thick_mm", [3.0, 3.3, 3.6, 4.0])
def test_walls_that_are_only_deposited_get_the_metal_of_their_volume_whatever_their_width(thick_mm: float) -> None:
    layer = layers_of(box(24.0, thick_mm, 1.6))[1]
    laid = laid_mm3(made(layer))
    assert laid / (24.0 * thick_mm * HEIGHT_MM) == pytest.approx(1.0 + SETTINGS.overbuild, abs=0.06)
