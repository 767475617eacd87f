"""The command that builds a part's approximation by ruled layers: model."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import output
from cellctl.cli.files import PartFile, direction_of
from cellctl.cli.input import InputFault, Json, Units, checked_units, existing_file, writable


def model(
    part: PartFile,
    out: Annotated[Path, typer.Option("--out", "-o", help="Model to write: .stl, .glb or .step.")] = Path("model.stl"),
    units: Units = "mm",
    cusp_mm: Annotated[float, typer.Option("--cusp", help="Greatest distance from the part, mm.")] = 0.04,
    direction: Annotated[str, typer.Option("--direction", help="Build direction: +x, or 1,0,0.")] = "+z",
    rule: Annotated[str, typer.Option("--rule", help="Walls: ruled or extruded.")] = "ruled",
    original: Annotated[bool, typer.Option("--original", help="Put the part beside it (.glb), transparent.")] = False,
    png: Annotated[Path | None, typer.Option("--png", help="Draw part and model into this file.")] = None,
    json: Json = False,
) -> None:
    """Approximate a part by layers with ruled sides; write it as one watertight body and measure it."""
    from planner.files.model_file import checked_suffix
    from planner.mesh import load
    from planner.model import approximate

    axis = direction_of(direction)
    if isinstance(axis, str):
        raise InputFault(
            f"--direction {direction}: a model needs a direction", "+x, -z, or three numbers such as 1,0,0"
        )
    if rule not in ("ruled", "extruded"):
        raise InputFault(f"--rule {rule}: is no rule of walls", "ruled or extruded")
    existing_file(part, "mesh file")
    checked_suffix(out)
    with output.progress(quiet=json) as report:
        report("reading the mesh", 0.0)
        mesh = load(part, checked_units(units))
        made = approximate(mesh, axis, cusp_mm, rule="ruled" if rule == "ruled" else "extruded", report=report)
        report("measuring", 0.9)
        found = made.deviation()
        made.export(writable(out), with_original=original)
        if png is not None:
            from planner.show.model_picture import model_png

            writable(png).write_bytes(model_png(made, part.stem))
    facts = {"model": str(out), "facets": len(made.triangles().facets), "notes": list(made.notes)}
    if json:
        output.as_json({**facts, **asdict(made.counts), "cusp_mm": cusp_mm, "deviation": asdict(found)})
        return
    counts = made.counts
    output.line(f"{part.name}: {counts.layers} layers, {counts.contours} contours, {counts.branchings} branchings")
    output.line(
        f"deviation {found.max_mm:.4g} mm (99 % below {found.p99_mm:.4g}), volume {100.0 * found.volume_error:+.3f} %"
    )
    for note in made.notes:
        output.line(f"  {note}")
    output.line(f"{out}: {facts['facets']} facets")
