"""Deposited layers: beads cover what they shall, no more, with the metal that it takes."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import trimesh
from shapely import MultiPolygon, Polygon

from planner.mesh.mesh import Mesh
from planner.nurbs.offset import inset, outset
from planner.pipeline import plan
from planner.plan import Layer, Operation, Plan, Process
from planner.process import Settings
from planner.recipe import Recipe
from planner.slicing.layers import layer_levels
from planner.slicing.regions import layer_regions
from planner.toolpath.centreline import thin_parts
from planner.toolpath.contour import edge_mm
from planner.toolpath.deposit import deposit_operations, grown_region
from planner.toolpath.fitting import fitted_bead, fitted_stretches
from planner.toolpath.pattern import TOP_DENSER
from tests.unit.planner.small_parts import box, frustum, lit_points, tube

QUICK = Recipe(layer_height_mm=0.8)


@pytest.fixture(scope="module")
def ring() -> Plan:
    return plan(tube(8.0, 15.0, 4.0), QUICK)


def footprint(layer: Layer) -> shapely.Geometry:
    """What the beads of a layer cover."""
    beads = [
        shapely.LineString(lit_points(step)[:, :2]).buffer(0.5 * operation.bead_width_mm, quad_segs=16)
        for operation in layer.operations
        if operation.process.is_deposit
        for step in operation.passes
        if not step.is_link
    ]
    return shapely.union_all(beads)


def wanted(layer: Layer, settings: Settings) -> MultiPolygon:
    """The layer's outline with allowance and edge strip, from its contours."""
    rings = [shapely.LinearRing(c.curve.evaluate(c.curve.sample(0.002))[:-1, :2]) for c in layer.contours]
    region = rings[0].buffer(0).union(Polygon(rings[0]))
    for contour, loop in zip(layer.contours[1:], rings[1:], strict=True):
        region = region.difference(Polygon(loop)) if contour.is_hole else region.union(Polygon(loop))
    width = layer.operations[0].bead_width_mm
    edge = 0.5 * (1.0 - settings.step_over) * width if settings.is_milled else 0.0
    return outset(region, settings.allowance_mm + edge)


@pytest.mark.parametrize("process", ["hybrid", "deposit"])
@pytest.mark.parametrize("shape", ["ring", "box", "frustum"])
def test_beads_cover_the_grown_region_with_less_than_one_percent_void_and_stay_in_it(process: str, shape: str) -> None:
    mesh = {"ring": tube(8.0, 15.0, 1.6), "box": box(30.0, 22.0, 1.6), "frustum": frustum(15.0, 14.0, 1.6)}[shape]
    recipe = QUICK.model_copy(update={"process": process})
    settings = Settings.from_recipe(recipe)
    for layer in plan(mesh, recipe).layers:
        grown, covered = wanted(layer, settings), footprint(layer)
        assert shapely.difference(grown, covered).area < 0.01 * grown.area
        assert shapely.difference(covered, outset(grown, 0.02)).area < 1e-3 * grown.area


def test_metal_on_the_passes_is_the_metal_that_the_layers_take(ring: Plan) -> None:
    settings = Settings.from_recipe(QUICK)
    law, density = settings.material.bead, settings.material.density_g_mm3
    laid, takes = 0.0, 0.0
    for layer in ring.layers:
        deposits = [operation for operation in layer.operations if operation.process.is_deposit]
        edge = 0.5 * (1.0 - settings.step_over) * deposits[0].bead_width_mm
        takes += inset(wanted(layer, settings), edge).area * deposits[0].bead_height_mm
        for step in (step for operation in deposits for step in operation.passes):
            ends = np.append(step.setpoints[1:, 0], step.tip.length)
            lit = (ends - step.setpoints[:, 0]) * (step.setpoints[:, 2] > 0.0)
            laid += float((lit * law.catch_efficiency * step.setpoints[:, 3] / 60.0 / density / step.setpoints[:, 1]).sum())
    assert laid == pytest.approx(ring.volumes_mm3["deposited"], rel=1e-6)
    assert laid == pytest.approx(takes, rel=0.07)  # under the finished top, one layer of five, hatch runs on into the contours


def test_laser_is_off_on_links_leads_and_milling(ring: Plan) -> None:
    for operation in ring.operations:
        for step in operation.passes:
            power = step.setpoints[:, 2]
            if step.is_link or not operation.process.is_deposit:
                assert not power.any()
            else:
                assert power[0] == 0.0 and power[-1] == 0.0 and (power > 0.0).any()
                assert step.setpoints[1, 0] == pytest.approx(2.0)
            assert (np.diff(step.setpoints[:, 0]) > 0.0).all() and step.setpoints[0, 0] == 0.0
            assert step.setpoints[-1, 0] < step.tip.length


def test_lead_in_runs_along_the_bead_it_leads_into(ring: Plan) -> None:
    for operation in ring.layers[0].operations:
        for step in operation.passes:
            if step.is_link or not operation.process.is_deposit:
                continue
            u = step.tip.at_arc_length([1.0, 1.999, 2.001])
            directions = step.tip.derivatives(u, 1)[1]
            directions /= np.linalg.norm(directions, axis=1)[:, None]
            assert directions[1] @ directions[2] > np.cos(np.radians(1.0))


def test_contours_start_elsewhere_in_every_layer(ring: Plan) -> None:
    angles = []
    for layer in ring.layers:
        first = next(s for s in layer.operations[0].passes if not s.is_link)
        start = lit_points(first)[0]
        angles.append(np.arctan2(start[1], start[0]))
    gaps = np.abs((np.subtract.outer(angles, angles) + np.pi) % (2 * np.pi) - np.pi)
    assert gaps[~np.eye(len(angles), dtype=bool)].min() > np.radians(20.0)


def test_hatch_turns_by_the_recipes_angle_from_layer_to_layer() -> None:
    headings = []
    for layer in plan(box(20.0, 15.0, 2.4), QUICK).layers:
        fill = next(op for op in layer.operations if op.process is Process.DEPOSIT_FILL)
        points = lit_points(next(s for s in fill.passes if not s.is_link))
        headings.append(np.degrees(np.arctan2(*(points[-1] - points[0])[[1, 0]])))
    assert np.allclose(np.diff(headings) % 180.0, 67.0, atol=1e-6)


def test_first_deposition_of_a_layer_waits_for_the_interpass_time(ring: Plan) -> None:
    for layer in ring.layers:
        waits = [operation.interpass_s for operation in layer.operations]
        assert waits[0] == Settings.from_recipe(QUICK).interpass_s and not any(waits[1:])


def test_wall_thinner_than_a_bead_gets_one_bead_along_its_middle() -> None:
    made = plan(tube(8.5, 10.0, 1.6), Recipe(process="deposit", layer_height_mm=0.8))
    for layer in made.layers:
        work = [s for op in layer.operations for s in op.passes if not s.is_link]
        assert len(work) == 1
        radii = np.linalg.norm(lit_points(work[0])[:, :2], axis=1)
        assert np.abs(radii - 9.25).max() < 0.05


def test_middle_of_a_strip_is_its_long_axis_and_corners_of_a_box_are_no_thin_parts() -> None:
    strip = MultiPolygon([shapely.box(0.0, 0.0, 20.0, 1.0)])
    parts = thin_parts(strip, 2.5)
    assert len(parts) == 1 and [line.closed for line in parts[0].lines] == [False]
    assert np.abs(parts[0].lines[0].points[:, 1] - 0.5).max() < 0.06
    assert np.allclose(parts[0].lines[0].widths_mm, 1.0, atol=0.12)
    assert np.ptp(parts[0].lines[0].points[:, 0]) > 18.0
    assert thin_parts(MultiPolygon([shapely.box(0.0, 0.0, 20.0, 20.0)]), 2.5) == []


def strips() -> dict[str, shapely.Geometry]:
    """Plane shapes with parts of all widths."""
    disc = shapely.Point(0.0, 0.0).buffer(15.0, quad_segs=64)
    letter = [(0, 0), (8, 26), (12, 26), (20, 0), (16.4, 0), (14.2, 7.2), (5.8, 7.2), (3.6, 0)]
    bars = [shapely.box(0, 0, 16, 3.2), shapely.box(0, 11, 12, 13.6), shapely.box(0, 22, 16, 26), shapely.box(0, 0, 4, 26)]
    return {
        "wedge": Polygon([(0, -5), (40, -0.3), (40, 0.3), (0, 5)]),
        "slot": shapely.box(0.0, 0.0, 30.0, 2.7),
        "wide slot": shapely.box(0.0, 0.0, 30.0, 3.4),
        "eccentric": disc.difference(shapely.Point(4.0, 0.0).buffer(9.2, quad_segs=64)),
        "A": Polygon(letter, [[(6.8, 10.4), (13.2, 10.4), (10, 20.6)]]),
        "E": shapely.union_all(bars),
        "S": shapely.LineString([(0, 0), (15, 0), (15, 10), (0, 10), (0, 20), (15, 20)]).buffer(1.7, quad_segs=16),
    }


def laid_beads(operations: list[Operation], settings: Settings) -> tuple[shapely.Geometry, float]:
    """What the tracks cover, each stretch as wide as its power and speed melt, and their metal, mm³."""
    law, density = settings.material.bead, settings.material.density_g_mm3
    covered, volume = [], 0.0
    for step in (step for operation in operations for step in operation.passes):
        ends = np.append(step.setpoints[1:, 0], step.tip.length)
        for (at, speed, power, powder, _), end in zip(step.setpoints, ends, strict=True):
            if power > 0.0:
                path = step.tip.evaluate(step.tip.at_arc_length(np.linspace(at, end, int((end - at) / 0.1) + 2)))[:, :2]
                width = law.width_coefficient * power**law.width_power_exponent * speed**law.width_speed_exponent
                covered.append(shapely.LineString(path).buffer(0.5 * width, quad_segs=32))
                volume += law.catch_efficiency * powder / 60.0 / density / speed * (end - at)
    return shapely.union_all(covered), volume


@pytest.mark.parametrize("process", ["deposit", "hybrid"])
@pytest.mark.parametrize("name", ["wedge", "slot", "wide slot", "eccentric", "A", "E", "S"])
def test_strips_of_any_width_are_covered_without_wide_voids_and_without_piling_metal(process: str, name: str) -> None:
    settings = Settings.from_recipe(Recipe(process=process, layer_height_mm=0.8))
    bead = settings.bead_for(0.8)
    mesh = Mesh.from_trimesh(trimesh.creation.extrude_polygon(strips()[name], 1.6))
    layer = layer_regions(mesh, np.array([0.0, 0.8, 1.6]))[0]
    covered, volume = laid_beads(deposit_operations(layer, bead, settings)[0], settings)
    grown = grown_region(layer, bead, settings)
    narrowest = settings._bead(settings.material.deposition.speed_mm_s.max, bead.powder_g_min, 600.0).width_mm
    void = shapely.difference(grown.buffer(-0.5 * narrowest).buffer(0.5 * narrowest), covered)
    holes = [part for part in shapely.get_parts(void) if part.geom_type == "Polygon" and part.area > 1e-6]
    widest = max((2.0 * shapely.maximum_inscribed_circle(part, tolerance=0.005).length for part in holes), default=0.0)
    assert widest <= 0.1 * bead.width_mm
    assert shapely.difference(covered, outset(grown, 0.02)).area < 0.02 * grown.area
    takes = inset(grown, edge_mm(bead, settings)).area * bead.height_mm
    assert 0.8 * takes < volume < 1.2 * takes


def test_one_bead_narrows_with_the_wedge_that_it_fills() -> None:
    settings = Settings.from_recipe(Recipe(process="deposit", layer_height_mm=0.8))
    bead = settings.bead_for(0.8)
    [part] = thin_parts(MultiPolygon([strips()["wedge"]]), bead.width_mm)
    [line] = part.lines
    stretches = fitted_stretches(line, bead, 0.0, settings)
    widths = [stretch.bead.width_mm for stretch in stretches]
    wide_first = line.widths_mm[0] > line.widths_mm[-1]
    assert len(widths) >= 5 and widths == sorted(widths, reverse=bool(wide_first))
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line.points, axis=0), axis=1))])
    for stretch in stretches:
        assert abs(stretch.bead.width_mm - max(np.interp(stretch.at_mm, at, line.widths_mm), min(widths))) < 0.2
        speed, power, powder = stretch.bead.speed_mm_s, stretch.bead.laser_w, stretch.bead.powder_g_min
        facts = settings.material.deposition
        assert facts.speed_mm_s.min <= speed <= facts.speed_mm_s.max
        assert facts.laser_w.min <= power <= facts.laser_w.max and facts.powder_g_min.min <= powder <= facts.powder_g_min.max


def test_what_the_recipe_fixes_stays_in_fitted_beads() -> None:
    fixed = Settings.from_recipe(Recipe(process="deposit", layer_height_mm=0.8, laser_w=1100.0, speed_mm_s=11.0, powder_g_min=13.0))
    bead = fixed.bead_for(0.8)
    narrow = fitted_bead(bead, 0.5 * bead.width_mm, 0.0, fixed)
    assert (narrow.laser_w, narrow.speed_mm_s, narrow.powder_g_min) == (1100.0, 11.0, 13.0)
    assert narrow.width_mm == pytest.approx(bead.width_mm) and narrow.area_mm2 == pytest.approx(bead.area_mm2)


def test_fin_too_thin_for_any_bead_is_named_with_place_and_area() -> None:
    body = shapely.union_all([shapely.box(-8, -8, 8, 8), shapely.box(8, -0.2, 16, 0.2)])
    mesh = Mesh.from_trimesh(trimesh.creation.extrude_polygon(body, 2.4))
    findings = plan(mesh, Recipe(process="deposit", layer_height_mm=0.8, build_direction=(0.0, 0.0, 1.0))).findings
    findings = [line for line in findings if "fall away" in line]
    assert len(findings) == 1
    assert "layers 0-2" in findings[0] and "fall away" in findings[0] and "3.2" in findings[0]


def test_levels_meet_flat_faces_and_eq1_areas_are_those_of_the_step() -> None:
    step = trimesh.boolean.union(
        [trimesh.creation.box(bounds=[[-10, -10, 0], [10, 10, 3]]), trimesh.creation.box(bounds=[[-6, -6, 3], [14, 6, 5]])]
    )
    mesh = Mesh.from_trimesh(step)
    levels, _ = layer_levels(mesh, 0.04, 0.8, 0.8)
    assert np.abs(levels - 3.0).min() < 1e-9
    layers = layer_regions(mesh, levels)
    upper = next(layer for layer in layers if abs(layer.z_bottom - 3.0) < 1e-9)
    assert upper.overlap_mm2 == pytest.approx(16 * 12, rel=1e-9)
    assert upper.overhang_mm2 == pytest.approx(4 * 12, rel=1e-9)


def test_hatch_of_a_finished_top_runs_nearer_to_the_contours_middle_than_other_hatch_but_not_over_it() -> None:
    made = plan(box(30.0, 30.0, 1.6), QUICK)
    for layer, is_top in zip(made.layers, (False, True), strict=True):
        contour, fill = (o for o in layer.operations if o.process.is_deposit)
        outline = shapely.Polygon(lit_points(next(s for s in contour.passes if not s.is_link))[:, :2]).exterior
        ends = np.vstack([lit_points(s)[[0, -1], :2] for s in fill.passes if not s.is_link])
        away = shapely.distance(outline, shapely.points(ends))
        step = Settings.from_recipe(QUICK).step_over * contour.bead_width_mm
        short = 0.25 * step / TOP_DENSER if is_top else 0.5 * step  # a quarter of a step on either side is a bead's core
        assert np.abs(np.median(away) - short) < 0.02
