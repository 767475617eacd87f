"""The simulated cell as others see it: a terminal on its serial line, its control socket, faults, signals."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
import tomllib
import tty
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import trimesh

from config import load_cell
from sim.faults import FaultScriptError
from sim.server import SimServer
from sim.wires import WireError
from tests.wire.masters import HASTY, PATIENT, free_cell, mbpoll, needs_mbpoll, running

WAIT_S = 60.0  # until something has come about, on a machine that others use too


class Terminal:
    """A host on a serial line."""

    def __init__(self, path: str) -> None:
        self._fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self._fd)
        self.heard = b""

    def say(self, data: bytes) -> None:
        os.write(self._fd, data)

    async def hear(self, wanted: bytes) -> bytes:
        """Everything up to and with `wanted`."""
        async with asyncio.timeout(WAIT_S):
            while wanted not in self.heard:
                try:
                    self.heard += os.read(self._fd, 4096)
                except BlockingIOError:
                    await asyncio.sleep(0.002)
        cut = self.heard.index(wanted) + len(wanted)
        got, self.heard = self.heard[:cut], self.heard[cut:]
        return got

    async def ask_until(self, wanted: bytes) -> None:
        """Ask for the status until it says so."""
        async with asyncio.timeout(WAIT_S):
            self.say(b"?")
            while wanted not in await self.hear(b">"):
                await asyncio.sleep(0.01)
                self.say(b"?")

    def close(self) -> None:
        os.close(self._fd)


async def command(run_dir: Path, **words: Any) -> dict[str, Any]:
    reader, writer = await asyncio.open_unix_connection(str(run_dir / "sim.sock"))
    writer.write(json.dumps(words).encode() + b"\n")
    answer: dict[str, Any] = json.loads(await asyncio.wait_for(reader.readline(), WAIT_S))
    writer.close()
    await writer.wait_closed()
    return answer


@needs_mbpoll
async def test_silent_slow_and_excepting_devices_look_so_from_outside(tmp_path: Path) -> None:
    async with running(free_cell(), tmp_path) as server:
        far = ("-m", "tcp", "-a", "1", "-0", "-1", "-q", "-t", "3", "-r", "0", "-c", "1")
        laser, feeder = (str(server.cell.links[role].tcp_port) for role in ("laser", "feeder"))  # type: ignore[index]
        assert (await command(tmp_path, do="fault", fault="modbus_silent laser"))["ok"]
        _, output = await mbpoll("-p", laser, *far, *HASTY, "127.0.0.1")
        assert "timed out" in output
        await command(tmp_path, do="fault", fault="modbus_ok laser")
        code, output = await mbpoll("-p", laser, *far, *PATIENT, "127.0.0.1")
        assert code == 0, output
        await command(tmp_path, do="fault", fault="modbus_exception feeder 4")
        _, output = await mbpoll("-p", feeder, *far, *PATIENT, "127.0.0.1")
        assert "Slave device or server failure" in output


async def test_a_host_on_the_serial_line_identifies_moves_and_stops_the_machine(tmp_path: Path) -> None:
    async with running(free_cell(), tmp_path, time_scale=5.0) as server:
        host = Terminal(server.cell.cnc.port)
        try:
            host.say(b"$I\n")
            assert b"[FIRMWARE:grblHAL]" in await host.hear(b"ok\r\n")
            host.say(b"N1 G1 X100 F60\n")  # 20 s of the wires' time
            await host.hear(b"ok\r\n")
            await host.ask_until(b"Ln:1")
            async with asyncio.timeout(WAIT_S):
                while server.world.cnc.machine.motion.position[0] <= 0.0:
                    await asyncio.sleep(0.005)
            host.say(b"!")
            await host.ask_until(b"<Hold:0")
            assert 0.0 < server.world.cnc.machine.motion.position[0] < 100.0
        finally:
            host.close()


async def test_a_line_at_its_baud_rate_needs_the_time_of_its_characters(tmp_path: Path) -> None:
    cell = free_cell()
    slow = cell.model_copy(update={"cnc": cell.cnc.model_copy(update={"baud": 9600})})
    async with running(slow, tmp_path, at_baud=True) as server:
        host = Terminal(server.cell.cnc.port)
        try:
            started = asyncio.get_running_loop().time()
            host.say(b"G90" + b" " * 235 + b"\n")
            await host.hear(b"ok\r\n")
            elapsed = asyncio.get_running_loop().time() - started
        finally:
            host.close()
    assert elapsed >= 239 / 960.0 - 0.02


async def test_cell_file_names_the_real_ports_and_reads_back_as_the_same_cell(tmp_path: Path) -> None:
    async with running(free_cell(), tmp_path) as server:
        read = load_cell(server.cell_file)
        assert read == server.cell
        assert all(link.tcp_port > 0 for link in read.links.values())
        assert Path(read.cnc.port).is_symlink()
        assert tomllib.loads(server.cell_file.read_text())["mode"] == "sim"
    assert not (tmp_path / "cnc").is_symlink()
    assert not (tmp_path / "sim.sock").exists()


async def test_the_serial_line_is_as_many_times_faster_as_the_machine(tmp_path: Path) -> None:
    async with running(free_cell(), tmp_path, time_scale=10.0) as server:
        assert load_cell(server.cell_file).cnc.baud == 1_152_000
        assert server.world.cell.cnc.baud == 115_200


async def test_control_socket_opens_the_door_and_tells_what_is_wrong_with_a_command(tmp_path: Path) -> None:
    async with running(free_cell(), tmp_path) as server:
        assert (await command(tmp_path, do="state"))["io"]["door_closed"] == 1.0
        assert (await command(tmp_path, do="open_door"))["ok"]
        assert not server.world.io.door_closed
        answer = await command(tmp_path, do="fault", fault="at=1s nonsense")
        assert not answer["ok"] and "nonsense" in answer["error"]
        assert "sing" in (await command(tmp_path, do="sing"))["error"]
        assert "clamped" in (await command(tmp_path, do="as_built", dir=str(tmp_path)))["error"]
        assert "no.stl" in (await command(tmp_path, do="workpiece", mesh="no.stl"))["error"]


async def test_metal_deposited_over_the_wires_shows_in_the_as_built_measurement(tmp_path: Path) -> None:
    wall = trimesh.creation.box((20.0, 3.0, 1.0))
    wall.apply_translation((10.0, 0.0, 0.5))
    wall.export(tmp_path / "wall.stl")
    async with running(free_cell(), tmp_path, time_scale=20.0) as server:
        await command(tmp_path, do="workpiece", mesh=str(tmp_path / "wall.stl"), cell_mm=0.5)
        world = server.world
        for plant in (world.laser, world.feeder):
            plant.watches_heartbeat = False
        for name, value in (("power_setpoint", 1000.0), ("enable", 1.0), ("emission_permit", 1.0)):
            world.laser.write(name, value)
        world.feeder.write("carrier_gas_setpoint", 5.0)
        world.feeder.write("rate_setpoint", 8.0)
        host = Terminal(server.cell.cnc.port)
        try:
            host.say(b"G0 X-60 Z160.5\nG4 P6\nM62 P0\nG1 X-40 F600\nM63 P0\nG1 Y5 F600\nG4 P0.1\n")
            for _ in range(7):
                assert b"error" not in await host.hear(b"ok\r\n")
        finally:
            host.close()
        answer = await command(tmp_path, do="as_built", dir=str(tmp_path / "built"))
    assert answer["ok"], answer
    built = trimesh.load_mesh(tmp_path / "built" / "as_built.stl")
    assert built.bounds[1, 2] > 0.3
    above = built.vertices[built.vertices[:, 2] > 0.3]
    assert above[:, 0].min() == pytest.approx(0.0, abs=1.5)
    assert above[:, 0].max() == pytest.approx(20.0, abs=1.5)
    assert json.loads((tmp_path / "built" / "as_built.json").read_text()) == answer["deviation"]
    assert (tmp_path / "built" / "as_built.png").read_bytes().startswith(b"\x89PNG")


async def test_a_port_that_is_taken_and_a_name_that_is_taken_are_one_clear_line(tmp_path: Path) -> None:
    async with running(free_cell(), tmp_path / "one") as server:
        taken = {"laser": {"tcp_port": server.cell.links["laser"].tcp_port}}
        with pytest.raises(WireError) as caught:
            await SimServer(free_cell(**taken), tmp_path / "two").start()
        assert "links.laser" in caught.value.message
        assert not (tmp_path / "two" / "cnc").is_symlink()
    (tmp_path / "three").mkdir()
    (tmp_path / "three" / "cnc").write_text("a file of somebody's")
    with pytest.raises(WireError) as caught:
        await SimServer(free_cell(), tmp_path / "three").start()
    assert "exists" in caught.value.message


def test_a_real_cell_and_a_wrong_fault_are_refused_before_anything_opens(tmp_path: Path) -> None:
    with pytest.raises(WireError):
        SimServer(free_cell().model_copy(update={"mode": "real"}), tmp_path)
    with pytest.raises(FaultScriptError):
        SimServer(free_cell(), tmp_path, faults=["at=1s nonsense"])


@asynccontextmanager
async def process_of(*arguments: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """`python -m sim`; whatever the test does, it ends and its pipes are closed."""
    root = Path(__file__).resolve().parents[2]
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "sim", *arguments,
        cwd=root, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


async def test_the_process_says_ready_once_and_leaves_nothing_behind_on_sigterm(tmp_path: Path) -> None:
    arguments = "--cell", "trunnion_rtu", "--run", str(tmp_path), "--fault", "at=0.1s door_open"
    async with process_of(*arguments) as process, asyncio.timeout(WAIT_S):
        assert process.stdout is not None
        line = await process.stdout.readline()
        assert line.startswith(b"sim ready: ")
        assert (tmp_path / "cell.toml").exists()
        while (await command(tmp_path, do="state"))["io"]["door_closed"]:
            await asyncio.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        output, errors = await process.communicate()
        assert (process.returncode, output, errors) == (0, b"", b"")
        assert sorted(path.name for path in tmp_path.iterdir()) == ["cell.toml"]


async def test_bad_arguments_end_with_one_line_and_code_2(tmp_path: Path) -> None:
    async with process_of("--run", str(tmp_path), "--fault", "nonsense") as process, asyncio.timeout(WAIT_S):
        _, errors = await process.communicate()
    assert process.returncode == 2
    assert errors.splitlines()[0] == b"sim: fault 'nonsense': 'nonsense' is unknown"
    assert b"Traceback" not in errors
