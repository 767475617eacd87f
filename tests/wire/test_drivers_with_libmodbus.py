"""The Modbus drivers against libmodbus (C): a far end that shares no code with them, over TCP and over a serial line."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import os
import pty
import socket
import subprocess
import sys
import tty
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

from config.cell import Link
from config.device import load_device
from drivers.clock import SystemClock
from drivers.errors import DeviceFault, DeviceSilent, LinkError
from drivers.laser import Laser
from drivers.modbus.client import PymodbusLink
from drivers.modbus.device import DeviceClient

SERVER = Path(__file__).with_name("libmodbus_server.py")
PATIENT_S = 2.0  # the far end is a process that shares the processor with others
HASTY_S = 0.3
LATE_S = 0.45  # later than that, sooner than it is waited out
WIRES = ["tcp", "rtu"]

try:
    ctypes.CDLL("libmodbus.so.5")
except OSError:
    pytest.skip("libmodbus5 is not installed (Debian package libmodbus5)", allow_module_level=True)


class Server:
    """The far end, with its knobs."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def turn(self, knob: str, value: float) -> None:
        """Turn a knob; it counts from the next request on."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{knob} {value:g}\n")
        self._process.stdin.flush()


@contextlib.contextmanager
def server(*words: str) -> Iterator[Server]:
    process = subprocess.Popen([sys.executable, str(SERVER), *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdin is not None and process.stdout is not None
    try:
        assert process.stdout.readline() == "ready\n"
        yield Server(process)
    finally:
        process.kill()
        process.wait()
        process.stdin.close()
        process.stdout.close()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def tcp(port: int, timeout_s: float = PATIENT_S) -> PymodbusLink:
    return PymodbusLink(Link(device="laser_generic", transport="tcp", tcp_port=port), timeout_s, SystemClock())


def rtu(path: str, timeout_s: float = PATIENT_S) -> PymodbusLink:
    return PymodbusLink(Link(device="laser_generic", transport="rtu", serial_port=path), timeout_s, SystemClock())


@contextlib.asynccontextmanager
async def shared_line(devices: int = 1) -> AsyncIterator[list[str]]:
    """Serial ports of which each hears all others, as on two wires."""
    ends = [pty.openpty() for _ in range(devices + 1)]
    loop = asyncio.get_running_loop()

    def carry(source: int, targets: list[int]) -> None:
        data = os.read(source, 512)
        for target in targets:
            os.write(target, data)

    masters = [master for master, _ in ends]
    for master, slave in ends:
        tty.setraw(slave)
        os.set_blocking(master, False)
        loop.add_reader(master, carry, master, [other for other in masters if other != master])
    try:
        yield [os.ttyname(slave) for _, slave in ends]
    finally:
        for pair in ends:
            loop.remove_reader(pair[0])
            for fd in pair:
                os.close(fd)


@contextlib.asynccontextmanager
async def joined(wire: str, timeout_s: float = PATIENT_S) -> AsyncIterator[tuple[Server, PymodbusLink]]:
    """libmodbus at the far end of a wire, and our line to it, open."""
    async with contextlib.AsyncExitStack() as ends:
        if wire == "tcp":
            place, line = str(port := free_port()), tcp(port, timeout_s)
        else:
            near, place = await ends.enter_async_context(shared_line())
            line = rtu(near, timeout_s)
        far = ends.enter_context(server(wire, place))
        ends.push_async_callback(line.close)
        await line.connect()
        yield far, line


async def converse(link: PymodbusLink) -> list[int]:
    """Set-points there and back, read-backs, and an address that does not exist; the coils after everything was made safe."""
    laser = Laser(DeviceClient(load_device("laser_generic"), 1, link, SystemClock()))
    await laser.cycle()
    laser.set_power(432.1)
    laser.enable(True)
    laser.permit(True)
    for _ in range(3):
        await laser.cycle()
    assert laser.last_error is None and laser.connected and laser.faults == []
    assert laser.power_readback_w == pytest.approx(750.0)
    assert await link.read(1, "holding", 0, 1) == [4321]
    assert await link.read(1, "coil", 0, 3) == [1, 1, 0]
    with pytest.raises(DeviceFault, match=r"exception 2 \(illegal data address\)"):
        await link.read(1, "input", 900, 4)
    laser.safe()
    await laser.cycle()
    assert await link.read(1, "holding", 0, 1) == [0]
    return await link.read(1, "coil", 0, 3)


@pytest.mark.parametrize("wire", WIRES)
async def test_laser_on_libmodbus_takes_set_points_and_gives_read_backs(wire: str) -> None:
    async with joined(wire) as (_, line):
        assert await converse(line) == [0, 0, 0]


@pytest.mark.parametrize(("code", "words"), [(1, "illegal function"), (4, "device failure"), (6, "device busy")])
@pytest.mark.parametrize("wire", WIRES)
async def test_exception_of_libmodbus_is_told_by_its_number_and_meaning_and_the_next_answer_is_good(wire: str, code: int, words: str) -> None:
    async with joined(wire) as (far, line):
        far.turn("exception", code)
        for request in (line.read(1, "input", 0, 5), line.write(1, "holding", 0, [7]), line.write(1, "coil", 0, [1, 1])):
            with pytest.raises(DeviceFault, match=words) as caught:
                await request
            assert caught.value.code == code
        far.turn("exception", 0)
        assert await line.read(1, "holding", 0, 2) == [0, 0]


@pytest.mark.parametrize("wire", WIRES)
async def test_all_four_tables_and_groups_of_values_agree_with_libmodbus(wire: str) -> None:
    async with joined(wire) as (_, line):
        await line.write(1, "holding", 4, [1, 0xFFFF, 0x8000])
        await line.write(1, "coil", 1, [1, 0, 1, 1])
        assert await line.read(1, "holding", 3, 5) == [0, 1, 0xFFFF, 0x8000, 0]
        assert await line.read(1, "coil", 0, 8) == [0, 1, 0, 1, 1, 0, 0, 0]
        assert await line.read(1, "input", 0, 2) == [7500, 0]
        assert await line.read(1, "discrete", 0, 3) == [0, 0, 0]


@pytest.mark.parametrize("wire", WIRES)
async def test_answer_that_comes_late_is_never_taken_for_that_to_the_next_request(wire: str) -> None:
    async with joined(wire, timeout_s=HASTY_S) as (far, line):
        await line.write(1, "holding", 2, [222])
        far.turn("late", LATE_S)
        with pytest.raises(DeviceSilent, match="no answer within"):
            await line.read(1, "input", 0, 1)  # 7500, as one register like the next
        values = []
        async with asyncio.timeout(PATIENT_S * 5):
            while not values:
                with contextlib.suppress(LinkError):
                    await line.connect()
                    values = await line.read(1, "holding", 2, 1)
        assert values == [222]


async def test_two_devices_of_libmodbus_on_one_line_keep_their_values_apart() -> None:
    async with shared_line(2) as (near, *far):
        with server("rtu", far[0], "1"), server("rtu", far[1], "2"):
            line = rtu(near)
            await line.connect()
            for device_id in (1, 2):
                await line.write(device_id, "holding", 0, [11 * device_id])
            for device_id in (2, 1, 1, 2):
                assert await line.read(device_id, "holding", 0, 1) == [11 * device_id]
                assert await line.read(device_id, "input", 0, 1) == [7000 + 500 * device_id]
            await line.close()


async def test_server_that_was_restarted_is_found_again_and_the_laser_comes_back_safe() -> None:
    port = free_port()
    line = tcp(port)
    laser = Laser(DeviceClient(load_device("laser_generic"), 1, line, SystemClock()))
    with server("tcp", str(port)):
        await laser.cycle()
        laser.set_power(432.1)
        laser.enable(True)
        await laser.cycle()
        assert await line.read(1, "holding", 0, 1) == [4321]
    async with asyncio.timeout(PATIENT_S * 5):
        while laser.last_error is None:
            await laser.cycle()
    with server("tcp", str(port)):
        async with asyncio.timeout(PATIENT_S * 5):
            while laser.last_error is not None:
                await laser.cycle()
                await asyncio.sleep(0.02)
        assert await line.read(1, "holding", 0, 1) == [0]
        assert await line.read(1, "coil", 0, 3) == [0, 0, 0]
        assert not laser.is_enabled and laser.power_setpoint_w == 0.0
        await line.close()
