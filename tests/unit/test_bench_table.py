"""Tables of measured numbers: their form and where they are kept."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.bench.table import Table


def test_table_aligns_numbers_right_and_words_left() -> None:
    table = Table("Fit", ("contour", "time (ms)"), [("pipe", 1.23456), ("hinge", 12)], note="best of five")
    assert table.markdown().splitlines() == [
        "## Fit",
        "",
        "| contour | time (ms) |",
        "|---------|----------:|",
        "| pipe    |     1.235 |",
        "| hinge   |        12 |",
        "",
        "best of five",
    ]


def test_large_numbers_are_printed_without_an_exponent() -> None:
    assert "| 1234567 |" in Table("Rate", ("lines",), [(1234567.2,)]).markdown()


def test_row_with_a_missing_cell_is_refused() -> None:
    with pytest.raises(ValueError, match="1 cells for 2 columns"):
        Table("Fit", ("contour", "time (ms)"), [("pipe",)]).markdown()


def test_written_table_is_named_after_its_title(tmp_path: Path) -> None:
    table = Table("Slicing, 1 M triangles", ("time (s)",), [(0.2,)])
    assert table.write(tmp_path) == tmp_path / "slicing_1_m_triangles.md"
    assert (tmp_path / "slicing_1_m_triangles.md").read_text() == table.markdown()
