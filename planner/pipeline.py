"""From a mesh and a recipe to a Plan: the stages, one call each."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import shapely
import tomli_w
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.decompose.bores import filled, hanging_bores
from planner.decompose.direction import best_direction
from planner.errors import PlanningError, RecipeError
from planner.handout import Handout
from planner.mesh.mesh import Mesh, mesh_of
from planner.plan import Layer, Plan
from planner.process import Bead, Settings
from planner.recipe import Recipe
from planner.slicing.contours import ContourStyle, doubted
from planner.slicing.fitted import fitted_shapes
from planner.slicing.layers import layer_levels
from planner.slicing.regions import LayerRegion, layer_regions
from planner.slicing.section import plane_frame
from planner.toolpath.bands import make_bands
from planner.toolpath.bore import Boring, borings
from planner.toolpath.order import Sequence, build_up
from planner.toolpath.roughing import carve, stock_of

Floats = NDArray[np.float64]
Progress = Callable[[str, float], None]

TOP_RESERVE = 0.35
"""Of the layer's height, deposited more where a top is finished: the valleys between tracks, which a next layer would
fill, must lie above the plane to which the top is faced."""
TOP_SHARE = 0.02  # of a layer's top; smaller free rims belong to leaning walls
_OVERHANG_WORTH_MM2 = 0.5  # smaller unsupported areas are the rounding of sections


def plan(
    mesh: object,
    recipe: Recipe,
    *,
    part_name: str = "part",
    progress: Progress | None = None,
    findings: Iterable[str] = (),
    on_layer: Callable[[Layer], None] | None = None,
) -> Plan:
    """How to make a part: layers, contours, walls and operations in its build frame.

    mesh : planner.mesh.Mesh, its LoadedMesh (findings are taken over) or a `trimesh.Trimesh`, mm
    progress : told each stage and the share of the work done, 0 … 1   findings : lines to put before the planner's own
    on_layer : handed each layer as soon as nothing will be added to it, in the order in which they are made, long before
    the last is ready; the same layers are in the Plan.
    The same mesh and recipe give the same Plan.
    Raises MeshError, RecipeError or PlanningError, one line each.
    """
    say = progress or (lambda stage, share: None)
    body, found = _body_and_findings(mesh)
    found = [*findings, *found]
    say("orient", 0.0)
    settings = Settings.from_recipe(recipe)
    direction, chosen = build_direction(body, recipe)
    build_from_part = build_frame(body, direction, recipe.turn_deg)
    part = body.transformed(build_from_part)
    solid, holes, bored = _bored(part, settings)
    say("layers", 0.02)
    regions, notes = _regions(solid, settings, lambda: say("sections", 0.05))
    say("contours", 0.1)
    handout = Handout(solid, recipe, len(regions), on_layer, lambda share: say("toolpaths", 0.1 + 0.9 * share))
    sequence = _sequence(solid, build_from_part, regions, settings, handout, holes)
    layers = handout.finish()
    if recipe.process != "mill":
        notes += _overhang_findings(regions)
    notes += _doubt_findings(regions, ContourStyle.from_recipe(recipe))
    say("done", 1.0)
    return Plan(
        part_name=part_name,
        mesh_sha256=body.sha256,
        recipe_toml=recipe_text(recipe),
        material=settings.material.name,
        process=recipe.process,
        tolerance_mm=recipe.tolerance_mm,
        build_from_part=build_from_part,
        bounds=part.bounds,
        layers=tuple(layers),
        findings=(*found, *chosen, *bored, *notes, *sequence.findings),
        volumes_mm3=_volumes(part, sequence, settings),
    )


def _bored(part: Mesh, settings: Settings) -> tuple[Mesh, list[Boring], list[str]]:
    """What is built: the part with those hanging bores full that are cut from the side afterwards; these, and findings."""
    if settings.recipe.process != "hybrid":
        return part, [], []
    bores = hanging_bores(part, settings.material.deposition.max_overhang_deg, settings.recipe.crease_deg)
    holes, notes = borings(filled(part, bores), bores, settings)
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
    part: Mesh,
    build_from_part: Floats,
    regions: list[LayerRegion],
    settings: Settings,
    handout: Handout,
    holes: list[Boring],
) -> Sequence:
    """All operations in order; the handout is told each layer that is done."""
    if settings.recipe.process == "mill":
        return carve(stock_of(part, settings.recipe, build_from_part), regions, settings, handout.take)
    tops = finished_tops(regions, settings)
    beads = layer_beads(regions, tops, settings)
    bands = make_bands(regions, part, settings) if settings.is_milled else iter(())
    return build_up(regions, beads, tops, bands, settings, handout.take, holes)


def build_direction(mesh: Mesh, recipe: Recipe) -> tuple[Floats, list[str]]:
    """The unit build direction in the part frame, and what was decided.  Raises RecipeError if it has no length."""
    if recipe.build_direction == "auto":
        return best_direction(mesh)
    vector = np.array(recipe.build_direction, dtype=np.float64)
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise RecipeError("build_direction: asked (0, 0, 0), it needs a length", 'give a vector or "auto"')
    return vector / length, []


def build_frame(mesh: Mesh, direction: Floats, turn_deg: float = 0.0) -> Floats:
    """(4, 4) float   build_from_part: z along the direction, the box's centre at x = y = 0, its lowest point at z = 0.

    turn_deg : counter-clockwise about z.
    """
    rotation = plane_frame(np.concatenate([np.zeros(3), direction]))[1:]
    if turn_deg:
        cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ rotation
    turned = mesh.vertices[np.unique(mesh.facets)] @ rotation.T
    low, high = turned.min(axis=0), turned.max(axis=0)
    build_from_part = np.eye(4)
    build_from_part[:3, :3] = rotation
    build_from_part[:3, 3] = -np.array([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]])
    return build_from_part


def recipe_text(recipe: Recipe) -> str:
    """The recipe as TOML, every field that is set, in the order of its definition."""
    return tomli_w.dumps({key: value for key, value in recipe.model_dump().items() if value is not None})


def finished_tops(regions: list[LayerRegion], settings: Settings) -> list[bool]:
    """Which layers have a top that is faced and stays: part of it carries nothing of the next layer."""
    lowers = [*(region.areas[0] for region in regions[1:]), MultiPolygon()]
    return [settings.is_milled and _has_top(region, above) for region, above in zip(regions, lowers, strict=True)]


def layer_beads(regions: list[LayerRegion], tops: list[bool], settings: Settings) -> list[Bead]:
    """The bead of each layer.  tops : which have a finished face.

    Raises RecipeError if no bead fills one, or if only milling could bring one down.
    """
    if settings.is_milled:
        return [
            settings.bead_for(region.height_mm, TOP_RESERVE if is_top else 0.0)
            for region, is_top in zip(regions, tops, strict=True)
        ]
    beads = [settings.bead_for(region.height_mm) for region in regions]
    for region, bead in zip(regions, beads, strict=True):
        most = region.height_mm * (1.0 + settings.overbuild) * 1.05
        if bead.height_mm > most:
            raise RecipeError(
                f"layer {region.index}: {region.height_mm:.3g} mm high, but the lowest bead of {settings.material.name} makes "
                f"{bead.height_mm:.3g} mm and process = deposit mills nothing down",
                "choose higher layers, less powder or process = hybrid",
            )
    return beads


def _has_top(region: LayerRegion, above: MultiPolygon) -> bool:
    """Whether part of a layer's top is a finished face: nothing of the next layer stands on it."""
    return bool(shapely.difference(region.areas[2], above).area > TOP_SHARE * region.areas[2].area)


def _body_and_findings(mesh: object) -> tuple[Mesh, list[str]]:
    """The mesh itself and the findings that came with it."""
    loaded = getattr(mesh, "mesh", None)
    if loaded is not None:
        return mesh_of(loaded), [str(finding) for finding in getattr(mesh, "findings", ())]
    return mesh_of(mesh), []


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


def _volumes(part: Mesh, sequence: Sequence, settings: Settings) -> dict[str, float]:
    milled = max(sequence.deposited_mm3 - part.volume, 0.0) if settings.is_milled else 0.0
    return {"deposited": sequence.deposited_mm3, "milled": milled, "part": part.volume}
