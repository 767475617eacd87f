"""Whether a Modbus line keeps the stale limits, by bytes over baud; readings that are about to grow stale go first."""

from __future__ import annotations

from typing import Any

import pytest

from config.cell import Cell, load_cell
from config.device import Table, load_device
from drivers.laser import Laser
from drivers.modbus.device import DeviceClient
from drivers.modbus.latency import RequestTime
from drivers.modbus.line_budget import complaints, worst_ages_s
from tests.unit.drivers.fakes import ManualClock
from tests.unit.drivers.test_modbus_device import MemoryLink

WRITES = 100


def rtu_cell(baud: int) -> Cell:
    cell = load_cell("trunnion_rtu")
    return cell.model_copy(update={"links": {role: link.model_copy(update={"baud": baud}) for role, link in cell.links.items()}})


def complaints_at(baud: int) -> list[str]:
    cell = rtu_cell(baud)
    return complaints(cell, {role: load_device(link.device) for role, link in cell.links.items()})


def test_the_shipped_rtu_line_keeps_its_stale_limits_and_a_slow_one_is_told_in_one_line() -> None:
    assert complaints_at(115200) == []
    (text,) = complaints_at(9600)
    assert "9600 baud" in text and "stale_s is 250 ms" in text and "\n" not in text


def test_the_age_of_readings_is_bounded_below_by_their_own_characters() -> None:
    cell = rtu_cell(19200)
    devices = {role: load_device(link.device).model_copy(update={"latency_s": 0.0}) for role, link in cell.links.items()}
    characters = (13 + 1) + (13 + 12) + (13 + 18) + (13 + 1) + (13 + 12)  # laser, feeder and coupler, each span once
    assert min(worst_ages_s(devices, cell.links).values()) > characters * 11 / 19200


def test_a_tcp_device_that_answers_too_late_for_its_limits_is_told() -> None:
    cell = load_cell("trunnion_tcp")
    quick = {role: load_device(link.device) for role, link in cell.links.items()}
    slow = {**quick, "laser": quick["laser"].model_copy(update={"latency_s": 0.06})}
    assert complaints(cell, quick) == []
    (text,) = complaints(cell, slow)
    assert text.startswith("laser at TCP")


def test_one_stall_does_not_keep_the_line_free_for_as_long_as_it_was() -> None:
    time = RequestTime(0.003)
    for _ in range(20):
        time.took(0.005)
    time.took(0.300)
    assert (time.usual_s, time.longest_s) == (0.005, 0.300)


@pytest.mark.parametrize("request_s", [0.001, 0.020, 0.040])
async def test_readings_stay_younger_than_their_limit_while_set_points_change_all_the_time(request_s: float) -> None:
    clock = ManualClock()
    link = MemoryLink(clock)
    link.echo = {("holding", 0): ("input", 4), ("holding", 1): ("input", 3)}
    laser = Laser(DeviceClient(load_device("laser_generic"), 1, link, clock))
    await laser.cycle()
    ages: list[float] = []
    read, write = link.read, link.write

    async def slow_read(device_id: int, table: Table, address: int, count: int) -> list[int]:
        clock.advance(request_s)
        words = await read(device_id, table, address, count)
        ages.extend(laser.client.age(name) for name in ("emission", "fault_word"))
        return words

    async def slow_write(device_id: int, table: Table, address: int, values: list[int], *sending: Any) -> None:
        clock.advance(request_s)
        if began <= len(link.writes) < began + WRITES:
            laser.set_power(501.0 if laser.power_setpoint_w == 500.0 else 500.0)  # the next one is there before this one has ended
        await write(device_id, table, address, values, *sending)

    link.read, link.write = slow_read, slow_write  # type: ignore[method-assign]
    began = 10**9
    for _ in range(5):
        await laser.cycle()  # request times are learnt
    ages.clear()
    began = len(link.writes)
    laser.set_power(500.0)
    await laser.cycle()
    assert len(link.writes) >= began + WRITES
    assert max(ages) < laser.client.device.registers["emission"].stale_s


@pytest.mark.parametrize("name", ["trunnion_tcp", "trunnion_rtu", "head_head", "head_table"])
def test_dead_men_of_the_shipped_cells_outlast_a_lost_answer(name: str) -> None:
    cell = load_cell(name)
    assert complaints(cell, {role: load_device(link.device) for role, link in cell.links.items()}) == []


def test_a_dead_man_that_a_lost_answer_on_a_shared_line_costs_is_told() -> None:
    cell = load_cell("trunnion_rtu")
    devices = {role: load_device(link.device) for role, link in cell.links.items()}
    short = {**devices, "laser": load_device("laser_generic")}
    (text,) = complaints(cell, short)
    assert "dead-man of laser" in text and "0.25 s" in text
