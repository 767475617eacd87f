"""How the wires of a cell file are joined to drivers."""

from __future__ import annotations

import tracemalloc
from collections.abc import Sequence
from pathlib import Path
from typing import overload

import pytest

from config.base import ConfigError
from config.cell import Cell, load_cell
from drivers import open_cell, open_devices
from drivers.clock import SystemClock
from drivers.cnc.program_stream import ProgramStream
from drivers.cnc.status import StatusReader
from drivers.errors import PortAbsent


def with_link(cell: Cell, role: str, **changes: object) -> Cell:
    links = {name: link.model_copy(update=changes if name == role else {}) for name, link in cell.links.items()}
    return cell.model_copy(update={"links": links})


async def test_devices_on_one_serial_line_share_one_link_and_tcp_devices_have_their_own(tmp_path: Path) -> None:
    _, shared = open_devices(load_cell("trunnion_rtu"), tmp_path, SystemClock())
    _, apart = open_devices(load_cell("trunnion_tcp"), tmp_path, SystemClock())
    assert len(shared) == 1 and len(apart) == 3
    assert shared[0].name == str(tmp_path / "modbus")


@pytest.mark.parametrize(("changes", "says"), [({"baud": 9600}, "differ in baud"), ({"device_id": 1}, "stands twice")])
async def test_serial_line_whose_devices_contradict_each_other_is_refused(
    tmp_path: Path, changes: dict[str, object], says: str
) -> None:
    with pytest.raises(ConfigError, match=says):
        open_devices(with_link(load_cell("trunnion_rtu"), "io", **changes), tmp_path, SystemClock())


async def test_absent_cnc_port_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(PortAbsent, match="does not exist"):
        open_cell(load_cell("trunnion_tcp"), tmp_path, SystemClock())


class Endless(Sequence[str]):
    """Five million lines that exist only while they are looked at."""

    def __len__(self) -> int:
        return 5_000_000

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[str]: ...
    def __getitem__(self, index: int | slice) -> str | Sequence[str]:
        assert isinstance(index, int)
        return f"N{index + 1} G1 X{index}.123 F600"


def test_program_of_five_million_lines_takes_no_more_memory_than_what_is_under_way() -> None:
    reader = StatusReader(("X",))
    tracemalloc.start()
    program = ProgramStream(Endless(), 0, 256)
    program.released = 5_000_000
    for k in range(20_000):
        line = program.peek()
        assert line is not None and not program.objection(line, 1000)
        program.went(line)
        if k % 100 == 0:
            program.follow(reader.read(f"<Run|MPos:0|Ln:{max(1, k - 200)}>", 0.0), 5, 100)
    used, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert used < 200_000
