"""Who goes first on a Modbus line, and what is learnt of a device's times, in simulated time."""

from __future__ import annotations

from typing import Any

import pytest

from config.device import Table, load_device
from drivers.feeder import Feeder
from drivers.laser import Laser
from drivers.modbus.device import DeviceClient
from drivers.modbus.latency import Edge
from drivers.modbus.turn import Turn
from tests.unit.drivers.fakes import ManualClock
from tests.unit.drivers.test_modbus_device import MemoryLink, laser


def two_on_a_line() -> tuple[Laser, Feeder, MemoryLink, list[tuple[str, int]]]:
    clock = ManualClock()
    link, order = MemoryLink(clock), []
    turn = Turn(clock)
    one = Laser(DeviceClient(load_device("laser_generic"), 1, link, clock, turn=turn))
    other = Feeder(DeviceClient(load_device("feeder_generic"), 2, link, clock, turn=turn))
    read, write = link.read, link.write

    async def noted_read(device_id: int, table: Table, address: int, count: int) -> list[int]:
        order.append(("read", device_id))
        if order.count(("read", 2)) == 1 and device_id == 2:
            one.permit(True)  # set while the first reading of the other device is on the wire
        return await read(device_id, table, address, count)

    async def noted_write(device_id: int, table: Table, address: int, values: list[int], *sending: Any) -> None:
        order.append((f"write {table}", device_id))
        await write(device_id, table, address, values, *sending)

    link.read, link.write = noted_read, noted_write  # type: ignore[method-assign]
    return one, other, link, order


async def test_a_permit_that_is_set_while_another_device_is_read_waits_for_one_request_only() -> None:
    one, other, _, order = two_on_a_line()
    await one.cycle()
    order.clear()
    await other.cycle()
    first = order.index(("read", 2))
    assert order[first + 1] == ("write coil", 1)


async def test_what_is_taken_back_while_it_waits_is_never_written() -> None:
    one, link, _ = laser()
    await one.cycle()
    link.writes.clear()
    write = link.write

    async def lock_meanwhile(device_id: int, table: Table, address: int, values: list[int], *sending: Any) -> None:
        await write(device_id, table, address, values, *sending)
        if (table, address) == ("holding", 0):
            one.permit(False)

    link.write = lock_meanwhile  # type: ignore[method-assign]
    one.set_power(500.0)
    one.permit(True)
    await one.cycle()
    assert ("coil", 1, [1]) not in link.writes


async def test_a_line_is_free_for_a_request_unless_a_set_point_is_due_before_its_end() -> None:
    clock = ManualClock()
    turn, link = Turn(clock), MemoryLink(clock)
    client = DeviceClient(load_device("laser_generic"), 1, link, clock, turn=turn)
    client.due(clock.now() + 0.010)
    assert turn.taken_at(clock.now(), 0.005) is None
    assert turn.taken_at(clock.now(), 0.020) == pytest.approx(clock.now() + 0.010)
    client.due(None)
    assert turn.taken_at(clock.now(), 0.020) is None


@pytest.mark.parametrize("true_s", [0.004, 0.030, 0.120])
def test_an_edge_is_learnt_within_half_a_bracket_whatever_the_map_says(true_s: float) -> None:
    edge, every_s = Edge(2.0), 0.012
    for k in range(15):
        phase = (k * 0.618 % 1.0) * every_s
        before = max((phase + j * every_s for j in range(-1, 40) if phase + j * every_s < true_s), default=0.0)
        edge.bracket(max(before, 0.0), before + every_s)
    assert abs(edge.believed(0.5).value_s - true_s) <= every_s / 2


def test_one_odd_reading_does_not_change_what_is_believed() -> None:
    edge = Edge(2.0)
    for _ in range(5):
        edge.bracket(0.020, 0.024)
    edge.bracket(1.0, 1.1)
    assert edge.believed(0.001).value_s == pytest.approx(0.022)
    edge.bracket(3.0, 4.0)
    assert edge.samples == 6
