"""A device client on a link in memory, in simulated time: order of writes, staleness, what holds after a loss."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from config.device import Table, load_device
from drivers.errors import DeviceFault, DeviceSilent, LinkLost, RangeError_
from drivers.feeder import Feeder
from drivers.interlocks import Io
from drivers.laser import Laser
from drivers.modbus.device import DeviceClient
from tests.unit.drivers.fakes import ManualClock


class MemoryLink:
    """Registers of one device; knows what was written in which order and can refuse, be silent or be cut."""

    def __init__(self, clock: ManualClock) -> None:
        self.name = "memory"
        self.clock = clock
        self.is_open = False
        self.is_silent = False
        self.refused: set[tuple[str, int]] = set()
        self.tables: dict[tuple[str, int], int] = {}
        self.echo: dict[tuple[str, int], tuple[str, int]] = {}
        self.writes: list[tuple[str, int, list[int]]] = []
        self.reads = 0

    @property
    def connected(self) -> bool:
        return self.is_open

    async def connect(self) -> None:
        self.is_open = True

    async def close(self) -> None:
        self.is_open = False

    def _check(self, table: str, address: int) -> None:
        self.clock.advance(0.001)
        if not self.is_open:
            raise LinkLost("cut")
        if self.is_silent:
            raise DeviceSilent("silent")
        if (table, address) in self.refused:
            raise DeviceFault("refused", code=3)

    async def read(self, device_id: int, table: Table, address: int, count: int) -> list[int]:
        self._check(table, address)
        self.reads += 1
        return [self.tables.get((table, address + k), 0) for k in range(count)]

    async def write(
        self, device_id: int, table: Table, address: int, values: list[int], sending: Callable[[], None] | None = None
    ) -> None:
        if sending is not None:
            sending()
        self._check(table, address)
        self.writes.append((table, address, values))
        for k, value in enumerate(values):
            self.tables[table, address + k] = value
            if (table, address + k) in self.echo:
                self.tables[self.echo[table, address + k]] = value


def laser() -> tuple[Laser, MemoryLink, ManualClock]:
    clock = ManualClock()
    link = MemoryLink(clock)
    link.echo = {("holding", 0): ("input", 4), ("holding", 1): ("input", 3)}
    return Laser(DeviceClient(load_device("laser_generic"), 1, link, clock)), link, clock


async def test_first_cycle_writes_every_safe_value_before_anything_else() -> None:
    one, link, _ = laser()
    link.tables["coil", 1] = 1
    await one.cycle()
    assert link.tables["coil", 1] == 0 and link.tables["holding", 0] == 0
    assert one.connected


async def test_going_on_power_is_set_before_the_permit_and_going_off_the_permit_falls_first() -> None:
    one, link, _ = laser()
    await one.cycle()
    link.writes.clear()
    one.permit(True)
    one.enable(True)
    one.set_power(400.0)
    await one.cycle()
    places = [(table, address) for table, address, _ in link.writes]
    assert places.index(("holding", 0)) < places.index(("coil", 0)) < places.index(("coil", 1))
    link.writes.clear()
    one.safe()
    await one.cycle()
    places = [(table, address) for table, address, _ in link.writes]
    assert places.index(("coil", 1)) < places.index(("holding", 0))


async def test_safe_marks_at_once_and_wakes_the_poller_and_twice_is_harmless() -> None:
    one, _, _ = laser()
    await one.cycle()
    one.set_power(100.0)
    one.client.wake.clear()
    one.safe()
    assert one.power_setpoint_w == 0.0 and one.client.wake.is_set()
    one.client.wake.clear()
    one.safe()
    assert not one.client.wake.is_set()


async def test_what_is_set_while_reading_goes_out_before_the_next_read() -> None:
    one, link, _ = laser()
    await one.cycle()
    original, order = link.read, []

    async def read(device_id: int, table: Table, address: int, count: int) -> list[int]:
        order.append(f"read {table}")
        if len(order) == 1:
            one.set_power(300.0)
        return await original(device_id, table, address, count)

    link.read = read  # type: ignore[method-assign]
    link.writes.clear()
    await one.cycle()
    assert ("holding", 0, [3000]) in link.writes


async def test_refused_write_does_not_keep_the_others_back_and_is_told_and_repeated() -> None:
    one, link, _ = laser()
    await one.cycle()
    link.refused.add(("holding", 0))
    link.writes.clear()
    one.set_power(100.0)
    one.enable(True)
    await one.cycle()
    assert ("coil", 0, [1]) in link.writes
    assert one.last_error is not None and isinstance(one.last_error, DeviceFault) and one.last_error.code == 3
    link.refused.clear()
    await one.cycle()
    assert link.tables["holding", 0] == 1000


async def test_reading_grows_old_and_is_stale_after_its_limit_and_a_stale_laser_counts_as_emitting() -> None:
    one, link, clock = laser()
    assert math.isnan(one.power_readback_w) and one.age_s == math.inf and one.is_emitting
    await one.cycle()
    assert not one.is_emitting and one.age_s < 0.05
    link.is_silent = True
    for _ in range(30):
        clock.advance(0.01)
        await one.cycle()
    assert one.client.is_stale("emission") and one.is_emitting


async def test_lost_device_is_wanted_safe_and_comes_back_without_emission() -> None:
    one, link, clock = laser()
    await one.cycle()
    one.permit(True)
    one.set_power(500.0)
    await one.cycle()
    link.is_silent = True
    for _ in range(100):
        clock.advance(0.01)
        await one.cycle()
    assert not one.connected and not one.is_permitted and one.power_setpoint_w == 0.0
    link.is_silent = False
    clock.advance(0.5)
    await one.cycle()
    assert one.connected and link.tables["coil", 1] == 0 and link.tables["holding", 0] == 0


async def test_one_missed_answer_keeps_what_is_wanted_and_writes_it_again() -> None:
    one, link, clock = laser()
    await one.cycle()
    one.set_power(500.0)
    await one.cycle()
    link.is_silent = True
    await one.cycle()
    link.is_silent = False
    link.tables["holding", 0] = 7
    clock.advance(0.02)
    await one.cycle()
    assert one.power_setpoint_w == 500.0 and link.tables["holding", 0] == 5000


async def test_stop_goes_out_at_once_even_while_a_device_that_missed_is_left_in_peace() -> None:
    one, link, clock = laser()
    await one.cycle()
    one.permit(True)
    await one.cycle()
    link.is_silent = True
    for _ in range(2):
        clock.advance(0.02)
        await one.cycle()
    link.is_silent = False
    one.safe()
    await one.cycle()
    assert link.tables["coil", 1] == 0


async def test_fault_reset_is_written_once_and_taken_back_at_the_next_cycle() -> None:
    one, link, _ = laser()
    await one.cycle()
    link.writes.clear()
    one.reset_faults()
    await one.cycle()
    await one.cycle()
    await one.cycle()
    assert [values for table, address, values in link.writes if (table, address) == ("coil", 2)] == [[1], [0]]


async def test_heartbeat_counts_four_times_in_the_dead_mans_time_until_it_is_stopped() -> None:
    one, link, clock = laser()
    beats = []
    for _ in range(4):
        await one.cycle()
        await one.cycle()
        beats.append(link.tables["holding", 1])
        clock.advance(one.client.device.dead_man_s / 4)
    assert beats == [1, 2, 3, 4]
    one.client.is_beating = False
    await one.cycle()
    assert link.tables["holding", 1] == 4


async def test_frozen_heartbeat_echo_is_told_after_the_dead_man_time() -> None:
    one, link, clock = laser()
    del link.echo["holding", 1]
    for _ in range(40):
        await one.cycle()
        clock.advance(0.02)
    assert any("heartbeat" in text for text in one.faults)


async def test_wrong_value_read_back_is_told_only_after_the_device_had_time() -> None:
    one, link, clock = laser()
    await one.cycle()
    del link.echo["holding", 0]
    one.set_power(100.0)
    await one.cycle()
    assert one.faults == []
    for _ in range(20):
        clock.advance(0.02)
        await one.cycle()
    assert one.faults == ["generic fibre laser: wrong value read back: power_setpoint is 100 W, reads 0"]


async def test_value_out_of_range_is_refused_and_nothing_changes() -> None:
    one, _, _ = laser()
    with pytest.raises(RangeError_, match="greatest is 2000 W"):
        one.set_power(5000.0)
    assert one.power_setpoint_w == 0.0
    with pytest.raises(RangeError_, match="cannot be set"):
        one.client.set("colour", 1.0)


async def test_feeder_values_pass_through_scale_and_word_order() -> None:
    clock = ManualClock()
    link = MemoryLink(clock)
    feeder = Feeder(DeviceClient(load_device("feeder_generic"), 2, link, clock))
    await feeder.cycle()
    feeder.set_rate(1.5)
    feeder.set_carrier_gas(6.5)
    link.tables.update({("input", 0): 0, ("input", 1): 0x4120, ("input", 4): 4321, ("input", 5): 0b110})
    await feeder.cycle()
    assert [link.tables["holding", k] for k in range(3)] == [0, 0x3FC0, 65]
    assert feeder.rate_readback_g_min == 10.0 and feeder.hopper_fraction == pytest.approx(0.4321)
    assert feeder.faults[:2] == ["hopper empty", "line clogged"]
    feeder.safe()
    await feeder.cycle()
    assert [link.tables["holding", k] for k in range(4)] == [0, 0, 0, 0]


async def test_levels_that_are_stale_or_never_read_are_unsafe() -> None:
    clock = ManualClock()
    link = MemoryLink(clock)
    io = Io(DeviceClient(load_device("io_generic"), 3, link, clock))
    assert not io.door_closed and not io.estop_ok
    link.tables.update({("discrete", k): 1 for k in range(7)})
    await io.cycle()
    assert io.door_closed and io.estop_ok and io.head_deployed
    clock.advance(0.3)
    assert not io.door_closed and not io.estop_ok
    assert io.chiller_ok
