"""The hose is learnt from steps of the rate read back, where that is measured at the nozzle."""

from __future__ import annotations

import struct

import pytest

from config.device import load_device
from drivers.feeder import Feeder
from drivers.modbus.device import DeviceClient
from tests.unit.drivers.fakes import ManualClock
from tests.unit.drivers.test_modbus_device import MemoryLink

CYCLE_S = 0.01


def shown(rate_g_min: float) -> list[int]:
    high, low = struct.unpack(">HH", struct.pack(">f", rate_g_min))
    return [low, high]


async def steps_of(hose_s: float, steps: int) -> Feeder:
    """A feeder behind a hose of `hose_s` whose rate is switched on and off."""
    clock = ManualClock()
    link = MemoryLink(clock)
    feeder = Feeder(DeviceClient(load_device("feeder_generic"), 1, link, clock))
    await feeder.cycle()
    for step in range(steps):
        goal = 8.0 if step % 2 == 0 else 0.0
        feeder.set_rate(goal)
        began = clock.now()
        while clock.now() < began + hose_s + 1.0:
            if clock.now() - began >= hose_s:
                link.tables["input", 0], link.tables["input", 1] = shown(goal)
            clock.advance(CYCLE_S)
            await feeder.cycle()
    return feeder


@pytest.mark.parametrize("hose_s", [0.4, 1.9])
async def test_the_hose_is_learnt_within_a_cycle_whatever_the_cell_file_says(hose_s: float) -> None:
    feeder = await steps_of(hose_s, 4)
    learnt = feeder.client.latency.transport.believed(1.2)
    assert learnt.samples >= 3
    assert learnt.value_s == pytest.approx(hose_s, abs=2.0 * CYCLE_S)


async def test_a_hose_that_was_seen_twice_only_is_not_yet_believed() -> None:
    feeder = await steps_of(0.4, 2)
    assert feeder.client.latency.transport.believed(1.2).value_s == 1.2
