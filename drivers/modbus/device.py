"""One Modbus device by its register map: what is wanted, what was read, and whether both agree."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterable
from dataclasses import dataclass

from config.device import Device
from drivers.errors import DeviceFault, DeviceSilent, DriverError, LinkError, RangeError_, WrongAnswer
from drivers.interfaces import Clock, ModbusLink
from drivers.modbus.readback import Disagreements, Heartbeat
from drivers.modbus.registers import LIMITS, check_range, decode, encode, meanings, spans

HEARTBEAT, ECHO = "heartbeat", "heartbeat_readback"
RETRY_S = 0.3  # pause after a device missed twice: longer than it is waited out, so that others on its line have their turn
RECHECK_CYCLES = 25  # set-points without a read-back register are read from their own table this often


@dataclass(frozen=True, slots=True)
class Reading:
    """A value in the register's unit, and the clock time before the request that brought it was sent."""

    value: float
    at: float


class DeviceClient:
    """A device on a link. `cycle` raises no DriverError but keeps it in `last_error`; what it cannot read grows old.

    A device that was lost is wanted safe until somebody asks for something else: it never comes back with the laser on.
    """

    def __init__(self, device: Device, device_id: int, link: ModbusLink, clock: Clock) -> None:
        self.device = device
        self.device_id = device_id
        self.link = link
        self.clock = clock
        self.readings: dict[str, Reading] = {}
        registers = device.registers
        self.desired: dict[str, float] = {
            name: register.safe for name, register in registers.items() if register.safe is not None and name != HEARTBEAT
        }
        self.wake = asyncio.Event()
        self.is_beating = True  # cleared by whoever wants the device's dead-man to trip
        self.last_error: DriverError | None = None
        self.disagreements = Disagreements()
        self.heartbeat = Heartbeat(int(LIMITS.get(registers[HEARTBEAT].type, (0, 0xFFFF))[1]), device.dead_man_s)
        self._safe = dict(self.desired)
        self._written: dict[str, list[int]] = {}
        self._written_at: dict[str, float] = {}
        self._pulses: set[str] = set()
        self._read_spans = spans(registers, [name for name, register in registers.items() if not register.writable])
        self._unproven: set[str] = set()  # written without read-back register, not yet read from their own table
        self._write_only: set[str] = set()
        self._cycles = 0
        self._is_up = False
        self._misses = 0  # cycles without an answer, in a row
        self._answered_at = -math.inf
        self._beat_at = -math.inf  # last try to write the heartbeat
        self._retry_at = -math.inf

    @property
    def connected(self) -> bool:
        """Whether the link is open and the device has answered within its dead-man time."""
        return self.link.connected and self.clock.now() - self._answered_at <= self.device.dead_man_s

    @property
    def trips_in_s(self) -> float:
        """Seconds until the device's own dead-man has tripped, if it hears no heartbeat from now on."""
        return max(0.0, self._beat_at + self.device.dead_man_s - self.clock.now())

    @property
    def faults(self) -> list[str]:
        """What is wrong with what the device holds: wrong values read back, heartbeat not followed."""
        now = self.clock.now()
        found = [f"{self.device.name}: {text}" for text in self.disagreements.faults(now)]
        if self.connected and not self.heartbeat.is_followed(now):
            found.append(f"{self.device.name}: does not follow the heartbeat, its dead-man cannot be trusted")
        return found

    def set(self, name: str, value: float) -> None:
        """Want `value` (register's unit) from the next cycle on. Raises RangeError_; then nothing changes."""
        register = self.device.registers.get(name)
        if register is None or name == HEARTBEAT:
            raise RangeError_(f"{self.device.name}: {name} cannot be set", "name a set-point of its register map")
        check_range(self.device.name, name, register, value)
        if self.desired[name] != value:
            self.desired[name] = float(value)
            self.wake.set()

    def safe(self) -> None:
        """Want every register that can be written at its safe value; it goes first in the next cycle."""
        self._pulses.clear()
        if self.desired != self._safe:
            self.desired.update(self._safe)
            self.wake.set()

    def pulse(self, name: str) -> None:
        """Write 1 once and its safe value at the cycle after. Raises RangeError_."""
        self.set(name, 1.0)
        self._pulses.add(name)

    def value(self, name: str) -> float:
        """Last reading, register's unit; NaN if it was never read."""
        reading = self.readings.get(name)
        return math.nan if reading is None else reading.value

    def age(self, name: str) -> float:
        """Seconds since the reading; infinite if it was never read."""
        reading = self.readings.get(name)
        return math.inf if reading is None else self.clock.now() - reading.at

    def is_stale(self, name: str) -> bool:
        """Whether the reading is older than the register's stale limit."""
        return self.age(name) > self.device.registers[name].stale_s

    def oldest(self, names: Iterable[str]) -> float:
        """Greatest age of several readings, s."""
        return max((self.age(name) for name in names), default=math.inf)

    def flags(self, name: str) -> list[str]:
        """Texts of the bits that are set in a word of flags."""
        return meanings(name, self.device.registers[name], self.value(name))

    async def cycle(self) -> None:
        """Connect if need be, write what changed and the heartbeat (safe direction first), read all, compare."""
        if self.clock.now() < self._retry_at and not self.wake.is_set():
            return
        self.wake.clear()
        try:
            if not self.link.connected:
                self._lose()
                await self.link.connect()
            error = await self._write_changes(self.is_beating)
            error = await self._read_all() or error
        except LinkError as lost:
            self._miss(lost)
            return
        self._answered_at = self.clock.now()
        self._is_up = True
        self._misses = 0
        self.last_error = self._named(error) if error else None
        self._compare()

    async def _write_changes(self, beat: bool) -> DriverError | None:
        """Write what differs from what was last taken; the first refusal, if any. Raises LinkError."""
        wanted = {name: encode(self.device.registers[name], value) for name, value in self.desired.items()}
        changed = [name for name, words in wanted.items() if self._written.get(name) != words]
        to_safe = [name for name in changed if self.desired[name] == self._safe[name]]
        others = [name for name in changed if name not in to_safe]
        if beat:
            others.append(HEARTBEAT)
            wanted[HEARTBEAT] = encode(self.device.registers[HEARTBEAT], self.heartbeat.next())
        error: DriverError | None = None
        # bits gate what words set: off before, on after
        for names, is_bit in ((to_safe, True), (to_safe, False), (others, False), (others, True)):
            chosen = [name for name in names if (self.device.registers[name].type == "bit") == is_bit]
            for group in [[name] for name in chosen] if is_bit else [list(s.names) for s in spans(self.device.registers, chosen)]:
                refusal = await self._write(group, wanted)
                error = error or refusal
        return error

    async def _write(self, group: list[str], wanted: dict[str, list[int]]) -> DriverError | None:
        register = self.device.registers[group[0]]
        at = self.clock.now()
        if HEARTBEAT in group:
            self._beat_at = at
        try:
            await self.link.write(self.device_id, register.table, register.address, [w for name in group for w in wanted[name]])
        except (DeviceFault, WrongAnswer) as error:
            for name in group:
                self._written.pop(name, None)
            return error
        for name in group:
            if name == HEARTBEAT:
                self.heartbeat.sent(at)
                continue
            self._written[name] = wanted[name]
            self._written_at[name] = self.clock.now()
            if name in self._pulses:
                self._pulses.discard(name)
                self.desired[name] = self._safe[name]
            elif self.device.registers[name].readback is None:
                self._unproven.add(name)
        return None

    async def _read_all(self) -> DriverError | None:
        """Read every span; the first refusal, if any. What is set meanwhile goes out between two reads. Raises LinkError."""
        error: DriverError | None = None
        for span in self._read_spans:
            if self.wake.is_set():
                self.wake.clear()
                error = await self._write_changes(beat=False) or error
            at = self.clock.now()
            try:
                words = await self.link.read(self.device_id, span.table, span.address, span.count)
            except (DeviceFault, WrongAnswer) as refusal:
                error = error or refusal
                continue
            for name in span.names:
                register = self.device.registers[name]
                start = register.address - span.address
                self.readings[name] = Reading(decode(register, words[start : start + register.count]), at)
        return await self._prove() or error

    async def _prove(self) -> DriverError | None:
        """Read set-points without a read-back register from their own table, after a write and now and then."""
        self._cycles += 1
        if self._cycles % RECHECK_CYCLES == 0:
            self._unproven |= {name for name in self._written if self.device.registers[name].readback is None}
        names = self._unproven - self._write_only
        self._unproven = set()
        for span in spans(self.device.registers, names):
            before = {name: self._written.get(name) for name in span.names}
            try:
                words = await self.link.read(self.device_id, span.table, span.address, span.count)
            except DeviceFault as refusal:
                if refusal.code not in (1, 2):
                    return refusal
                self._write_only |= set(span.names)
                continue
            except WrongAnswer as wrong:
                return wrong
            for name in span.names:
                register = self.device.registers[name]
                start = register.address - span.address
                self._judge(name, before[name], words[start : start + register.count])
        return None

    def _judge(self, name: str, written: list[int] | None, held: list[int]) -> None:
        if written is None or written != self._written.get(name):
            return
        if written == held:
            self.disagreements.agree(name)
            return
        register = self.device.registers[name]
        text = f"{name} is {decode(register, written):g} {register.unit}, the device holds {decode(register, held):g}"
        self.disagreements.differ(name, text, self.clock.now())
        self._written.pop(name, None)

    def _compare(self) -> None:
        """Set-points against their read-back registers, heartbeat against its echo."""
        now = self.clock.now()
        for name, register in self.device.registers.items():
            reading = self.readings.get(register.readback) if register.readback else None
            if reading is None or name not in self._written or reading.at < self._written_at[name]:
                continue
            told = decode(register, self._written[name])
            if abs(told - reading.value) <= register.readback_tolerance + abs(register.scale) / 2:
                self.disagreements.agree(name)
                continue
            self.disagreements.differ(name, f"{name} is {told:g} {register.unit}, reads {reading.value:g}", now)
            self._written.pop(name)
        echo = self.readings.get(ECHO)
        if echo is not None:
            self.heartbeat.echo(echo.value, echo.at)

    def _miss(self, error: LinkError) -> None:
        """No answer: write everything again when it is back; gone for longer than its dead-man: want it safe."""
        now = self.clock.now()
        self.last_error = self._named(error)
        self._written.clear()
        self._misses += 1
        is_once = isinstance(error, DeviceSilent) and self.link.connected and self._misses == 1
        if not is_once:
            self._retry_at = now + RETRY_S
        if not self.link.connected:
            self._lose()
        if now - self._answered_at > self.device.dead_man_s:
            self._lose()

    def _lose(self) -> None:
        """Once, when a device that answered is gone: what was wanted of it holds no more."""
        if not self._is_up:
            return
        self._is_up = False
        self._written.clear()
        self.disagreements.clear()
        self.heartbeat.clear()
        self._pulses.clear()
        self.desired.update(self._safe)

    def _named(self, error: DriverError) -> DriverError:
        """The error with this device's name in front."""
        named = type(error)(f"{self.device.name}: {error.message}", error.hint)
        if isinstance(error, DeviceFault) and isinstance(named, DeviceFault):
            named.code = error.code
        return named
