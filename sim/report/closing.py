"""The last part: what the figures rest on, what was not checked, and the lines for those who sign."""

from __future__ import annotations

from typing import TYPE_CHECKING

from config import Cell, Material
from sim.report.markup import Node, table, tag

if TYPE_CHECKING:
    from sim.proof import Proof

BEYOND_THE_TWIN = (
    "distortion and residual stress of the hot part, and its shrinking while it cools",
    "porosity, bonding, cracks, grain and hardness of the metal",
    "cutting forces, chatter, deflection and wear of the cutter",
    "geometric and thermal errors of the real machine, and of the clamping and measuring of the work offset",
    "spatter, fumes, and powder that stays in the part's hollows",
    "the safety chain (doors, emergency stop, laser interlocks): it is hardware",
)
WIDTH_ERROR = ((0.06, 0.15), (0.12, 0.23))  # least and greatest of the sets of tracks: mean, and what nine in ten keep to
HEIGHT_ERROR = (0.09, 0.15)  # mean, and what nine in ten keep to
STATED_ERROR = (
    f"Error of the bead, against published single tracks that calibration did not see (Akbari et al., Additive Manufacturing 55 (2022) 102817,"
    f" and the sets named in its tests; 316L, Inconel 718, Ti-6Al-4V): width in the mean {WIDTH_ERROR[0][0]:.0%} to {WIDTH_ERROR[0][1]:.0%} by set,"
    f" nine tracks in ten within {WIDTH_ERROR[1][0]:.0%} to {WIDTH_ERROR[1][1]:.0%}; height in the mean {HEIGHT_ERROR[0]:.0%}, nine in ten within"
    f" {HEIGHT_ERROR[1]:.0%}. Single tracks of the own head make it less."
)
SIGNED = ("Proven by (name, date, signature)", "Approved by (name, date, signature)")


def section(proof: Proof, cell: Cell, material: Material) -> list[Node]:
    """Model, limits of the proof and signatures."""
    return [*_model(material), *_unchecked(proof, cell), *_signatures(proof)]


def _model(material: Material) -> list[Node]:
    """Where the material's figures come from, as its file says."""
    rows: list[tuple[Node | str, ...]] = [(tag("code", name), text) for name, text in sorted(material.source.items())]
    density = f"{material.density_g_mm3 * 1e3:.3g} g/cm\N{SUPERSCRIPT THREE}"
    words = f"{material.name}, density {density}. The figures of this powder and where they come from:"
    return [tag("h2", "Model of the process"), tag("p", STATED_ERROR), tag("p", words), table(("Figures", "Source"), rows, "named")]


def _unchecked(proof: Proof, cell: Cell) -> list[Node]:
    """What the verdict says nothing about."""
    here = [finding.text for finding in proof.findings if finding.kind == "unchecked"]
    if proof.lines_executed < proof.lines:
        here.append(f"lines after N{proof.lines_executed}: the run ended there ({proof.lines - proof.lines_executed} lines not run)")
    here.append(f"whether the real cell is as its file says (cell {cell.name}: tools, travel, pivots, work offset, delays)")
    return [
        tag("h2", "Not checked"),
        tag("p", "The verdict says nothing about:"),
        tag("ul", *(tag("li", text) for text in (*here, *BEYOND_THE_TWIN)), class_="plain"),
    ]


def _signatures(proof: Proof) -> list[Node]:
    """Two lines to sign, tied to the Program by its hash."""
    words = f"This report holds for the Program with SHA-256 {proof.program_sha256} and for no other."
    return [tag("div", *(tag("div", text) for text in SIGNED), class_="sign"), tag("p", words, class_="soft")]
