"""The Modbus drivers against a server of our own making, over a TCP socket and over a pty."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable

import pytest
import pytest_asyncio

from config.cell import Link
from config.device import Device, load_device
from drivers.clock import SystemClock
from drivers.errors import DeviceFault, DeviceSilent, DriverError, LinkLost, PortAbsent, WrongAnswer
from drivers.laser import Laser
from drivers.modbus.client import PymodbusLink
from drivers.modbus.device import RETRY_S, DeviceClient
from tests.wire.raw_modbus import RawModbus

LASER: Device = load_device("laser_generic")
WIRES = ["tcp", "rtu"]


@pytest_asyncio.fixture
async def server() -> AsyncIterator[RawModbus]:
    server = RawModbus(1, 2)
    laser = server.devices[1]
    laser.copies = {("holding", 0): ("input", 4), ("holding", 1): ("input", 3)}
    yield server
    await server.close()


PATIENT_S = 2.0  # time-out of a device that does answer: far end and driver share a processor with others
LIMIT_S = 30.0  # until something has come about
REQUESTS_OF_A_CYCLE = 3  # heartbeat, inputs, discrete inputs


async def link_to(server: RawModbus, wire: str, timeout_s: float = PATIENT_S) -> PymodbusLink:
    if wire == "tcp":
        await server.listen()
        facts = Link(device="laser_generic", transport="tcp", tcp_port=server.port)
    else:
        server.open_line()
        facts = Link(device="laser_generic", transport="rtu", serial_port=server.path)
    return PymodbusLink(facts, timeout_s, SystemClock())


async def until(client: DeviceClient, is_met: Callable[[], bool], timeout_s: float = LIMIT_S) -> None:
    deadline = time.monotonic() + timeout_s
    while not is_met():
        assert time.monotonic() < deadline, f"not met; last error: {client.last_error}"
        await client.cycle()
        await asyncio.sleep(0.01)


@pytest.mark.parametrize("wire", WIRES)
async def test_set_points_reach_the_device_and_read_backs_come_back(server: RawModbus, wire: str) -> None:
    link = await link_to(server, wire)
    client = DeviceClient(LASER, 1, link, SystemClock())
    laser = Laser(client)
    server.devices[1].words["input"][0] = 7500
    server.devices[1].words["input"][1] = 0b10
    await laser.cycle()
    laser.set_power(750.0)
    laser.enable(True)
    laser.permit(True)
    await laser.cycle()
    device = server.devices[1]
    assert device.words["holding"][0] == 7500 and device.words["coil"][0] == device.words["coil"][1] == 1
    assert laser.power_readback_w == pytest.approx(750.0)
    assert laser.interlocks == ["door interlock open"]
    assert laser.connected and laser.last_error is None and not laser.is_stale
    await link.close()


@pytest.mark.parametrize("wire", WIRES)
async def test_modbus_exception_names_its_number_and_meaning(server: RawModbus, wire: str) -> None:
    link = await link_to(server, wire)
    server.devices[1].exception = 2
    await link.connect()
    with pytest.raises(DeviceFault, match=r"exception 2 \(illegal data address\)") as caught:
        await link.read(1, "input", 0, 6)
    assert caught.value.code == 2 and "\n" not in caught.value.message
    await link.close()


@pytest.mark.parametrize("wire", WIRES)
async def test_answer_with_fewer_registers_than_asked_is_a_wrong_answer(server: RawModbus, wire: str) -> None:
    link = await link_to(server, wire)
    server.devices[1].short_by = 2
    await link.connect()
    with pytest.raises(WrongAnswer, match="4 registers where 6 were asked"):
        await link.read(1, "input", 0, 6)
    await link.close()


@pytest.mark.parametrize("wire", WIRES)
async def test_silent_device_costs_one_time_out_and_no_retry(server: RawModbus, wire: str) -> None:
    link = await link_to(server, wire, timeout_s=1.0)
    server.devices[1].is_mute = True
    await link.connect()
    began = time.monotonic()
    with pytest.raises(DeviceSilent, match="no answer within 1000 ms"):
        await link.read(1, "input", 0, 6)
    assert 1.0 <= time.monotonic() - began < 2.0  # less than two time-outs
    assert len(server.devices[1].requests) == 1
    await link.close()


async def test_nothing_listening_is_one_clear_line() -> None:
    link = PymodbusLink(Link(device="laser_generic", transport="tcp", tcp_port=1), 0.1, SystemClock())
    with pytest.raises(PortAbsent, match=r"127\.0\.0\.1:1"):
        await link.connect()


async def test_absent_serial_line_is_one_clear_line(tmp_path: object) -> None:
    link = PymodbusLink(Link(device="laser_generic", transport="rtu", serial_port=f"{tmp_path}/none"), 0.1, SystemClock())
    with pytest.raises(PortAbsent, match="does not exist"):
        await link.connect()
    with pytest.raises(LinkLost):
        await link.read(1, "input", 0, 1)


async def test_late_rtu_answer_is_waited_out_and_not_taken_for_the_next_one(server: RawModbus) -> None:
    link = await link_to(server, "rtu", timeout_s=0.4)
    await link.connect()
    device = server.devices[1]
    device.words["input"].update({0: 11, 10: 22})
    device.late_s, device.late_once = 0.6, True
    with pytest.raises(DeviceSilent):
        await link.read(1, "input", 0, 1)
    assert await link.read(1, "input", 10, 1) == [22]
    await link.close()


async def test_request_whose_caller_was_cancelled_is_completed_and_its_answer_not_taken_for_the_next_one(server: RawModbus) -> None:
    link = await link_to(server, "rtu")
    await link.connect()
    device = server.devices[1]
    device.words["input"].update({0: 11, 10: 22})
    device.late_s, device.late_once = 0.5, True
    reading = asyncio.ensure_future(link.read(1, "input", 0, 1))
    while not device.requests:
        await asyncio.sleep(0.005)
    reading.cancel()
    with pytest.raises(asyncio.CancelledError):
        await reading
    assert await link.read(1, "input", 10, 1) == [22]
    await link.close()


async def test_late_rtu_answer_of_another_length_is_refused_even_after_the_wait(server: RawModbus) -> None:
    link = await link_to(server, "rtu", timeout_s=0.05)
    await link.connect()
    device = server.devices[1]
    device.late_s, device.late_once = 0.12, True
    with pytest.raises(DeviceSilent):
        await link.read(1, "input", 0, 1)
    device.is_mute = True
    with pytest.raises(DriverError) as caught:
        await link.read(1, "input", 0, 6)
    assert isinstance(caught.value, (WrongAnswer, DeviceSilent))
    await link.close()


async def test_serial_line_is_not_closed_for_silence(server: RawModbus) -> None:
    link = await link_to(server, "rtu", timeout_s=0.3)
    await link.connect()
    server.devices[1].is_mute = True
    for _ in range(4):
        with pytest.raises(DeviceSilent):
            await link.read(1, "input", 0, 1)
    assert link.connected
    server.devices[1].is_mute = False
    assert await link.read(1, "input", 0, 1) == [0]
    await link.close()


async def test_dead_device_on_a_shared_line_does_not_starve_the_other(server: RawModbus) -> None:
    link = await link_to(server, "rtu", timeout_s=0.1)
    server.devices[1].is_mute = True
    dead = DeviceClient(LASER, 1, link, SystemClock())
    live = DeviceClient(LASER, 2, link, SystemClock())
    asked = server.devices[1].requests, server.devices[2].requests
    live_between: list[int] = []  # requests to the live device between two tries of the dead one

    async def poll(client: DeviceClient) -> None:
        while len(live_between) < 6:
            await client.cycle()
            await asyncio.sleep(0.02)

    async def watch() -> None:
        tries, heard = len(asked[0]), len(asked[1])
        while len(live_between) < 6:
            if len(asked[0]) > tries:
                live_between.append(len(asked[1]) - heard)
                tries, heard = len(asked[0]), len(asked[1])
            await asyncio.sleep(0.001)

    async with asyncio.timeout(LIMIT_S):
        await asyncio.gather(poll(dead), poll(live), watch())
    assert not dead.connected and live.connected
    found_dead = live_between[3:]  # behind the first tries, in which the device is found dead
    assert min(found_dead) >= REQUESTS_OF_A_CYCLE
    await link.close()


async def test_server_that_comes_back_is_found_at_the_next_try_and_gets_safe_values(server: RawModbus) -> None:
    link = await link_to(server, "tcp")
    laser = Laser(DeviceClient(LASER, 1, link, SystemClock()))
    await laser.cycle()
    laser.enable(True)
    laser.permit(True)
    laser.set_power(500.0)
    await laser.cycle()
    assert server.devices[1].words["coil"][1] == 1
    port = server.port
    await server.close()
    await until(laser.client, lambda: laser.last_error is not None)
    assert not laser.connected and not laser.is_permitted and laser.power_setpoint_w == 0.0
    connect, tries = link.connect, []

    async def counted() -> None:
        tries.append(True)
        await connect()

    link.connect = counted  # type: ignore[method-assign]
    await server.listen(port)
    await until(laser.client, lambda: laser.connected)
    assert len(tries) == 1 and RETRY_S < 1.0  # the next try, and none is further away
    assert server.devices[1].words["coil"][1] == 0 and server.devices[1].words["holding"][0] == 0
    await link.close()


@pytest.mark.parametrize("wire", WIRES)
async def test_register_that_is_stuck_is_told_as_wrong_value_read_back(server: RawModbus, wire: str) -> None:
    link = await link_to(server, wire)
    laser = Laser(DeviceClient(LASER, 1, link, SystemClock()))
    server.devices[1].stuck.add(("holding", 0))
    await laser.cycle()
    laser.set_power(500.0)
    await until(laser.client, lambda: bool(laser.faults))
    assert "wrong value read back: power_setpoint is 500 W, reads 0" in laser.faults[0]
    assert laser.client.disagreements.counts["power_setpoint"] > 1
    await link.close()


@pytest.mark.parametrize("wire", WIRES)
async def test_coil_that_is_stuck_is_told_though_the_map_has_no_read_back_for_it(server: RawModbus, wire: str) -> None:
    link = await link_to(server, wire)
    laser = Laser(DeviceClient(LASER, 1, link, SystemClock()))
    server.devices[1].stuck.add(("coil", 1))
    await laser.cycle()
    laser.permit(True)
    await until(laser.client, lambda: bool(laser.faults))
    assert "emission_permit is 1" in laser.faults[0]
    await link.close()


async def test_write_that_vanished_is_written_again(server: RawModbus) -> None:
    link = await link_to(server, "rtu", timeout_s=0.3)
    laser = Laser(DeviceClient(LASER.model_copy(update={"dead_man_s": 1.0}), 1, link, SystemClock()))  # outlasts one time-out
    await laser.cycle()
    server.devices[1].lose_writes = 1
    laser.set_power(321.0)
    await laser.cycle()
    await until(laser.client, lambda: laser.last_error is None and laser.connected)
    assert server.devices[1].words["holding"][0] == 3210
    await link.close()


async def test_device_that_does_not_echo_the_heartbeat_is_told(server: RawModbus) -> None:
    link = await link_to(server, "tcp")
    laser = Laser(DeviceClient(LASER, 1, link, SystemClock()))
    server.devices[1].copies.pop(("holding", 1))
    await until(laser.client, lambda: bool(laser.faults))
    assert laser.faults == ["generic fibre laser: does not follow the heartbeat, its dead-man cannot be trusted"]
    await link.close()


async def test_one_cycle_reads_the_whole_map_in_one_request_per_table(server: RawModbus) -> None:
    link = await link_to(server, "tcp")
    laser = Laser(DeviceClient(LASER, 1, link, SystemClock()))
    for _ in range(3):
        await laser.cycle()
    server.devices[1].requests.clear()
    await laser.cycle()
    beat = (6, 1, laser.client.heartbeat.value)  # not at every cycle
    assert sorted(request for request in server.devices[1].requests if request != beat) == [(2, 0, 1), (4, 0, 6)]
    await link.close()


@pytest.mark.parametrize("wire", WIRES)
@pytest.mark.parametrize("damage", ["another function", "odd bytes", "nothing"])
async def test_damaged_answer_is_an_error_and_the_next_good_one_is_read(server: RawModbus, wire: str, damage: str) -> None:
    link = await link_to(server, wire, timeout_s=0.5)
    await link.connect()
    device = server.devices[1]
    device.words["input"].update({0: 1, 1: 2})
    handle = device.handle

    def spoil(pdu: bytes) -> bytes | None:
        good = handle(pdu) or b""
        return {"another function": b"\x03" + good[1:], "odd bytes": good[:1] + b"\x03" + good[2:5], "nothing": b""}[damage]

    device.handle = spoil  # type: ignore[method-assign]
    with pytest.raises((WrongAnswer, DeviceSilent)):
        await link.read(1, "input", 0, 2)
    device.handle = handle  # type: ignore[method-assign]
    assert await link.read(1, "input", 0, 2) == [1, 2]
    await link.close()
