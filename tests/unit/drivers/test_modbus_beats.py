"""How far apart the heartbeats of devices on one line are, in simulated time, with requests that take as long as on a real line."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from config.device import Table, load_device
from drivers.errors import DeviceSilent
from drivers.modbus.device import DeviceClient
from drivers.modbus.turn import Turn
from tests.unit.drivers.fakes import ManualClock
from tests.unit.drivers.test_modbus_device import MemoryLink

ALONE = ("laser_generic",)
SHARED = ("laser_shared_line", "io_generic", "feeder_generic")
PERIOD_S, LEAST_PAUSE_S = 0.01, 0.001  # as the cell's own task has them


class SlowLink(MemoryLink):
    """A line on which every request takes `takes_s`; the beats of device 1 are noted. lost : ids whose next answer does not come"""

    def __init__(self, clock: ManualClock, takes_s: float) -> None:
        super().__init__(clock)
        self.is_open = True
        self.takes_s = takes_s
        self.beats_at: list[float] = []
        self.lost: set[int] = set()
        self.blocks_s = 0.0

    def _pass(self, device_id: int) -> None:
        self.clock.advance(self.takes_s)
        if device_id in self.lost:
            self.lost.discard(device_id)
            self.clock.advance(self.blocks_s)
            raise DeviceSilent("silent")

    async def read(self, device_id: int, table: Table, address: int, count: int) -> list[int]:
        self._pass(device_id)
        return [0] * count

    async def write(
        self, device_id: int, table: Table, address: int, values: list[int], sending: Callable[[], None] | None = None
    ) -> None:
        if sending is not None:
            sending()
        if device_id == 1 and (table, address) == ("holding", 1):
            self.beats_at.append(self.clock.now())
        self._pass(device_id)

    @property
    def gaps_s(self) -> list[float]:
        return [b - a for a, b in zip(self.beats_at, self.beats_at[1:], strict=False)]


def line(takes_s: float, maps: tuple[str, ...]) -> tuple[list[DeviceClient], SlowLink, ManualClock]:
    clock = ManualClock()
    link, turn = SlowLink(clock, takes_s), Turn(clock)
    return [DeviceClient(load_device(name), 1 + k, link, clock, turn=turn) for k, name in enumerate(maps)], link, clock


async def go_round(clients: list[DeviceClient], clock: ManualClock, rounds: int) -> None:
    for _ in range(rounds):
        began = clock.now()
        for client in clients:
            await client.cycle()
        clock.advance(max(PERIOD_S - (clock.now() - began), LEAST_PAUSE_S))


@pytest.mark.parametrize(
    ("takes_s", "maps", "count"),
    [(0.001, ALONE, 3), (0.003, ALONE, 3), (0.02, ALONE, 3), (0.04, ALONE, 3), (0.009, SHARED, 3), (0.012, SHARED, 2)],
)
async def test_so_many_heartbeats_are_begun_within_the_dead_mans_time_and_the_request_under_way(
    takes_s: float, maps: tuple[str, ...], count: int
) -> None:
    clients, link, clock = line(takes_s, maps)
    await go_round(clients, clock, 3)
    link.beats_at.clear()
    await go_round(clients, clock, 100)
    assert max(link.gaps_s) <= clients[0].device.dead_man_s / count + takes_s
    assert len(link.gaps_s) > 10


@pytest.mark.parametrize("begins", range(0, 30, 3))
async def test_on_a_shared_line_one_lost_answer_of_another_device_does_not_cost_the_lasers_dead_man(begins: int) -> None:
    clients, link, clock = line(0.009, SHARED)
    await go_round(clients, clock, 3)
    laser, _, feeder = clients
    link.blocks_s = 2.0 * feeder.device.timeout_s  # missed, and waited out
    for k in range(begins):
        await clients[k % 3].cycle()
        clock.advance(0.003)
    link.lost.add(3)
    await go_round(clients, clock, 5)
    assert not link.lost and max(link.gaps_s) < laser.device.dead_man_s


@pytest.mark.parametrize(("age_share", "first"), [(0.25, "coil"), (0.35, "holding")])
async def test_gate_that_is_switched_goes_before_a_heartbeat_that_may_wait_and_behind_one_that_may_not(age_share: float, first: str) -> None:
    clients, link, clock = line(0.001, ALONE)
    await go_round(clients, clock, 3)
    asked: list[str] = []
    write = link.write

    async def noted(device_id: int, table: Table, address: int, values: list[int], sending: Callable[[], None] | None = None) -> None:
        asked.append(table)
        await write(device_id, table, address, values, sending)

    link.write = noted  # type: ignore[method-assign]
    clock.advance(clients[0].beats.at + age_share * clients[0].device.dead_man_s - clock.now())
    clients[0].set("emission_permit", 1.0)
    await clients[0].flush()
    assert asked[0] == first and sorted(asked) == ["coil", "holding"]
