"""The findings: a table of all, and for each that has a place a close-up with the lines of the Program around it."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from config import Cell
from sim import job as facts
from sim.job import Job
from sim.report.bends import Bends
from sim.report.chart import number
from sim.report.closeup import HALF_MM, HALF_OF_BODIES_MM, Mesh, closeup
from sim.report.markup import Node, table, tag
from sim.report.silhouette import Scene, mode_of

if TYPE_CHECKING:
    from sim.findings import Finding
    from sim.proof import Proof

Array = NDArray[np.float64]

PICTURES_MAX = 16  # of places: enough to see what is wrong, and the page stays small
TEXT_LINES = 2  # of the Program shown before and after the line at fault
PATH_LINES = 80  # of the commanded path drawn before and after
OF_BODIES = ("collision", "clearance", "gouge", "rapid in metal", "spindle off")  # kinds whose picture shows the tool, and what it met
WIDE_VIEW = ("collision", "clearance")
MODES: dict[int | None, str] = {facts.SAFE: "safe", facts.DEPOSIT: "deposition", facts.MILL: "milling"}
SIGNS = {"error": "\N{BALLOT X} error", "warning": "\N{WARNING SIGN}\N{VARIATION SELECTOR-15} warning"}


def mode_at(program: Job, line: int) -> str:
    """What the cell is set to do at a line: the last mode of the schedule up to it; empty before the first."""
    return MODES.get(mode_of(program, line), "")


def commanded_at(program: Job, line: int) -> Array | None:
    """(3,) mm, build frame: where the Program's table has the tip at the end of a line; None if it does not say."""
    if not 0 < line <= len(program.table) or "tip_end" not in (program.table.dtype.names or ()):
        return None
    return np.asarray(program.table[line - 1]["tip_end"], dtype=np.float64)


def place_of(finding: Finding, program: Job) -> Array | None:
    """(3,) mm, build frame: where the twin saw it, else where its line ends; None for what concerns the whole Program."""
    if finding.at_mm is not None:
        return np.asarray(finding.at_mm, dtype=np.float64)
    return commanded_at(program, finding.line)


def unbroken(text: str) -> str:
    """The text with its coordinates kept together on one line each."""
    return re.sub(r"(?<=\b[XYZ]) (?=[\N{MINUS SIGN}0-9])|(?<=[0-9]) (?=mm\b)", "\N{NO-BREAK SPACE}", text)


def where(finding: Finding, program: Job) -> str:
    """Line, layer, operation and millimetres in words."""
    if finding.line <= 0:
        return "whole Program"
    words = [f"line N{finding.line}"]
    if finding.layer >= 0:
        words.append(f"layer {finding.layer}")
    if finding.operation >= 0:
        mode = mode_at(program, finding.line)
        words.append(f"operation {finding.operation}" + (f" ({mode})" if mode else ""))
    at = place_of(finding, program)
    if at is not None:
        x, y, z = (f"{value:.2f}".replace("-", "\N{MINUS SIGN}") for value in at)
        words.append(f"X {x}  Y {y}  Z {z} mm" + ("" if finding.at_mm is not None else " (commanded end of the line)"))
    return ", ".join(words)


def section(proof: Proof, program: Job, cell: Cell) -> list[Node]:
    """Table and pictures of all findings, errors first."""
    if not proof.findings:
        return [tag("h2", "Findings"), tag("p", "None: nothing that the twin checks went wrong on any line.")]
    ranked = sorted(proof.findings, key=lambda finding: finding.severity != "error")  # stable: else in the order seen
    rows: list[tuple[Node | str, ...]] = [
        (
            str(index),
            tag("span", SIGNS.get(finding.severity, finding.severity), class_="error" if finding.severity == "error" else "warning"),
            tag("div", tag("b", finding.kind), tag("br"), finding.text),
            unbroken(where(finding, program)),
            f"{finding.depth_mm:.2f} mm" if finding.depth_mm > 0.0 else "\N{EN DASH}",
            f"{finding.count} \N{MULTIPLICATION SIGN}",
            finding.help or "\N{EN DASH}",
        )
        for index, finding in enumerate(ranked, 1)
    ]
    names = ("No.", "Severity", "What", "Where (build frame)", "#Extent", "#Seen", "What would help")
    seen = [(index, finding, place_of(finding, program)) for index, finding in enumerate(ranked, 1)]
    placed = [(index, finding, at) for index, finding, at in seen if at is not None]
    scene = Scene(program, cell) if placed and proof.built is not None else None
    bends = Bends(program, cell)
    pictures = [_place(index, finding, at, proof, program, bends, scene) for index, finding, at in placed[:PICTURES_MAX]]
    return [
        tag("h2", f"Findings ({len(ranked)})"),
        table(names, rows, "findings"),
        *_intro(len(placed), proof.tolerance_mm),
        tag("div", *pictures, class_="places"),
    ]


def _intro(places: int, tolerance_mm: float) -> list[Node]:
    if not places:
        return []
    only = f" The first {PICTURES_MAX} of {places} places are shown." if places > PICTURES_MAX else ""
    words = (
        "Each place in the metal as it stands at the end of the run: the ring marks it, the heavy line is the path of the line at fault,"
        " thin lines the path before and after, as commanded. Outlines show the tool, its axis and tip (full), and the body it met (dashed),"
        f" where the line comes nearest to the place. Colours as above, \N{PLUS-MINUS SIGN}{number(2.0 * tolerance_mm)} mm."
    )
    return [tag("p", words + only, class_="soft")]


def _place(
    index: int, finding: Finding, at: Array, proof: Proof, program: Job, bends: Bends, scene: Scene | None
) -> Node:
    """Close-up and text of one place."""
    title = f"{index}. {finding.kind}: {unbroken(where(finding, program))}"
    picture = None
    if proof.built is not None:
        before, here, after = _paths(program, bends, finding.line)
        mesh: Mesh = proof.built
        stand = scene.at(finding) if scene is not None and finding.kind in OF_BODIES else None
        half_mm = HALF_OF_BODIES_MM if stand is not None and finding.kind in WIDE_VIEW else HALF_MM
        picture = closeup(mesh, at, [before, after], here, 2.0 * proof.tolerance_mm, title, stand, half_mm)
    return tag("figure", tag("h3", title), picture, excerpt(program, finding.line), class_="place")


def _paths(program: Job, bends: Bends, line: int) -> tuple[Array, Array, Array]:
    """The commanded tip before, along and after a line, each (n, 3) mm."""
    none = np.zeros((0, 3))
    if commanded_at(program, line) is None:
        return none, none, none
    index, last = line - 1, len(program.table) - 1
    before = bends.path(max(0, index - PATH_LINES), index - 1) if index else none
    return before, bends.path(max(0, index - 1), index), bends.path(index, min(index + PATH_LINES, last))


def excerpt(program: Job, line: int) -> Node | None:
    """The Program's text around a line, that line marked; None where there is no such line."""
    if not 0 < line <= len(program.lines):
        return None
    shown: list[Node | str] = []
    for index in range(max(0, line - 1 - TEXT_LINES), min(len(program.lines), line + TEXT_LINES)):
        text = program.lines[index]
        cut = text if len(text) <= 160 else text[:160] + "\N{HORIZONTAL ELLIPSIS}"
        shown.append(tag("b", f"\N{BLACK RIGHT-POINTING TRIANGLE} {cut}") if index == line - 1 else f"  {cut}\n")
    return tag("pre", *shown)
