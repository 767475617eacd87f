"""A Program on its mapped form is the Program that was written, and what is damaged is told."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from cellctl.cell.opened_program import open_form, timeline_of, tools_of
from cellctl.cell.program_form import BODY, INDEX, write_form
from config.cell import load_cell
from planner.errors import FileFormatError
from planner.program import ProcessWindow, Program
from tests.cell.jobs import one_wall

DIGEST = "a" * 64


def test_the_form_gives_back_lines_tables_timeline_and_tools(tmp_path: Path) -> None:
    cell = load_cell("trunnion_tcp")
    program = dataclasses.replace(one_wall(cell), window=ProcessWindow("c" * 64, (600.0, 900.0), (5.0, 12.5)))
    write_form(program, cell, tmp_path / "form", DIGEST)
    opened = open_form(tmp_path / "form", DIGEST)
    assert opened is not None
    assert tuple(opened.lines) == program.lines and opened.lines[-1] == program.lines[-1]
    for field in dataclasses.fields(Program):
        if field.name != "lines":
            assert np.array_equal(getattr(opened, field.name), getattr(program, field.name)), field.name
    there, here = timeline_of(opened, cell), timeline_of(program, cell)
    assert all(np.array_equal(getattr(there, name), getattr(here, name)) for name in ("arc_mm", "is_emitting", "stops", "bow", "plane"))
    assert tools_of(opened) == tools_of(program)
    assert open_form(tmp_path / "form", "b" * 64) is None and open_form(tmp_path / "none", DIGEST) is None


def test_a_form_that_does_not_know_of_windows_still_opens(tmp_path: Path) -> None:
    cell = load_cell("trunnion_tcp")
    write_form(one_wall(cell), cell, tmp_path / "form", DIGEST)
    index = tmp_path / "form" / INDEX
    document = json.loads(index.read_text())
    del document["program"]["window"]
    index.write_text(json.dumps(document))
    opened = open_form(tmp_path / "form", DIGEST)
    assert opened is not None and opened.window is None


def test_a_damaged_form_is_told_in_one_line(tmp_path: Path) -> None:
    cell = load_cell("trunnion_tcp")
    write_form(one_wall(cell), cell, tmp_path / "form", DIGEST)
    content = bytearray((tmp_path / "form" / BODY).read_bytes())
    content[40] ^= 1
    (tmp_path / "form" / BODY).write_bytes(content)
    with pytest.raises(FileFormatError, match="damaged"):
        open_form(tmp_path / "form", DIGEST)
