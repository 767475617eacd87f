"""What the workers do, each a call into planner or sim with files on both sides. Imports are inside: a worker loads what it needs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cellctl.planning.continuing import resume, standing_of
from cellctl.planning.task import (
    MESH_FILE,
    PICTURE_FILE,
    PLAN_FILE,
    PROGRAM_FOLDER,
    PROOF_FILE,
    REPORT_FILE,
    SURFACE_FILE,
    VIEW_FOLDER,
    Task,
)

if TYPE_CHECKING:
    from config.cell import Cell
    from planner.mesh import Finding, Mesh
    from planner.plan import Plan
    from planner.recipe import Recipe

Report = Callable[[str, float], None]


def finding_document(finding: Finding) -> dict[str, Any]:
    """A finding of the mesh as JSON; place in mm or null."""
    place = None if finding.place is None else [round(float(value), 4) for value in finding.place]
    return {
        "kind": finding.kind,
        "count": finding.count,
        "place_mm": place,
        "mended": finding.mended,
        "volume_change_mm3": float(finding.volume_change_mm3),
        "text": str(finding),
    }


def inspect(task: Task, report: Report) -> dict[str, Any]:
    """Load and check the mesh; writes the mended one as binary STL. Raises MeshError."""
    from planner.mesh import load_checked

    report("reading the mesh", 0.0)
    loaded = load_checked(Path(task.mesh), task.units)
    loaded.mesh.to_trimesh().export(Path(task.folder) / MESH_FILE, file_type="stl")
    return {
        "mesh_sha256": loaded.mesh.sha256,
        "bbox_mm": loaded.mesh.bounds.tolist(),
        "facets": len(loaded.mesh.facets),
        "volume_mm3": loaded.mesh.volume,
        "findings": [finding_document(finding) for finding in loaded.findings],
    }


def recipe_of(task: Task) -> Recipe:
    """The task's recipe, its stock named by file. Raises RecipeError."""
    from planner.recipe import parse_recipe

    recipe = parse_recipe(task.recipe_toml, f"recipe of {task.part_name}")
    return recipe.model_copy(update={"stock": task.stock}) if task.stock else recipe


def check_size(mesh: Mesh, recipe: Recipe, cell_file: str) -> None:
    """Refuse, before time goes into its plan, a part that is too large for the cell whichever way the planner may build it.

    Where it will stand is known with its plan (`check_room`). Raises PlannerError, ConfigError.
    """
    import numpy as np

    from planner.decompose.direction import build_directions
    from planner.errors import PostError
    from planner.pipeline import build_frame
    from planner.post.room import check_volume, table_from_build

    cell = _cell(cell_file)
    low, high = np.array(cell.build_volume.min_mm), np.array(cell.build_volume.max_mm)
    refused: list[PostError] = []
    for direction in build_directions(mesh, recipe):
        placed = table_from_build((0.0, 0.0, 0.0), cell.placement.rotation_deg)
        bounds = mesh.transformed(build_frame(mesh, direction, recipe.turn_deg)).bounds
        placed[:3, 3] = 0.5 * (low + high) - placed[:3, :3] @ bounds.mean(axis=0)
        try:
            check_volume(bounds, cell, placed)
        except PostError as error:
            refused.append(error)
        else:
            return
    raise refused[0]


def check_powder(recipe: Recipe, cell_file: str) -> None:
    """Refuse a powder that the cell is not fed. Raises PostError, ConfigError."""
    from planner.errors import PostError

    cell = _cell(cell_file)
    if recipe.process != "mill" and cell.materials is not None and recipe.material not in cell.materials:
        raise PostError(
            f"material: asked {recipe.material}, {cell.name} is fed {', '.join(cell.materials) or 'no powder'} only",
            "name one of these in the recipe, take another cell, or add it to `materials` of the cell file",
        )


def check_room(plan: Plan, cell_file: str) -> None:
    """Refuse a part that has no room in the cell as its plan places it. Raises PlannerError, ConfigError."""
    from planner.post.room import check_volume, table_from_build

    cell = _cell(cell_file)
    check_volume(plan.bounds, cell, table_from_build(cell.placement.part_origin_mm, cell.placement.rotation_deg))


def _cell(cell_file: str) -> Cell:
    from config import load_cell

    return load_cell(cell_file)


def plan(task: Task, report: Report) -> dict[str, Any]:
    """Plan the part; writes each layer's view as soon as it is ready, then plan.h5. Raises PlannerError, ConfigError."""
    from cellctl.planning.view import write_layer, write_overview
    from planner.files import write_plan
    from planner.mesh import load_checked
    from planner.pipeline import plan as make_plan
    from planner.pipeline import recipe_text
    from planner.recipe import parse_recipe

    loaded = load_checked(Path(task.mesh), task.units)
    recipe = recipe_of(task)
    if task.cell:
        check_powder(recipe, task.cell)
        check_size(loaded.mesh, recipe, task.cell)
    views = Path(task.folder) / VIEW_FOLDER
    views.mkdir()
    number = count()
    made = make_plan(
        loaded,
        recipe,
        part_name=task.part_name,
        progress=report,
        on_layer=lambda layer: write_layer(layer, next(number), views),
    )
    if task.cell:
        check_room(made, task.cell)
    made = replace(made, recipe_toml=recipe_text(parse_recipe(task.recipe_toml)))  # the stock by its name: its file lies elsewhere on other machines
    write_plan(made, Path(task.folder) / PLAN_FILE)
    write_overview(made, views)
    return {"layers": len(made.layers), "findings": list(made.findings), "volumes_mm3": dict(made.volumes_mm3)}


def post(task: Task, report: Report) -> dict[str, Any]:
    """Post the plan for the cell; writes the program's folder, and beside it the form that a run opens. Raises PlannerError, ConfigError."""
    from cellctl.cell.program_form import form_beside, write_form
    from cellctl.planning.track import track_beside, write_track
    from config import load_cell
    from planner.files import read_plan, write_program
    from planner.post import post as make_program

    report("posting", 0.0)
    cell = load_cell(task.cell)
    planned = replace(read_plan(Path(task.plan)), stock_file=task.stock)
    made = make_program(planned, cell, dialect=cell.cnc.firmware)
    folder = Path(task.folder) / PROGRAM_FOLDER
    write_program(made, folder)
    write_track(made, track_beside(folder))
    write_form(made, cell, form_beside(folder), hashlib.sha256((folder / "program.json").read_bytes()).hexdigest())
    return {"lines": len(made.lines), "duration_s": float(made.duration_s)}


def prove(task: Task, report: Report) -> dict[str, Any]:
    """Run the program in the twin; writes proof.json, proof.png, proof.html and proof.surface. Raises what planner, config and twin raise."""
    from cellctl.planning.surface import surface_bytes
    from config import load_cell
    from planner.files import read_program
    from planner.mesh import load
    from sim.dryrun import prove as make_proof
    from sim.report import html

    cell = load_cell(task.cell)
    program = read_program(Path(task.program))
    mesh = load(Path(task.mesh), task.units)
    stock = load(Path(task.stock)) if task.stock else None
    start = standing_of(task, cell, mesh, stock, report)
    proof = make_proof(
        program,
        cell,
        mesh,
        stock=stock,
        progress=lambda fraction, word: report(f"proving: {word}", fraction),
        checkpoints=Path(task.checkpoints) if task.checkpoints else None,
        start=start,
    )
    folder = Path(task.folder)
    text = proof.to_json()
    (folder / PROOF_FILE).write_text(text, encoding="utf-8")
    if proof.picture:
        (folder / PICTURE_FILE).write_bytes(proof.picture)
    if proof.built is not None and len(proof.built[1]):
        (folder / SURFACE_FILE).write_bytes(surface_bytes(*proof.built, proof.tolerance_mm))
    report("writing the report", 1.0)
    (folder / REPORT_FILE).write_text(html(proof, program, cell), encoding="utf-8")
    document: dict[str, Any] = json.loads(text)
    return document


STAGES: dict[str, Callable[[Task, Report], dict[str, Any]]] = {
    "inspect": inspect,
    "plan": plan,
    "post": post,
    "resume": resume,
    "prove": prove,
}
