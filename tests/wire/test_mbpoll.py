"""mbpoll, a Modbus master from Debian, at our simulated devices: it reads and writes all tables over TCP and RTU."""

from __future__ import annotations

from pathlib import Path

import pytest

from sim.server import SimServer
from tests.wire.masters import HASTY, PATIENT, free_cell, mbpoll, needs_mbpoll, running, values_in

FAR = {"trunnion_tcp": ("-m", "tcp"), "trunnion_rtu": ("-m", "rtu", "-b", "115200", "-P", "none")}


class Master:
    """mbpoll at the devices of a simulated cell."""

    def __init__(self, server: SimServer, role: str) -> None:
        link = server.cell.links[role]  # type: ignore[index]
        self._wire = FAR[server.cell.name.replace("-", "_")]
        self._wire += ("-p", str(link.tcp_port)) if link.transport == "tcp" else ()
        self._place = "127.0.0.1" if link.transport == "tcp" else link.serial_port
        self._id = str(link.device_id)

    async def _poll(self, table: int, address: int, *words: str) -> tuple[int, str]:
        head = (*self._wire, "-a", self._id, "-0", "-1", "-q", *PATIENT, "-t", str(table), "-r", str(address))
        values = [word for word in words if not word.startswith("count=")]
        count = [word.removeprefix("count=") for word in words if word.startswith("count=")]
        return await mbpoll(*head, *(("-c", *count) if count else ()), self._place, *values)

    async def write(self, table: int, address: int, *values: int) -> str:
        """What mbpoll says; one value is function 5 or 6, more are 15 or 16."""
        return (await self._poll(table, address, *map(str, values)))[1]

    async def read(self, table: int, address: int, count: int) -> list[float] | str:
        """Values, or what mbpoll says when there are none."""
        code, output = await self._poll(table, address, f"count={count}")
        return values_in(output) if code == 0 else output


COILS, INPUTS, INPUT_WORDS, WORDS = 0, 1, 3, 4  # as mbpoll numbers the tables


@needs_mbpoll
async def test_mbpoll_reads_and_writes_over_tcp(tmp_path: Path) -> None:
    async with running(free_cell(), tmp_path) as server:
        server.world.laser.watches_heartbeat = False
        port = str(server.cell.links["laser"].tcp_port)
        far = ("-m", "tcp", "-p", port, "-a", "1", "-0", "-1", "-q", *PATIENT)
        code, output = await mbpoll(*far, "-t", "4", "-r", "0", "127.0.0.1", "1234")
        assert code == 0, output
        assert server.world.laser.values["power_setpoint"] == pytest.approx(123.4)
        code, output = await mbpoll(*far, "-t", "4", "-r", "0", "-c", "1", "127.0.0.1")
        assert values_in(output) == [1234.0]
        code, output = await mbpoll(*far, "-t", "0", "-r", "0", "127.0.0.1", "1")
        assert code == 0, output
        assert server.world.laser.values["enable"] == 1.0
        code, output = await mbpoll(*far, "-t", "3", "-r", "0", "-c", "9", "127.0.0.1")
        assert "Illegal data address" in output
        code, output = await mbpoll(*far, "-t", "4", "-r", "0", "127.0.0.1", "30000")
        assert "Illegal data value" in output


@needs_mbpoll
async def test_mbpoll_reads_three_devices_on_one_rtu_line(tmp_path: Path) -> None:
    async with running(free_cell("trunnion_rtu"), tmp_path) as server:
        server.world.laser.watches_heartbeat = False
        line = server.cell.links["laser"].serial_port
        assert line == server.cell.links["io"].serial_port == str(tmp_path / "modbus")
        far = ("-m", "rtu", "-b", "115200", "-P", "none", "-0", "-1", "-q")
        far, hasty = (*far, *PATIENT), (*far, *HASTY)
        code, output = await mbpoll(*far, "-a", "1", "-t", "4", "-r", "0", line, "777")
        assert code == 0, output
        assert server.world.laser.values["power_setpoint"] == pytest.approx(77.7)
        code, output = await mbpoll(*far, "-a", "3", "-t", "1", "-r", "0", "-c", "7", line)
        assert values_in(output) == [1, 1, 1, 1, 1, 0, 1]
        code, output = await mbpoll(*far, "-a", "2", "-t", "3", "-r", "4", "-c", "1", line)
        assert values_in(output) == [10000.0]
        code, output = await mbpoll(*hasty, "-a", "9", "-t", "3", "-r", "0", "-c", "1", line)
        assert "timed out" in output


@needs_mbpoll
@pytest.mark.parametrize("name", FAR)
async def test_mbpoll_writes_coils_and_registers_one_and_many_and_reads_all_four_tables(name: str, tmp_path: Path) -> None:
    async with running(free_cell(name), tmp_path) as server:
        for plant in (server.world.laser, server.world.feeder):
            plant.watches_heartbeat = False
        laser = Master(server, "laser")
        await laser.write(WORDS, 0, 777)  # function 6
        assert server.world.laser.values["power_setpoint"] == pytest.approx(77.7)
        await laser.write(WORDS, 0, 1500, 9)  # function 16
        assert (server.world.laser.values["power_setpoint"], server.world.laser.values["heartbeat"]) == (pytest.approx(150.0), 9.0)
        await laser.write(COILS, 0, 1)  # function 5
        assert (server.world.laser.values["enable"], server.world.laser.values["emission_permit"]) == (1.0, 0.0)
        await laser.write(COILS, 0, 0, 1)  # function 15
        assert (server.world.laser.values["enable"], server.world.laser.values["emission_permit"]) == (0.0, 1.0)
        assert await laser.read(COILS, 0, 2) == [0, 1]
        assert await laser.read(WORDS, 0, 2) == [1500, 9]
        assert await laser.read(INPUT_WORDS, 3, 2) == [9, 1500]
        assert await laser.read(INPUTS, 0, 1) == [0]


@needs_mbpoll
@pytest.mark.parametrize("name", FAR)
async def test_what_no_map_has_or_no_bound_permits_is_the_exception_of_the_standard_and_changes_nothing(name: str, tmp_path: Path) -> None:
    async with running(free_cell(name), tmp_path) as server:
        laser, before = Master(server, "laser"), dict(server.world.laser.values)
        for table, address, count in ((COILS, 60, 1), (INPUTS, 0, 99), (INPUT_WORDS, 0, 99), (WORDS, 500, 2)):
            assert "Illegal data address" in str(await laser.read(table, address, count))
        assert "Illegal data address" in await laser.write(WORDS, 500, 1)
        assert "Illegal data address" in await laser.write(WORDS, 1, 5, 6)
        assert "Illegal data address" in await laser.write(COILS, 60, 1)
        assert "Illegal data value" in await laser.write(WORDS, 0, 30_000)
        after = dict(server.world.laser.values)
        assert {key: after[key] for key in server.world.laser.safe} == {key: before[key] for key in server.world.laser.safe}
