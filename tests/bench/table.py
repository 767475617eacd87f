"""One table of measured numbers, printed and kept as Markdown."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

RESULTS = Path(__file__).resolve().parent / "results"
DIGITS = 4  # significant digits of a measured number

Cell = str | int | float


def as_text(cell: Cell) -> str:
    """A cell as it is printed: floats to DIGITS significant digits, without exponents where they can be avoided."""
    if isinstance(cell, float):
        return f"{cell:.0f}" if abs(cell) >= 10**DIGITS else f"{cell:.{DIGITS}g}"
    return str(cell)


@dataclass(frozen=True)
class Table:
    """A title, the names of the columns (with their units) and the rows; `note` says how it was measured."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    note: str = ""

    def markdown(self) -> str:
        """The table as aligned Markdown: numbers to the right, words to the left.

        Raises ValueError if a row has not one cell per column.
        """
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"{self.title}: {len(row)} cells for {len(self.columns)} columns in {row!r}")
        texts = [[as_text(cell) for cell in row] for row in self.rows]
        widths = [max(len(line[k]) for line in [list(self.columns), *texts]) for k in range(len(self.columns))]
        is_number = [all(not isinstance(row[k], str) for row in self.rows) for k in range(len(self.columns))]

        def line_of(cells: Sequence[str]) -> str:
            padded = (c.rjust(w) if n else c.ljust(w) for c, w, n in zip(cells, widths, is_number, strict=True))
            return "| " + " | ".join(padded) + " |"

        rule = "|" + "|".join("-" * (w + 1) + (":" if n else "-") for w, n in zip(widths, is_number, strict=True)) + "|"
        parts = [f"## {self.title}", "", line_of(self.columns), rule, *(line_of(row) for row in texts)]
        return "\n".join([*parts, "", self.note, ""] if self.note else [*parts, ""])

    def write(self, folder: Path = RESULTS) -> Path:
        """Write the table to a Markdown file that is named after its title; returns the path."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / (re.sub(r"[^a-z0-9]+", "_", self.title.lower()).strip("_") + ".md")
        path.write_text(self.markdown(), encoding="utf-8")
        return path
