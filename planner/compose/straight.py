"""A piece that grows along one direction: sliced, deposited, faced, milled and bored in its own frame."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from planner.compose.lean import Lean
from planner.compose.made import Made, in_place
from planner.compose.standing import Standing, merged
from planner.compose.supported import cleared, with_support
from planner.compose.work import Work
from planner.decompose.bores import filled, hanging_bores
from planner.errors import PlanningError
from planner.handout import Handout
from planner.mesh.mesh import Mesh
from planner.mesh.winding import body_of_facet
from planner.process import Settings
from planner.slicing.contours import ContourStyle, doubted
from planner.slicing.fitted import fitted_shapes
from planner.slicing.layers import layer_levels
from planner.slicing.regions import LayerRegion, layer_regions
from planner.toolpath.bands import make_bands
from planner.toolpath.bore import Boring, borings
from planner.toolpath.order import RUNS_DOWN, Sequence, build_up
from planner.toolpath.roughing import carve, stock_of
from planner.toolpath.tops import finished_tops, layer_beads

Floats = NDArray[np.float64]

_OVERHANG_WORTH_MM2 = 0.5  # smaller unsupported areas are the rounding of sections
_LOOSE_MM = 0.1  # a body that begins higher above its base stands on nothing
_WAY_MM = 1.0  # beside a piece, for what ways between its passes go over


def straight_piece(work: Work) -> Made:
    """The layers of a piece with all that is done to it.  Raises PlanningError or RecipeError."""
    settings, say = work.settings, work.say
    build_from_piece = work.piece.build_from_piece
    is_there = np.array_equal(build_from_piece, np.eye(4))
    mesh = work.piece.mesh if is_there else work.piece.mesh.transformed(np.linalg.inv(build_from_piece))
    _refuse_loose(mesh)
    support = work.support()
    solid, holes, findings = _bored(with_support(mesh, support), settings, work.standing)
    say("layers", 0.0)
    regions, notes = _regions(solid, settings, lambda: say("sections", 0.03))
    say("contours", 0.08)
    handout = Handout(
        solid,
        settings.recipe,
        len(regions),
        work.on_layer,
        lambda share: say("toolpaths", 0.08 + 0.92 * share),
        lambda layer: work.cooled(in_place(layer, build_from_piece, work.first_layer, work.number)),
    )
    lean = work.lean()
    begun = _begun(work, regions, lean)
    told: list[str] = []
    if support is not None and settings.is_milled:
        begun.closing, told = cleared(mesh, support, work, regions[-1].index)
    sequence = _sequence(solid, work, regions, handout, holes, begun)
    layers = handout.finish()
    if settings.recipe.process != "mill":
        notes += _overhang_findings(regions)
    notes += _doubt_findings(regions, ContourStyle.from_recipe(settings.recipe))
    return Made(
        layers,
        work.piece.direction,
        sequence.deposited_mm3,
        max((region.unsupported_mm for region in regions), default=0.0),
        support_mm3=0.0 if support is None else support.volume,
        findings=[*findings, *notes, *sequence.findings, *told, *(lean.findings if lean is not None else [])],
    )


def _bored(part: Mesh, settings: Settings, standing: Standing | None) -> tuple[Mesh, list[Boring], list[str]]:
    """What is built: the part with those hanging bores full that are cut from the side afterwards; these, and findings."""
    if settings.recipe.process != "hybrid":
        return part, [], []
    bores = hanging_bores(part, settings.material.deposition.max_overhang_deg, settings.recipe.crease_deg)
    if not bores:
        return part, [], []
    solid = filled(part, bores)
    around = solid if standing is None else merged([solid, *standing.meshes, standing.plate])
    holes, notes = borings(around, bores, settings)
    return filled(part, [hole.bore for hole in holes]), holes, notes


def _regions(part: Mesh, settings: Settings, levelled: Callable[[], None]) -> tuple[list[LayerRegion], list[str]]:
    """The layers of a part in its build frame, and what was found.  levelled : told when their heights are known.

    The recipe's tolerance_side counts for the thickness of layers always, for their outlines where nothing is milled
    afterwards; cutters need metal wherever the part is, so hybrid and milled layers are the union of their sections.
    """
    recipe = settings.recipe
    levels, notes = layer_levels(
        part,
        recipe.cusp_mm,
        settings.layer_min_mm,
        settings.layer_max_mm,
        rule=recipe.layer_rule,
        side=recipe.tolerance_side,
        crease_deg=recipe.crease_deg,
        style=ContourStyle.from_recipe(recipe),
    )
    levelled()
    side = recipe.tolerance_side if recipe.process == "deposit" else "outside"
    regions = layer_regions(part, levels, fitted_shapes(part, ContourStyle.from_recipe(recipe)), side)
    _refuse_empty(regions)
    return regions, notes


def _sequence(
    part: Mesh, work: Work, regions: list[LayerRegion], handout: Handout, holes: list[Boring], begun: Sequence
) -> Sequence:
    """All operations in order; the handout is told each layer that is done."""
    settings = work.settings
    if settings.recipe.process == "mill":
        return carve(stock_of(part, settings.recipe, work.build_from_part), regions, settings, handout.take)
    tops = finished_tops(regions, settings)
    beads = layer_beads(regions, tops, settings)
    bands = make_bands(regions, part, settings) if settings.is_milled else iter(())
    return build_up(regions, beads, tops, bands, settings, handout.take, holes, begun=begun)


def _begun(work: Work, regions: list[LayerRegion], lean: Lean | None) -> Sequence:
    """The state of the part before a piece: what stands beside and below it."""
    begun = Sequence(work.settings)
    if work.standing is None:
        return begun
    begun.standing_mm = work.standing.height_over(regions[0].region, _WAY_MM)
    if lean is not None:
        begun.lean = lean.away
    if work.settings.is_milled:
        begun.stands = work.standing.keep_out
        begun.bodies = work.standing.meshes
        depth = RUNS_DOWN * work.settings.bead_for(regions[0].height_mm).crest_mm
        begun.under = work.standing.layers_under(depth, regions[0].height_mm)
    return begun


def _refuse_loose(mesh: Mesh) -> None:
    """Raise PlanningError where a body of a piece rests on nothing that stays.  mesh : piece frame, mm"""
    bodies = body_of_facet(mesh)
    for number in range(int(bodies.max()) + 1):
        corners = mesh.corners[bodies == number]
        solid = float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) > 0.0
        lowest = float(corners[..., 2].min())
        if solid and lowest > _LOOSE_MM:
            x, y, z = corners.mean(axis=(0, 1))
            raise PlanningError(
                f"nothing of the part holds the body around ({x:.1f}, {y:.1f}, {z:.1f}) mm: it begins {lowest:.2f} mm above its base",
                "plan the bodies one by one",
            )


def _refuse_empty(regions: list[LayerRegion]) -> None:
    """Raise PlanningError where a layer holds nothing: what is above it would float."""
    for region in regions:
        if region.region.is_empty and not all(area.is_empty for area in region.areas):
            raise PlanningError(
                f"no outline lies on the side that the recipe asks for ({region.side}) all the way from z "
                f"{region.z_bottom:.3f} to {region.z_top:.3f} mm",
                "choose thinner layers or tolerance_side = outside",
            )
        if region.region.is_empty:
            raise PlanningError(
                f"nothing of the part lies between z {region.z_bottom:.3f} and {region.z_top:.3f} mm, but something above",
                "plan the bodies one by one",
            )


def _doubt_findings(regions: list[LayerRegion], style: ContourStyle) -> list[str]:
    """One line if contours are the facets' although the smooth surface was asked for."""
    count = doubted([section for region in regions for section in (region.bottom, region.middle, region.top)], style)
    return [f"{count} contours follow the facets where the smooth surface was in doubt"] if count else []


def _overhang_findings(regions: list[LayerRegion]) -> list[str]:
    return [
        f"layer {region.index}: {region.overhang_mm2:.1f} mm² at z {region.z_bottom:.2f} mm rest on nothing"
        for region in regions
        if region.overhang_mm2 > max(_OVERHANG_WORTH_MM2, 0.02 * region.areas[0].area)
    ]
