"""The proof of a plan or program on files: run in the twin, verdict for people and for programs, report and picture as files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellctl.cli import output
from cellctl.cli.input import DEFAULT_CELL, CellName, InputFault, Json, Units, checked_units, existing_file, writable

if TYPE_CHECKING:
    from config import Cell
    from planner.program import Program
    from sim.proof import Proof

OF_CHECKPOINTS = ("resumed", "checkpoint")  # how words of the proof begin that tell what became of states kept before


class Course:
    """Passes the proof's progress on, and keeps what it says of checkpoints."""

    def __init__(self, report: output.Report) -> None:
        self.notes: list[str] = []
        self._report = report

    def __call__(self, fraction: float, word: str) -> None:
        """One word of the proof, and how much of it is done, 0 to 1."""
        if word.startswith(OF_CHECKPOINTS):
            self.notes.append(word)
        else:
            self._report(f"proving: {word}", fraction)


def _program_of(path: Path, cell: Cell) -> tuple[Program, Path | None]:
    """A program's folder read, or a plan posted for the cell and the stock that its recipe names."""
    from planner.files import read_plan, read_program
    from planner.post import post as make_program
    from planner.recipe import parse_recipe

    if path.is_dir():
        return read_program(path), None
    plan = read_plan(existing_file(path, "plan or program folder"))
    stock = parse_recipe(plan.recipe_toml).stock if plan.process == "mill" else None
    return make_program(plan, cell), Path(stock) if stock else None


def prove(
    program: Annotated[Path, typer.Argument(metavar="PLAN|PROGRAM", help="A plan file, or a program's folder.")],
    mesh: Annotated[Path, typer.Option("--mesh", "--part", help="The part that it shall become.")],
    units: Units = "mm",
    stock: Annotated[
        Path | None, typer.Option("--stock", help="Mesh of what is milled (mm). Default: as the plan's recipe says.")
    ] = None,
    cell: CellName = DEFAULT_CELL,
    cell_mm: Annotated[float | None, typer.Option("--cell-mm", min=0.02, help="Grid of the simulated metal.")] = None,
    html: Annotated[
        Path | None, typer.Option("--html", help="Write the report into this file: one page to read, print and sign.")
    ] = None,
    png: Annotated[Path | None, typer.Option("--png", help="Write the picture into this file.")] = None,
    checkpoints: Annotated[
        Path | None,
        typer.Option("--checkpoints", help="Keep states at layers in this folder: an edited program goes on from there."),
    ] = None,
    json: Json = False,
) -> None:
    """Run a program in the twin and measure what it builds. Exit 1 if the proof does not pass."""
    from config import load_cell
    from planner.mesh import load
    from sim.dryrun import prove as make_proof
    from sim.report import html as report_of

    targets = [writable(path) for path in (html, png) if path is not None]
    if checkpoints is not None:
        _folder(checkpoints)
    facts = load_cell(cell)
    part = load(existing_file(mesh, "mesh file"), checked_units(units))
    with output.progress(quiet=json) as report:
        report("posting", 0.0)
        given, named = _program_of(program, facts)
        raw = stock or named
        course = Course(report)
        proof = make_proof(
            given,
            facts,
            part,
            stock=load(existing_file(raw, "stock's mesh file")) if raw else None,
            cell_mm=cell_mm,
            progress=course,
            checkpoints=checkpoints,
        )
        if html is not None:
            report("writing the report", 1.0)
            _write(html, report_of(proof, given, facts).encode())
    for note in course.notes:
        typer.echo(_plain(note), err=True)
    if png is not None and proof.picture:
        _write(png, proof.picture)
    if json:
        output.line(proof.to_json())
    else:
        _tell(proof, given)
        for path in targets:
            output.line(f"wrote {path}")
    raise typer.Exit(0 if proof.passed else 1)


def _folder(path: Path) -> None:
    """Make a folder, if need be. Raises InputFault."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputFault(f"{path}: no folder can be made there: {error.strerror}", "name another folder") from None


def _write(path: Path, data: bytes) -> None:
    """A file with these bytes. Raises InputFault."""
    try:
        path.write_bytes(data)
    except OSError as error:
        raise InputFault(f"{path}: cannot be written: {error.strerror}", "name a place that can be written") from None


def _tell(proof: Proof, program: Program) -> None:
    """Verdict, reasons and findings for a person."""
    from sim.report import where

    measured = f"99 % of the surface within {proof.deviation.p99_mm:.3f} mm (allowed {proof.allowed_mm:.3f} mm)"
    took = output.duration(proof.duration_s)
    output.line(_plain(f"{'passed' if proof.passed else 'NOT passed'}: {program.part_name}, {measured}, {took}"))
    for reason in proof.reasons:
        output.line(_plain(f"  {reason}"))
    for finding in proof.findings:
        depth = f", by {finding.depth_mm:.2f} mm" if finding.depth_mm > 0.0 else ""
        times = f", {finding.count} times" if finding.count > 1 else ""
        output.line(_plain(f"{finding.severity}: {finding.kind}: {finding.text}"))
        output.line(_plain(f"  where: {where(finding, program)}{depth}{times}"))
        if finding.help:
            output.line(_plain(f"  help: {finding.help}"))


def _plain(text: str) -> str:
    """One line for a terminal: what a program's text holds of control characters is shown as U+FFFD."""
    return "".join(char if char.isprintable() else "\N{REPLACEMENT CHARACTER}" for char in text)
