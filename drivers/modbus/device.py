"""One Modbus device by its register map: what is wanted, what was read, and whether both agree."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from config.device import Device
from drivers.errors import DeviceFault, DeviceSilent, DriverError, LinkError, WrongAnswer
from drivers.interfaces import Clock, ModbusLink
from drivers.modbus.beats import Beats
from drivers.modbus.latency import Latency
from drivers.modbus.registers import Span, decode, encode, spans
from drivers.modbus.turn import Turn
from drivers.modbus.wanted import Wanted
from drivers.modbus.watcher import Watcher
from drivers.modbus.write_order import next_group
from drivers.modbus.written import HEARTBEAT

RETRY_S = 0.3  # pause after a device missed twice: longer than it is waited out, so that others on its line have their turn
PROVE_SHARE = 0.4  # of the stale limit: readings older than that go before proofs
PROVE_BEFORE = 3.0  # times what a reading takes: nearer to a write that is due there is no proof, unless readings are young
RECHECK_CYCLES = 25  # set-points without a read-back register are read from their own table this often


class DeviceClient(Wanted):
    """A device on a link. `cycle` raises no DriverError but keeps it in `last_error`; what it cannot read grows old.

    A device that was lost is wanted safe until somebody asks for something else: it never comes back with the laser on.
    """

    def __init__(
        self, device: Device, device_id: int, link: ModbusLink, clock: Clock, *, turn: Turn | None = None, answer_line_s: float = 0.0
    ) -> None:
        """turn : of the line that is shared; answer_line_s : of an answer to a write, on the line itself"""
        super().__init__(device, clock, turn if turn is not None else Turn(clock))
        self.turn.join(self)
        self.device_id = device_id
        self.link = link
        self.latency = Latency(device, answer_line_s)
        self.watcher: Watcher | None = None
        self.is_beating = True  # cleared by whoever wants the device's dead-man to trip
        self.on_level: Callable[[], None] | None = None  # called as soon as a level or a word of flags was read that differs from before
        self._levels = frozenset(name for name, register in device.registers.items() if not register.writable and register.is_level)
        self.last_error: DriverError | None = None
        self._read_spans = spans(device.registers, [name for name, register in device.registers.items() if not register.writable])
        self._contacts = [span for span in self._read_spans if span.table == "discrete"] if device.role == "io" else []
        self._sensed_at = -math.inf
        self._unproven: set[str] = set()  # written without read-back register, not yet read from their own table
        self._cycles = 0
        self._is_up = False
        self._misses = 0  # cycles without an answer, in a row
        self._answered_at = -math.inf
        self.beats = Beats(device)
        self._retry_at = -math.inf

    @property
    def connected(self) -> bool:
        """Whether the link is open, everything was read once, and the device has answered within its dead-man time."""
        return self._is_up and self.link.connected and self.clock.now() - self._answered_at <= self.device.dead_man_s

    @property
    def trips_in_s(self) -> float:
        """Seconds until the device's own dead-man has tripped, if it hears no heartbeat from now on."""
        return self.beats.trips_in_s(self.clock.now())

    @property
    def faults(self) -> list[str]:
        """What is wrong with what the device holds: wrong values read back, heartbeat not followed."""
        now = self.clock.now()
        found = [f"{self.device.name}: {text}" for text in self.disagreements.faults(now)]
        if self.connected and not self.heartbeat.is_followed(now):
            found.append(f"{self.device.name}: does not follow the heartbeat, its dead-man cannot be trusted")
        return found

    def share(self, turn: Turn) -> None:
        """Take turns with the other devices of the line."""
        self.turn = turn
        turn.join(self)

    @property
    def is_waiting(self) -> bool:
        """Whether the next reading tells how long the device takes."""
        return self.watcher is not None and self.watcher.is_waiting

    async def cycle(self) -> None:
        """Connect if need be, write what changed and the heartbeat (safe first), read all, compare."""
        if self.clock.now() < self._retry_at and not self.wake.is_set():
            return
        self.wake.clear()
        self._ebb()
        try:
            if not self.link.connected:
                self._lose("its connection broke")
                await self.link.connect()
            await self.turn.let_others_write(self)
            error = await self._write_changes(self._is_beating_now())
            error = await self._read_all() or error
        except LinkError as lost:
            self._miss(lost)
            return
        self._is_up = True
        self._misses = 0
        self.last_error = self._named(error) if error else None
        self._compare()
        if self.restarts.is_seen:
            self._lose("it was started anew")
        if self.restarts.answered() and self.on_level is not None:
            self.on_level()

    def _is_beating_now(self) -> bool:
        now, takes_s = self.clock.now(), self.latency.write.usual_s
        if not self.is_beating or not self.beats.is_due(now, is_shared=self.turn.is_shared, can_wait=False):
            return False  # what goes before it makes it no earlier
        can_wait = self.beats.is_costly(takes_s) or self._is_about_stale or self.turn.taken_at(now, takes_s) is not None
        return not can_wait or self.beats.is_due(now, is_shared=self.turn.is_shared, can_wait=True)

    @property
    def is_beat_due(self) -> bool:
        """Whether a heartbeat goes before anybody's next reading."""
        return self.beats_by < math.inf and self._is_beating_now()

    @property
    def beats_by(self) -> float:
        """Wire time (s) by which the next heartbeat has to go; infinite for a device that is lost or left in peace."""
        is_reached = self.is_beating and self._is_up and self.link.connected and self.clock.now() >= self._retry_at
        return self.beats.latest_at if is_reached else math.inf

    @property
    def _is_about_stale(self) -> bool:
        """Whether another write before the next readings would let one of them grow stale."""
        return self._is_up and self._patience_s < 0.0

    @property
    def _patience_s(self) -> float:
        """How long readings may be put off (s)."""
        return self.patience_s(self._read_spans, self.latency.read.usual_s, self.latency.write.usual_s)

    async def flush(self) -> None:
        """Write what was set and a heartbeat that is due, nothing else; errors are in `last_error`."""
        self.wake.clear()
        if not self.link.connected or self.clock.now() < self._retry_at:
            return  # its own next cycle writes everything
        try:
            error = await self._write_changes(self.is_beat_due)
        except LinkError as lost:
            self._miss(lost)
            return
        self.last_error = self._named(error) if error else self.last_error

    async def _write_changes(self, beat: bool) -> DriverError | None:
        """Write what differs from what was last taken; the first refusal, if any. Raises LinkError.

        What is next is chosen anew before every request: what turned safe meanwhile goes first, what is wanted no more goes never.
        A reading that is about to grow stale goes before all but a gate that is shut and a heartbeat that is late; a gate that is
        switched at its own time goes before a heartbeat that is not.
        """
        error: DriverError | None = None
        refused: set[tuple[str, tuple[int, ...]]] = set()
        reads = 0  # since the last write
        while True:
            words = {name: encode(self.device.registers[name], value) for name, value in self.desired.items()}
            changed = [name for name, w in words.items() if self._written.get(name) != w and (name, tuple(w)) not in refused]
            to_safe = [name for name in changed if self.desired[name] == self._safe[name]]
            others = [name for name in changed if name not in to_safe]
            is_gate_first = self.clock.now() < self.beats.latest_at and any(self.device.registers[name].type == "bit" for name in changed)
            if beat and not is_gate_first:
                others.append(HEARTBEAT)
                words[HEARTBEAT] = encode(self.device.registers[HEARTBEAT], self.heartbeat.following)
            group = next_group(self.device.registers, to_safe, others)
            if not group:
                return error
            is_gate_shut = group[0] in to_safe and self.device.registers[group[0]].type == "bit"
            is_urgent = is_gate_shut or (HEARTBEAT in group and self.beats.is_late(self.clock.now()))
            if self._is_about_stale and not is_urgent and reads < len(self._read_spans):
                error = await self._read_span(self._oldest(self._read_spans)) or error
                reads += 1
                continue
            reads = 0
            if HEARTBEAT in group:
                self.heartbeat.next()
                beat = False
            refusal = await self._write(group, words)
            if refusal is not None:
                refused |= {(name, tuple(words[name])) for name in group}
                error = error or refusal
            await self.turn.let_others_write(self)

    async def _write(self, group: list[str], words: dict[str, list[int]]) -> DriverError | None:
        register = self.device.registers[group[0]]
        at = self.clock.now()
        sending = (lambda: self.beats.sent(self.clock.now())) if HEARTBEAT in group else None
        try:
            await self.link.write(self.device_id, register.table, register.address, [w for name in group for w in words[name]], sending)
        except (DeviceFault, WrongAnswer) as error:
            self._answered_at = self.clock.now()
            for name in group:
                self._written.pop(name, None)
            return error
        ended = self._answered_at = self.clock.now()
        self.latency.write.took(ended - at)
        for name in group:
            if name == HEARTBEAT:
                self.heartbeat.sent(at)
                continue
            self._written[name] = words[name]
            self._written_at[name] = ended
            self._proven.pop(name, None)
            if name in self._pulses:
                self._pulses.discard(name)
                self._ebbing.add(name)
            elif self.device.registers[name].readback is None:
                self._unproven.add(name)
        if self.watcher is not None:
            self.watcher.wrote(group, at, ended)
        return None

    async def _read_all(self) -> DriverError | None:
        """Read every span; the first refusal, if any. What is set meanwhile goes out between two reads. Raises LinkError."""
        error: DriverError | None = None
        began = self.clock.now()
        left = list(self._read_spans)
        while left:
            error = await self._give_way() or error
            left = [span for span in left if not self._is_just_read(span, began)]
            if left:
                span = self._oldest(left)
                left.remove(span)
                error = await self._read_span(span) or error
        return await self._prove() or error

    def _oldest(self, of: Sequence[Span]) -> Span:
        return max(of, key=self.urgency)

    def _is_just_read(self, span: Span, began: float) -> bool:
        """Whether it was read since this round began, or its contacts a moment ago between two requests of others."""
        reading = self.readings.get(span.names[0])
        is_sensed = span in self._contacts and self.turn.is_shared and self.clock.now() - self._sensed_at < self.device.poll_s
        return is_sensed or (reading is not None and reading.at >= began)

    async def _read_span(self, span: Span) -> DriverError | None:
        """Read one span; its refusal, if any. Raises LinkError."""
        at = self.clock.now()
        if span in self._contacts:
            self._sensed_at = at
        try:
            words = await self.link.read(self.device_id, span.table, span.address, span.count)
        except (DeviceFault, WrongAnswer) as refusal:
            self._answered_at = self.clock.now()
            return refusal
        ended = self._answered_at = self.clock.now()
        self.latency.read.took(ended - at)
        values = []
        is_news = False
        for name in span.names:
            register = self.device.registers[name]
            start = register.address - span.address
            values.append(decode(register, words[start : start + register.count]))
            is_news = is_news or (name in self._levels and values[-1] != self.value(name))
        self.keep(span, values, at)
        if is_news and self.on_level is not None:
            self.on_level()
        if self.watcher is not None:
            self.watcher.read(span.names, at, ended)
        return None

    @property
    def is_sense_due(self) -> bool:
        """Whether it has contacts, and they were read longer ago than its poll period."""
        now = self.clock.now()
        return self._is_up and bool(self._contacts) and now >= self._retry_at and now - self._sensed_at >= self.device.poll_s

    async def sense(self) -> None:
        """Read the contacts, nothing else: between two requests of other devices on the line. Errors are in `last_error`."""
        try:
            for span in self._contacts:
                await self._read_span(span)
        except LinkError as lost:
            self._miss(lost)

    async def _give_way(self) -> DriverError | None:
        """Before a reading: what was set goes first; the first refusal, if any. Raises LinkError."""
        error: DriverError | None = None
        while True:
            await self.turn.before_read(self, self.latency.read.usual_s, self._patience_s)
            if not (self.wake.is_set() or self.is_beat_due):
                return error
            self.wake.clear()
            error = await self._write_changes(self.is_beat_due) or error

    async def _prove(self) -> DriverError | None:
        """Read set-points without a read-back register from their own table, after a write and now and then."""
        self._cycles += 1
        if self._cycles % RECHECK_CYCLES == 0:
            self._unproven |= {name for name in self._written if self.device.registers[name].readback is None}
        names, self._unproven = self._unproven - self._write_only, set()
        for span in spans(self.device.registers, names):
            await self._give_way()
            takes_s = self.latency.read.usual_s
            is_awaited = self.turn.taken_at(self.clock.now(), PROVE_BEFORE * takes_s) is not None
            is_old = max(self.urgency(each) for each in self._read_spans) > PROVE_SHARE
            if is_old or (is_awaited and self._patience_s < PROVE_BEFORE * takes_s):
                self._unproven |= set(span.names)  # another time: readings are about to grow stale
                continue
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
            self._lose("its connection broke")
        if now - self._answered_at > self.device.dead_man_s:
            self._lose(f"it was silent for {self.device.dead_man_s:g} s")

    def _lose(self, why: str) -> None:
        """Once, when a device that answered is gone: what was wanted of it holds no more."""
        if not self._is_up:
            return
        self._is_up = False
        self.restarts.cut_off(why)
        self._written.clear()
        self.disagreements.clear()
        self.heartbeat.clear()
        self._pulses.clear()
        self.desired.update(self._safe)

    def _named(self, error: DriverError) -> DriverError:
        """The error with this device's name in front."""
        text = f"{self.device.name}: {error.message}"
        return DeviceFault(text, error.hint, error.code) if isinstance(error, DeviceFault) else type(error)(text, error.hint)
