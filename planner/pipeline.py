"""From a mesh and a recipe to a Plan: the stages, one call each."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import tomli_w

from planner.compose.assembly import assemble
from planner.compose.engaging import engagement_findings
from planner.compose.gouging import gouge_findings
from planner.compose.plate import on_plate
from planner.decompose.direction import build_direction, build_frame
from planner.decompose.division import divide
from planner.decompose.pieces import Division
from planner.mesh.mesh import Mesh, mesh_of
from planner.plan import Layer, Plan
from planner.process import Settings
from planner.recipe import Recipe
from planner.toolpath.balance import plan_balance
from planner.toolpath.books import books_figures, books_findings

__all__ = ["build_direction", "build_frame", "plan", "recipe_text"]

Progress = Callable[[str, float], None]

_DIVIDED = 0.05  # of the work: what goes before the first layer


def plan(
    mesh: object,
    recipe: Recipe,
    *,
    part_name: str = "part",
    progress: Progress | None = None,
    findings: Iterable[str] = (),
    on_layer: Callable[[Layer], None] | None = None,
) -> Plan:
    """How to make a part: pieces, layers, contours, walls and operations in its build frame.

    mesh : planner.mesh.Mesh, its LoadedMesh (findings are taken over) or a `trimesh.Trimesh`, mm
    progress : told each stage and the share of the work done, 0 … 1   findings : lines to put before the planner's own
    on_layer : handed each layer as soon as nothing will be added to it, in the order in which they are made, long before
    the last is ready; the same layers are in the Plan.
    The same mesh and recipe give the same Plan.
    Raises MeshError, RecipeError or PlanningError, one line each.
    """
    say = progress or (lambda stage, share: None)
    body, found = _body_and_findings(mesh)
    say("orient", 0.0)
    settings = Settings.from_recipe(recipe)
    division, placed = on_plate(divide(body, recipe, settings), recipe)
    made = assemble(division, settings, on_layer, lambda stage, share: say(stage, _DIVIDED + (1.0 - _DIVIDED) * share))
    gouges = _gouges(division, made.layers, body, settings)
    books = plan_balance(made.layers, settings)
    say("done", 1.0)
    return Plan(
        part_name=part_name,
        mesh_sha256=body.sha256,
        recipe_toml=recipe_text(recipe),
        material=settings.material.name,
        process=recipe.process,
        tolerance_mm=recipe.tolerance_mm,
        build_from_part=division.build_from_part,
        bounds=body.transformed(division.build_from_part).bounds,
        layers=made.layers,
        findings=(*findings, *found, *division.findings, *placed, *made.findings, *books_findings(books, made.layers, settings), *gouges),
        volumes_mm3=made.volumes_mm3,
        books=books_figures(books) or {},
        subcomponents=made.subcomponents,
        setups=made.setups,
        skeleton=division.skeleton,
        candidates=division.candidates,
    )


def _gouges(division: Division, layers: tuple[Layer, ...], body: Mesh, settings: Settings) -> list[str]:
    """What milling cuts too deep, one line each, and where its cutters stand in too much metal."""
    if not settings.is_milled:
        return []
    part = body.transformed(division.build_from_part)
    recipe = settings.recipe
    deep = gouge_findings(division.pieces, layers, part, recipe.tolerance_mm, from_block=recipe.process == "mill")
    return [*deep, *engagement_findings(layers, settings)]


def recipe_text(recipe: Recipe) -> str:
    """The recipe as TOML, every field that is set, in the order of its definition."""
    return tomli_w.dumps(recipe.model_dump(exclude_none=True))


def _body_and_findings(mesh: object) -> tuple[Mesh, list[str]]:
    """The mesh itself and the findings that came with it."""
    loaded = getattr(mesh, "mesh", None)
    if loaded is not None:
        return mesh_of(loaded), [str(finding) for finding in getattr(mesh, "findings", ())]
    return mesh_of(mesh), []
