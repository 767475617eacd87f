"""Program directories: the same bytes each time, nothing lost, every damage seen."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from config.cell import load_cell
from planner.errors import FileFormatError
from planner.files.program_file import program_files, program_sha256, read_program, write_program
from planner.post import post
from planner.program import Program
from tests.unit.planner.hand_plan import hybrid_plan


@pytest.fixture(scope="module")
def program() -> Program:
    return post(hybrid_plan(), load_cell("trunnion_tcp"))


def test_a_program_read_back_is_the_program_that_was_written(program: Program, tmp_path: Path) -> None:
    write_program(program, tmp_path / "job")
    again = read_program(tmp_path / "job")
    assert again.lines == program.lines and again.tools == program.tools and again.axis_letters == program.axis_letters
    assert again.table.tobytes() == program.table.tobytes() and again.table.dtype == program.table.dtype
    assert again.schedule.tobytes() == program.schedule.tobytes()
    assert np.array_equal(again.machine_from_build, program.machine_from_build)
    assert again.layer_starts.tolist() == program.layer_starts.tolist()
    assert again.duration_s == program.duration_s
    assert program_sha256(again) == program_sha256(program)
    assert again.window == program.window and program.window is not None and program.window.laser_w == (600.0, 2000.0)


def test_a_program_that_does_not_say_its_materials_window_is_read(program: Program, tmp_path: Path) -> None:
    write_program(replace(program, window=None), tmp_path)
    assert "window" not in json.loads((tmp_path / "program.json").read_text()) and read_program(tmp_path).window is None


def test_a_window_that_is_none_is_refused(program: Program, tmp_path: Path) -> None:
    assert program.window is not None
    write_program(replace(program, window=replace(program.window, laser_w=(900.0, 600.0))), tmp_path)
    with pytest.raises(FileFormatError, match="laser_w is from 900"):
        read_program(tmp_path)


def test_the_same_program_gives_the_same_bytes(program: Program) -> None:
    assert program_files(program) == program_files(post(hybrid_plan(), load_cell("trunnion_tcp")))


def test_each_layer_has_its_file_and_together_they_are_the_text(program: Program, tmp_path: Path) -> None:
    write_program(program, tmp_path)
    names = sorted(path.name for path in tmp_path.glob("*.ngc"))
    assert names == ["layer_0000.ngc", "layer_0001.ngc", "layer_0002.ngc"]
    assert "".join((tmp_path / name).read_text() for name in names) == "".join(line + "\n" for line in program.lines)


def test_files_of_an_earlier_longer_program_do_not_stay(program: Program, tmp_path: Path) -> None:
    (tmp_path / "layer_0009.ngc").write_text("N1 M2\n")
    write_program(program, tmp_path)
    assert read_program(tmp_path).lines == program.lines


@pytest.mark.parametrize("name", ["layer_0001.ngc", "lines.h5", "program.json"])
def test_a_flipped_byte_anywhere_is_refused_in_one_line(program: Program, tmp_path: Path, name: str) -> None:
    write_program(program, tmp_path)
    content = (tmp_path / name).read_bytes()
    for place in np.linspace(0, len(content) - 2, 25).astype(int):
        damaged = bytearray(content)
        damaged[place] ^= 0x04
        (tmp_path / name).write_bytes(bytes(damaged))
        with pytest.raises(FileFormatError) as caught:
            read_program(tmp_path)
        assert "\n" not in caught.value.message and str(tmp_path) in caught.value.message


def test_another_schema_is_refused_by_number(program: Program, tmp_path: Path) -> None:
    write_program(program, tmp_path)
    index = json.loads((tmp_path / "program.json").read_text())
    index["schema"] = 99
    (tmp_path / "program.json").write_text(json.dumps(index))
    with pytest.raises(FileFormatError, match="schema 99, this version reads 2"):
        read_program(tmp_path)


def test_a_missing_file_and_a_missing_directory_are_refused(program: Program, tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="cannot be read"):
        read_program(tmp_path / "nowhere")
    write_program(program, tmp_path)
    (tmp_path / "layer_0001.ngc").unlink()
    with pytest.raises(FileFormatError, match=r"layer_0001.ngc: cannot be read"):
        read_program(tmp_path)
