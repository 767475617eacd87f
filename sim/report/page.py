"""The whole page: head, verdict, thresholds, figures, and the sections in the order in which an engineer reads them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from config import Cell, Material, load_material
from sim.job import Job
from sim.report import closing, course, found, surface
from sim.report.checks import Check, checks_of
from sim.report.markup import Node, StyleSheet, table, tag
from sim.report.style import PAGE_POLICY, STYLE

if TYPE_CHECKING:
    from sim.proof import Proof

class Documented(Job, Protocol):
    """A Program that also says what it was made from."""

    @property
    def plan_sha256(self) -> str:
        """Hash (hex) of the plan."""

    @property
    def mesh_sha256(self) -> str:
        """Hash (hex) of the part's mesh."""


PROCESSES = {"hybrid": "hybrid: deposited and milled in turn", "deposit": "deposited only", "mill": "milled only"}


def html(proof: Proof, program: Documented, cell: Cell, material: Material | None = None) -> str:
    """The report of a proof as one HTML file: no script, nothing from elsewhere, pictures inside; equal proofs give equal bytes.

    material : default: the one that the Program names
    """
    powder = material or load_material(program.material)
    body = tag(
        "body",
        *_head(proof, program, cell, powder),
        _verdict(proof),
        *_thresholds(checks_of(proof)),
        *surface.section(proof),
        *found.section(proof, program, cell),
        *course.section(proof, program),
        *closing.section(proof, cell, powder),
    )
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=PAGE_POLICY),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", f"Proof of {program.part_name}: {'passed' if proof.passed else 'not passed'}"),
        StyleSheet("style", (), (STYLE,)),
    )
    return f"<!doctype html>\n{tag('html', head, body, lang='en')}\n"


def _head(proof: Proof, program: Documented, cell: Cell, material: Material) -> list[Node]:
    """What was proven. There is no date: the same Program gives the same report; the service keeps when it was made."""
    pairs: list[tuple[str, str, str]] = [
        ("Process", PROCESSES.get(program.process, program.process), ""),
        ("Cell", cell.name, ""),
        ("Material", material.name, ""),
        ("Tolerance", f"\N{PLUS-MINUS SIGN}{program.tolerance_mm:g} mm", ""),
        ("Grid of the twin", f"{proof.deviation.cell_mm:g} mm", ""),
        ("Lines run", f"{proof.lines_executed} of {proof.lines}", ""),
        ("Machine time", duration(proof.duration_s), ""),
        ("Program, SHA-256", proof.program_sha256, "hash"),
        ("Plan, SHA-256", program.plan_sha256, "hash"),
        ("Mesh, SHA-256", program.mesh_sha256, "hash"),
        ("Cell, SHA-256", cell.sha256, "hash"),
    ]
    rows = [
        tag("div", tag("dt", name), tag("dd", text, class_="hash" if kind else None), class_="wide" if kind else None)
        for name, text, kind in pairs
    ]
    return [tag("p", "Proof of a Program in the twin of the cell", class_="kind"), tag("h1", program.part_name), tag("dl", *rows, class_="pairs")]


def _verdict(proof: Proof) -> Node:
    """Passed or not, in words and a sign, with every reason."""
    if proof.passed:
        warnings = sum(finding.severity != "error" for finding in proof.findings)
        said = f", {warnings} warning{'s' if warnings > 1 else ''} to read below" if warnings else ""
        words = f"The twin ran all {proof.lines} lines of the Program and measured what they build: every bound below is kept{said}."
        return tag("section", tag("strong", "\N{CHECK MARK} PASSED"), tag("p", words), class_="verdict passed")
    reasons = tag("ul", *(tag("li", reason) for reason in proof.reasons))
    return tag("section", tag("strong", "\N{BALLOT X} NOT PASSED"), tag("p", "This Program must not run as it is:"), reasons, class_="verdict failed")


def _thresholds(checks: list[Check]) -> list[Node]:
    """Bound against measured value, row by row."""
    rows: list[tuple[Node | str, ...]] = [(check.what, check.measured, check.allowed, check.result) for check in checks]
    return [tag("h2", "Bounds and measured values"), table(("What", "#Measured", "#Bound", "Result"), rows)]


def duration(seconds: float) -> str:
    """Hours, minutes and seconds, and the seconds alone."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    said = f"{hours} h {minutes:02d} min {rest:02d} s" if hours else f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
    return said if seconds < 60 else f"{said} ({seconds:.0f} s)"
