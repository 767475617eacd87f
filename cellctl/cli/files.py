"""Commands on files, without any service: plan, show, post; prove is in its own file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cellctl.cli import output
from cellctl.cli.input import DEFAULT_CELL, CellName, InputFault, Json, Units, checked_units, existing_file, writable

if TYPE_CHECKING:
    from planner.recipe import Recipe

PartFile = Annotated[Path, typer.Argument(metavar="PART", help="Mesh file: STL, 3MF, OBJ or PLY.")]


def direction_of(text: str) -> tuple[float, float, float] | str:
    """A build direction: `auto`, an axis with sign (`+x`), or three numbers (`1,0,0`). Raises InputFault."""
    axes = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
    if text == "auto":
        return text
    if (letter := text.lstrip("+-")) in axes and len(text) <= 2:
        sign = -1.0 if text.startswith("-") else 1.0
        x, y, z = (sign * value for value in axes[letter])
        return (x, y, z)
    try:
        x, y, z = (float(word) for word in text.replace(",", " ").split())
    except ValueError:
        raise InputFault(
            f"--direction {text}: is no direction", "auto, +x, -z, or three numbers such as 1,0,0"
        ) from None
    return (x, y, z)


def recipe_with(file: Path | None, changes: dict[str, Any]) -> Recipe:
    """The recipe of a file, or the usual one, with what the command line says instead. Raises RecipeError."""
    from pydantic import ValidationError

    from config import explain
    from planner.errors import RecipeError
    from planner.recipe import Recipe, load_recipe

    recipe = load_recipe(existing_file(file, "recipe")) if file else Recipe()
    given = {name: value for name, value in changes.items() if value is not None}
    try:
        return Recipe.model_validate({**recipe.model_dump(), **given})
    except ValidationError as error:
        raise RecipeError(f"recipe: {explain(error)}", "correct the option that is named") from None


def plan(
    part: PartFile,
    out: Annotated[Path, typer.Option("--out", "-o", help="The plan to write (HDF5).")] = Path("plan.h5"),
    recipe: Annotated[Path | None, typer.Option("--recipe", help="Recipe (TOML).")] = None,
    units: Units = "mm",
    material: Annotated[str | None, typer.Option("--material", help="Name or file of a material.")] = None,
    process: Annotated[str | None, typer.Option("--process", help="hybrid, deposit or mill.")] = None,
    direction: Annotated[str | None, typer.Option("--direction", help="Build direction: auto, +x, or 1,0,0.")] = None,
    tolerance_mm: Annotated[float | None, typer.Option("--tolerance", help="Of the finished surface, mm.")] = None,
    cusp_mm: Annotated[float | None, typer.Option("--cusp", help="Greatest cusp height, mm.")] = None,
    json: Json = False,
) -> None:
    """Plan a part: mesh and recipe in, plan.h5 out."""
    from planner.files import write_plan
    from planner.mesh import load_checked
    from planner.pipeline import plan as make_plan

    existing_file(part, "mesh file")
    changes = {"material": material, "process": process, "tolerance_mm": tolerance_mm, "cusp_mm": cusp_mm}
    wanted = recipe_with(recipe, {**changes, "build_direction": direction_of(direction) if direction else None})
    with output.progress(quiet=json) as report:
        report("reading the mesh", 0.0)
        loaded = load_checked(part, checked_units(units))
        made = make_plan(loaded, wanted, part_name=part.stem, progress=report)
        write_plan(made, writable(out))
    size = [float(value) for value in loaded.mesh.size]
    found = list(made.findings)
    if json:
        counts = {"layers": len(made.layers), "operations": len(made.operations)}
        output.as_json(
            {
                "plan": str(out),
                "size_mm": size,
                "units": units,
                "mesh_findings": found,
                "plan_findings": list(made.findings),
                **counts,
            }
        )
        return
    output.line(
        f"{part.name}: {' × '.join(f'{value:.4g}' for value in size)} mm (file in {units}), {len(loaded.mesh.facets)} facets"
    )
    for text in found:
        output.line(f"  {text}")
    output.line(f"{out}: {len(made.layers)} layers, {len(made.operations)} operations")


def show(
    plan: Annotated[Path, typer.Argument(help="A plan file.")],
    png: Annotated[Path | None, typer.Option("--png", help="Draw it into this file.")] = None,
    html: Annotated[Path | None, typer.Option("--html", help="Write a page that shows it.")] = None,
    json: Json = False,
) -> None:
    """Show a plan: text, --json, --png FILE or --html FILE."""
    from planner import show as shown
    from planner.files import read_plan

    made = read_plan(existing_file(plan, "plan"))
    if png is not None:
        writable(png).write_bytes(shown.png(made))
        output.line(str(png))
    if html is not None:
        writable(html).write_text(shown.html(made), encoding="utf-8")
        output.line(str(html))
    if json:
        output.line(shown.as_json(made))
    elif png is None and html is None:
        output.line(shown.text(made))


def post(
    plan: Annotated[Path | None, typer.Argument(help="A plan file.")] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the program.")] = Path("program"),
    cell: CellName = DEFAULT_CELL,
    dialect: Annotated[
        str, typer.Option("--dialect", help="grblhal, linuxcnc, siemens, fanuc, heidenhain or apt.")
    ] = "grblhal",
    selftest: Annotated[
        bool, typer.Option("--selftest", help="A probe program that checks signs and pivots of the machine.")
    ] = False,
    readings: Annotated[
        Path | None, typer.Option("--readings", help="With --selftest: the control's [PRB:...] lines, to be judged.")
    ] = None,
    json: Json = False,
) -> None:
    """Post a plan for a cell: G-code per layer, a line table and the process schedule."""
    if selftest:
        from cellctl.cli.selftest import selftest as write_selftest

        write_selftest(cell, out, readings, json)
        return
    if plan is None:
        raise InputFault("post: no plan file", "name one, or ask for --selftest")
    from config import load_cell
    from planner.files import read_plan, write_program
    from planner.post import post_with_report

    facts = load_cell(cell)
    with output.progress(quiet=json) as report:
        report("posting", 0.0)
        program, found = post_with_report(read_plan(existing_file(plan, "plan")), facts, dialect=dialect)
        write_program(program, out)
    summary = {
        "program": str(out),
        "cell": facts.name,
        "dialect": dialect,
        "lines": len(program.lines),
        "layers": len(program.layer_starts) - 1,
    }
    if json:
        output.as_json({**summary, "duration_s": float(program.duration_s), "findings": list(found.findings)})
    else:
        took = output.duration(float(program.duration_s))
        size = f"{summary['lines']} lines of {dialect} in {summary['layers']} layers"
        output.line(f"{out}: {size} for {facts.name}, about {took}")
        for text in found.findings:
            output.line(f"  {text}")
