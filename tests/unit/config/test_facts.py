"""Facts files: what is shipped is valid, what is wrong gets one line that names field and bound."""

import tomllib
from pathlib import Path

import pytest
import tomli_w

import config
from config.base import FACTS_DIR
from config.device import REQUIRED

CELLS = sorted(path.stem for path in (FACTS_DIR / "cells").glob("*.toml"))
DEVICES = sorted(path.stem for path in (FACTS_DIR / "devices").glob("*.toml"))
MATERIALS = sorted(path.stem for path in (FACTS_DIR / "materials").glob("*.toml"))


@pytest.mark.parametrize("name", CELLS)
def test_every_shipped_cell_is_valid_and_names_register_maps_that_exist(name: str) -> None:
    cell = config.load_cell(name)
    for role, link in cell.links.items():
        assert config.load_device(link.device).role == role


@pytest.mark.parametrize("name", DEVICES)
def test_every_shipped_register_map_holds_what_its_driver_looks_up_and_a_safe_value_for_all_that_is_written(name: str) -> None:
    device = config.load_device(name)
    assert REQUIRED[device.role] <= set(device.registers)
    assert all(register.safe is not None for register in device.registers.values() if register.writable)


@pytest.mark.parametrize("name", MATERIALS)
def test_every_shipped_material_has_a_source_for_each_group_of_figures(name: str) -> None:
    material = config.load_material(name)
    assert {"density_g_mm3", "bead", "deposition", "milling"} <= {key.split(".")[0] for key in material.source}


def test_no_shipped_cell_is_a_real_one() -> None:
    assert {config.load_cell(name).mode for name in CELLS} == {"sim"}


def cell_with(tmp_path: Path, *path: str | int, value: object) -> Path:
    data = tomllib.loads((FACTS_DIR / "cells" / "trunnion_tcp.toml").read_text())
    place = data
    for key in path[:-1]:
        place = place[key]  # type: ignore[index,assignment]
    place[path[-1]] = value  # type: ignore[index]
    file = tmp_path / "cell.toml"
    file.write_text(tomli_w.dumps(data))
    return file


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("cnc", "baudrate"), 9600, "cnc.baudrate: unknown key"),
        (("cnc", "baud"), 300, "cnc.baud"),
        (("mode",), "simulated", "mode"),
        (("axes", 0, "max"), -300.0, "axis X"),
        (("links", "laser", "tcp_port"), 99999, "links.laser.tcp_port"),
        (("kinematics", "table", 0, "direction"), [1.0, 1.0, 0.0], "length 1"),
        (("placement", "work_offset"), {"B": 1.0}, "no axis B"),
        (("chord_tolerance_mm",), float("nan"), "chord_tolerance_mm"),
    ],
)
def test_a_wrong_cell_file_is_refused_with_one_line_that_names_the_field(
    tmp_path: Path, path: tuple[str | int, ...], value: object, said: str
) -> None:
    file = cell_with(tmp_path, *path, value=value)
    with pytest.raises(config.ConfigError) as refused:
        config.load_cell(file)
    assert said in refused.value.message and str(file) in refused.value.message
    assert "\n" not in refused.value.message


def test_a_missing_field_is_named(tmp_path: Path) -> None:
    data = tomllib.loads((FACTS_DIR / "materials" / "316L.toml").read_text())
    del data["bead"]["step_over"]
    file = tmp_path / "m.toml"
    file.write_text(tomli_w.dumps(data))
    with pytest.raises(config.ConfigError, match=r"bead\.step_over: is missing"):
        config.load_material(str(file))


def test_registers_that_overlap_on_the_wire_are_refused(tmp_path: Path) -> None:
    data = tomllib.loads((FACTS_DIR / "devices" / "feeder_generic.toml").read_text())
    data["registers"]["carrier_gas_setpoint"]["address"] = 1
    file = tmp_path / "d.toml"
    file.write_text(tomli_w.dumps(data))
    with pytest.raises(config.ConfigError, match="share holding 1"):
        config.load_device(str(file))


@pytest.mark.parametrize("content", [b"", b"a = ", b"\xff\xfe", b"schema_version = 2"])
def test_a_file_that_is_no_facts_file_is_one_line(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "x.toml"
    file.write_bytes(content)
    with pytest.raises(config.ConfigError) as refused:
        config.load_cell(file)
    assert "\n" not in refused.value.message.strip() or content == b"a = "


def test_the_cell_hash_follows_the_machine_and_not_the_wires(tmp_path: Path) -> None:
    text = (FACTS_DIR / "cells" / "trunnion_tcp.toml").read_text()
    rewired, moved = tmp_path / "a.toml", tmp_path / "b.toml"
    rewired.write_text("# a comment\n" + text.replace('port = "cnc"', 'port = "/dev/ttyACM0"').replace("5021", "6021"))
    moved.write_text(text.replace("part_origin_mm = [0.0, 0.0, -420.0]", "part_origin_mm = [0.0, 0.1, -420.0]"))
    shipped, wires, place = (config.load_cell(name).sha256 for name in ("trunnion_tcp", rewired, moved))
    assert shipped == wires != place
