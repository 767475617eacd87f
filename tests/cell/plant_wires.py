"""Wires in memory between our drivers and the simulated plant, and a clock that goes when it is told to."""

from __future__ import annotations

import asyncio
import heapq
import itertools
from collections.abc import Callable

from config.cell import Cell
from config.device import Device, Table
from drivers.cell_wires import CellDrivers
from drivers.cnc.driver import CncDriver
from drivers.errors import DeviceFault, DeviceSilent, LinkLost, PortAbsent, WrongAnswer
from drivers.feeder import Feeder
from drivers.interlocks import Io
from drivers.laser import Laser
from drivers.modbus.device import DeviceClient
from sim.modbus.registers import ModbusFault
from sim.modbus.wire import Wire
from sim.world import World


class ManualClock:
    """Time that `advance` moves on."""

    def __init__(self) -> None:
        self._now = 1000.0
        self._sleepers: list[tuple[float, int, asyncio.Future[None]]] = []
        self._order = itertools.count()

    def now(self) -> float:
        return self._now

    async def sleep(self, seconds: float) -> None:
        future: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        heapq.heappush(self._sleepers, (self._now + seconds, next(self._order), future))
        await future

    def advance(self, seconds: float) -> None:
        self._now += seconds
        while self._sleepers and self._sleepers[0][0] <= self._now + 1e-9:
            future = heapq.heappop(self._sleepers)[2]
            if not future.done():
                future.set_result(None)


class FirmwarePort:
    """The serial line to the simulated firmware."""

    name = "cnc"

    def __init__(self, world: World) -> None:
        self._world = world
        self.is_unplugged = False
        self._pulls = world.plug.pulls
        self.sent = bytearray()

    def _check(self) -> None:
        plug = self._world.plug
        if self.is_unplugged or plug.is_out or plug.pulls != self._pulls:
            raise LinkLost("serial port cnc is gone", "plug it in again")

    def read(self) -> bytes:
        self._check()
        return self._world.cnc.transmit()

    def write(self, data: bytes) -> int:
        self._check()
        self.sent += data
        self._world.cnc.receive(data)
        return len(data)

    def queued(self) -> int:
        return 0

    def discard_output(self) -> None:
        self._check()

    def close(self) -> None:
        pass

    def fileno(self) -> int | None:
        return None


class DirectLink:
    """A Modbus line that ends in a register bank of the world; honours the faults of the world's wire."""

    def __init__(self, world: World, role: str, clock: ManualClock, timeout_s: float) -> None:
        self._world = world
        self._role = role
        self._clock = clock
        self._timeout_s = timeout_s
        self.name = f"memory:{role}"
        self.requests = 0
        self.written: list[tuple[str, int, list[int]]] = []
        self._breaks = self._wire.breaks

    @property
    def _wire(self) -> Wire:
        return self._world.wires[self._role]

    @property
    def connected(self) -> bool:
        return not self._wire.is_gone and self._breaks == self._wire.breaks

    async def connect(self) -> None:
        if self._wire.is_gone:
            raise PortAbsent(f"nothing answers at {self.name}", "check the device's power")
        self._breaks = self._wire.breaks

    async def close(self) -> None:
        pass

    async def _answer(self) -> None:
        wire = self._wire
        self.requests += 1
        if not self.connected:
            raise LinkLost(f"{self.name} was closed", "check the device's power and cable")
        delay_s = wire.take_delay_s()
        if wire.is_silent or delay_s > self._timeout_s:
            await self._clock.sleep(self._timeout_s)
            raise DeviceSilent(f"{self.name} does not answer", "look at its power and cable")
        if delay_s:
            await self._clock.sleep(delay_s)
        if wire.exception:
            raise DeviceFault(f"{self.name} answers exception {wire.exception}", "look at the device", wire.exception)

    async def read(self, device_id: int, table: Table, address: int, count: int) -> list[int]:
        await self._answer()
        if self._world.wires[self._role].extra_count:
            raise WrongAnswer(f"{self.name} answers the wrong count", "look at the device")
        try:
            return self._world.banks[self._role].read(table, address, count)
        except ModbusFault as fault:
            raise DeviceFault(f"{self.name}: exception {fault.code}", "", fault.code) from None

    async def write(
        self, device_id: int, table: Table, address: int, values: list[int], sending: Callable[[], None] | None = None
    ) -> None:
        if sending is not None and self.connected:
            sending()
        await self._answer()
        self.written.append((table, address, list(values)))
        try:
            self._world.banks[self._role].write(table, address, values)
        except ModbusFault as fault:
            raise DeviceFault(f"{self.name}: exception {fault.code}", "", fault.code) from None


class PlantWires:
    """Opens drivers onto a World, as often as a cell process is started on it."""

    def __init__(self, cell: Cell, devices: dict[str, Device], world: World, clock: ManualClock) -> None:
        self._cell, self._devices, self._world, self._clock = cell, devices, world, clock
        self.is_port_absent = False
        self.port = FirmwarePort(world)
        self.links: dict[str, DirectLink] = {}

    def open(self) -> CellDrivers:
        cnc = self.reopen_cnc()
        clients = {}
        for role, device in self._devices.items():
            self.links[role] = DirectLink(self._world, role, self._clock, device.timeout_s)
            clients[role] = DeviceClient(device, 1, self.links[role], self._clock)
        return CellDrivers(
            cnc, Laser(clients["laser"]), Feeder(clients["feeder"]), Io(clients["io"]), tuple(self.links.values())
        )

    def reopen_cnc(self) -> CncDriver:
        plug = self._world.plug
        if self.is_port_absent or plug.is_out or plug.name:
            raise PortAbsent("serial port cnc is not there", "plug the CNC in")
        self.port = FirmwarePort(self._world)
        return CncDriver(self.port, self._cell.cnc, self._cell.letters, self._clock)
