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
from drivers.errors import DeviceFault
from drivers.laser import Laser
from drivers.modbus.client import PymodbusLink
from drivers.modbus.device import DeviceClient

SERVER = Path(__file__).with_name("libmodbus_server.py")
PATIENT_S = 2.0  # the far end is a process that shares the processor with others

try:
    ctypes.CDLL("libmodbus.so.5")
except OSError:
    pytest.skip("libmodbus5 is not installed (Debian package libmodbus5)", allow_module_level=True)


@contextlib.contextmanager
def server(*words: str) -> Iterator[None]:
    process = subprocess.Popen([sys.executable, str(SERVER), *words], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "ready\n"
        yield
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


@contextlib.asynccontextmanager
async def null_modem() -> AsyncIterator[tuple[str, str]]:
    """Two serial ports that are joined."""
    ends = [pty.openpty(), pty.openpty()]
    loop = asyncio.get_running_loop()
    for (master, slave), (other, _) in zip(ends, reversed(ends), strict=True):
        tty.setraw(slave)
        os.set_blocking(master, False)
        loop.add_reader(master, lambda source=master, target=other: os.write(target, os.read(source, 512)))
    try:
        yield os.ttyname(ends[0][1]), os.ttyname(ends[1][1])
    finally:
        for pair in ends:
            loop.remove_reader(pair[0])
            for fd in pair:
                os.close(fd)


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


async def test_laser_on_libmodbus_tcp_takes_set_points_and_gives_read_backs() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with server("tcp", str(port)):
        link = PymodbusLink(Link(device="laser_generic", transport="tcp", tcp_port=port), PATIENT_S, SystemClock())
        assert await converse(link) == [0, 0, 0]
        await link.close()


async def test_laser_on_libmodbus_rtu_takes_set_points_and_gives_read_backs() -> None:
    async with null_modem() as (near, far):
        with server("rtu", far):
            link = PymodbusLink(Link(device="laser_generic", transport="rtu", serial_port=near), PATIENT_S, SystemClock())
            assert await converse(link) == [0, 0, 0]
            await link.close()
