"""Facts about a machine's shape: what a solid needs, where an STL is looked for, and what the hashes follow."""

import tomllib
from pathlib import Path

import pytest
import tomli_w
import trimesh

import config
from config.base import FACTS_DIR


def cell_file(folder: Path, **machine: object) -> Path:
    data = tomllib.loads((FACTS_DIR / "cells" / "trunnion_tcp.toml").read_text())
    data["machine"] = machine
    file = folder / "cell.toml"
    file.write_text(tomli_w.dumps(data))
    return file


@pytest.mark.parametrize(
    ("solid", "said"),
    [
        ({"shape": "box"}, "a box needs size_mm"),
        ({"shape": "cone", "diameter_mm": 10.0, "length_mm": 5.0}, "a cone needs end_diameter_mm"),
        ({"shape": "cylinder", "diameter_mm": 10.0, "length_mm": 5.0, "axis": [0.0, 0.0, 2.0]}, "axis must have length 1"),
        ({"shape": "box", "size_mm": [1.0, 1.0, 1.0], "length_mm": 2.0}, "a box has no length_mm"),
        ({"shape": "box", "size_mm": [1.0, 1.0, 1.0], "carrier": "W"}, "carrier"),
        ({"shape": "stl", "file": "absent.stl"}, "no file"),
    ],
)
def test_a_solid_that_lacks_something_is_refused_in_one_line(tmp_path: Path, solid: dict[str, object], said: str) -> None:
    file = cell_file(tmp_path, solids=[{"name": "arm", "carrier": "Z", **solid}])
    with pytest.raises(config.ConfigError) as refused:
        config.load_cell(file)
    assert said in refused.value.message and "\n" not in refused.value.message


def test_an_stl_is_looked_for_beside_the_cells_file_and_its_content_is_part_of_the_twins_hash(tmp_path: Path) -> None:
    file = cell_file(tmp_path, solids=[{"name": "arm", "carrier": "Z", "shape": "stl", "file": "arm.stl"}])
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "arm.stl")
    small = config.load_cell(file)
    assert small.machine is not None and Path(small.machine.solids[0].file) == tmp_path / "arm.stl"
    before = small.twin_sha256
    trimesh.creation.box((2, 1, 1)).export(tmp_path / "arm.stl")
    assert config.load_cell(file).twin_sha256 != before


def test_a_program_does_not_depend_on_the_machines_shape_but_a_proof_does(tmp_path: Path) -> None:
    drawn = config.load_cell("trunnion_tcp")
    bare = config.load_cell(cell_file(tmp_path))
    assert drawn.sha256 == bare.sha256
    assert drawn.twin_sha256 != bare.twin_sha256


def test_a_cutter_sticks_out_by_its_flutes_and_one_diameter_where_nothing_else_is_said() -> None:
    tool = config.load_cell("trunnion_tcp").tools[1]
    assert tool.stickout == 40.0
    assert tool.model_copy(update={"stickout_mm": None}).stickout == 32.0
    assert tool.model_copy(update={"stickout_mm": 500.0}).stickout == 140.0
