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


def test_a_program_depends_on_the_machines_shape_its_plate_and_the_tools_shapes(tmp_path: Path) -> None:
    drawn = config.load_cell("trunnion_tcp")
    longer = drawn.tools[1].model_copy(update={"stickout_mm": 50.0})
    thicker = drawn.plate.model_copy(update={"size_mm": (120.0, 120.0, 12.0)})
    changed = [
        config.load_cell(cell_file(tmp_path)),
        drawn.model_copy(update={"tools": (drawn.tools[0], longer, *drawn.tools[2:])}),
        drawn.model_copy(update={"plate": thicker}),
    ]
    assert len({cell.sha256 for cell in (drawn, *changed)}) == 4
    assert len({cell.twin_sha256 for cell in (drawn, *changed)}) == 4


def test_a_program_depends_on_what_an_stl_holds_but_not_on_its_folder(tmp_path: Path) -> None:
    hashes = []
    for name, wide in (("here", 1), ("there", 1), ("other", 2)):
        folder = tmp_path / name
        folder.mkdir()
        file = cell_file(folder, solids=[{"name": "arm", "carrier": "Z", "shape": "stl", "file": "arm.stl"}])
        trimesh.creation.box((wide, 1, 1)).export(folder / "arm.stl")
        hashes.append(config.load_cell(file).sha256)
    assert hashes[0] == hashes[1] != hashes[2]


def test_a_cutter_sticks_out_by_its_flutes_and_one_diameter_where_nothing_else_is_said() -> None:
    tool = config.load_cell("trunnion_tcp").tools[1]
    assert tool.stickout == 40.0
    assert tool.model_copy(update={"stickout_mm": None}).stickout == 32.0
    assert tool.model_copy(update={"stickout_mm": 500.0}).stickout == 140.0
