"""The safety tick's senses: levels gathered every tick, and the faults seen in them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from cellctl.cell.laser_hand import LaserHand
from cellctl.cell.late_answers import why_late
from cellctl.cell.modes import DEPOSIT, MILL
from cellctl.domain.causes import SEPARATOR, cause_of_alarm, causes_of_interlocks, is_explained, tells_of_heartbeat
from cellctl.domain.interlocks import Levels, Signal, permissives
from cellctl.domain.reactions import INTERLOCK_CAUSE
from cellctl.domain.snapshot import Permissive
from cellctl.domain.states import ACTIVE, IN_JOB, State
from config.cell import Cell
from drivers.cell_wires import CellDrivers
from drivers.errors import LinkError
from drivers.interfaces import Clock
from drivers.modbus.device import DeviceClient

DARK_GRACE_S = 0.3  # from the permit's end until read-backs have to show it: request, ramp and reading
FLOW_GRACE_S = 1.5  # powder may be off its set-point that long before it counts as lost
FLOW_BAND = 3.0  # times powder_settle_tolerance
TOOL_GRACE_S = 1.0
OPENINGS = "_openings"  # ending of the registers that count how often a contact has opened
BRIEFLY = "it has opened and closed between two readings"
HEAD_PLACES = {DEPOSIT: ("head_deployed", "not deployed while depositing"), MILL: ("head_parked", "not parked while milling")}
HEAD_KEPT = frozenset({State.HOLDING, State.HELD, State.RESUMING})  # before and behind them `_positions` looks at it
WIRES = ("cnc_lost", "cnc_silent", "laser_silent", "feeder_silent", "io_silent")
TOGETHER_S = 2.0  # the slowest signal has gone stale by then, whichever was seen first
ALL_SILENT = "CNC, laser, powder feeder and I/O coupler answer no more"
CNC_DOOR_OPEN = (1, 2)  # substates of Door: stopped and still ajar, opened and braking; 0 is closed again, 3 going on


@dataclass(frozen=True)
class Situation:
    """What the controller knows at this tick that the wires do not tell."""

    state: State
    is_faulted: bool
    is_depositing: bool
    is_moving: bool
    why_not_moving: str
    is_run_expected: bool
    mode: int
    tool: int | None
    powder_g_min: float
    is_retracting: bool = False
    powder_before_g_min: float = 0.0  # what may still come out of the nozzle behind a change of the rate


@dataclass(frozen=True)
class Told:
    """What was said of a fault that is latched. at : wire time (s)"""

    detail: str
    at: float


def _signal(client: DeviceClient, name: str) -> Signal:
    return Signal(client.value(name), client.age(name), client.device.registers[name].stale_s)


def _word(client: DeviceClient, name: str) -> Signal:
    """A word of flags with the meaning of the bits that are set."""
    signal = _signal(client, name)
    return replace(signal, meaning="; ".join(client.flags(name))) if signal.is_fresh and signal.value else signal


class Senses:
    """Reads every level that emission depends on, and sees faults in them."""

    def __init__(self, cell: Cell, drivers: CellDrivers, clock: Clock) -> None:
        self._cell = cell
        self._d = drivers
        self._clock = clock
        self._flow_wrong_since: float | None = None
        self._tool_wrong_since: float | None = None
        self._clients = {"laser": drivers.laser.client, "feeder": drivers.feeder.client, "io": drivers.io.client}
        self._lost = {role: client.restarts.count for role, client in self._clients.items()}
        self._late: dict[str, str] = {}  # the same, seen behind a fault
        self._has_head_stood = False  # in the place that the mode needs, since the slide was last told where to go
        self.news: list[str] = []  # devices that lost what they were told while nothing hung on them, in words
        self._openings: dict[str, float] = {}  # cause -> count of openings that was last read

    @property
    def cnc_age_s(self) -> float:
        """Age of the last status report (s)."""
        status = self._d.cnc.status
        return self._clock.now() - status.at if status is not None else float("inf")

    def permissives(self, now: Situation) -> list[Permissive]:
        """Each condition of emission at this tick."""
        laser, feeder, io = self._d.laser.client, self._d.feeder.client, self._d.io.client
        status = self._d.cnc.status
        state = status.state if status else ""
        return permissives(
            Levels(
                is_running=now.state is State.RUNNING,
                is_faulted=now.is_faulted,
                is_depositing=now.is_depositing,
                is_moving=now.is_moving,
                why_not_moving=now.why_not_moving,
                state=now.state.value,
                cnc_state="Run" if now.is_run_expected and state == "Idle" else state,
                cnc_age_s=self.cnc_age_s,
                cnc_stale_s=self._cell.limits.status_stale_s,
                interlocks={name: _signal(io, name) for name in INTERLOCK_CAUSE},
                laser_words={name: _word(laser, name) for name in ("interlock_word", "fault_word")},
                laser_enabled=self._d.laser.is_enabled,
                feeder_words={"fault_word": _word(feeder, "fault_word")},
                head=_signal(io, "head_deployed"),
                heartbeats={
                    name: _signal(client, "heartbeat_readback")
                    for name, client in (("laser", laser), ("feeder", feeder), ("io", io))
                },
            )
        )

    def faults(self, now: Situation) -> Iterator[tuple[str, str, str]]:
        """(code, detail, remedy) of everything that has to latch, worst first."""
        opened, lost = self._opened(), self._losses()
        self._late = lost if now.state is State.FAULT else {}
        if now.state not in ACTIVE:
            self.news += [f"{role}: {why}; it is commanded safe" for role, why in lost.items()]
        if "estop" in opened and now.state is not State.OFFLINE:
            yield "estop", BRIEFLY, ""
        yield from self._everywhere(now)
        is_by_hand = now.state in (State.JOGGING, State.HOMING) or now.is_retracting
        if now.state in IN_JOB or now.state is State.JOGGING or now.is_retracting:
            yield from self._cnc()
        if is_by_hand or (now.state is State.PURGING and not self._cell.by_hand.purge_with_door_open):
            yield from self._door()
        for code in opened:
            if now.state in ACTIVE or (is_by_hand and code == "door"):
                yield code, BRIEFLY, ""
        if now.state in ACTIVE or is_by_hand:
            yield from self._cnc_door(now)
        if now.state in ACTIVE:
            yield from self._interlocks()
            yield from self._devices(now)
            yield from self._forgotten(now, lost)
            yield from self._positions(now)
        if now.state is State.PURGING:
            yield from self._devices(now)
        if now.state in HEAD_KEPT:
            yield from self._head_kept(now)

    def _opened(self) -> list[str]:
        """Causes whose contact has opened since the count was last looked at, where the coupler counts: however short it was."""
        found = []
        client = self._d.io.client
        for cause in INTERLOCK_CAUSE.values():
            reading = client.readings.get(f"{cause}{OPENINGS}")
            if reading is None:
                continue
            before = self._openings.get(cause)
            self._openings[cause] = reading.value
            if before is not None and reading.value > before:  # fewer: the coupler was started anew
                found.append(cause)
        return found

    def _losses(self) -> dict[str, str]:
        """Role -> why, of each device that came back with nothing of what it had been told since this was last asked."""
        found = {role: client.restarts.why for role, client in self._clients.items() if client.restarts.count > self._lost[role]}
        for role in found:
            self._lost[role] = self._clients[role].restarts.count
        return found

    def _forgotten(self, now: Situation, lost: Mapping[str, str]) -> Iterator[tuple[str, str, str]]:
        """Devices that no longer hold what the job has told them: nobody else would tell them again, and the pass would go on without."""
        d = self._d
        found = dict(lost)
        if now.state is State.RUNNING and now.mode == DEPOSIT:
            if not d.laser.is_enabled:
                found.setdefault("laser", "it is no longer enabled")
            if now.powder_g_min > 0 and not d.feeder.rate_setpoint_g_min:
                found.setdefault("feeder", "its rate was taken back")
            if not d.io.is_deploying:
                found.setdefault("io", "its output for the head was taken back")
        for role, why in found.items():
            is_away = isinstance(self._clients[role].last_error, LinkError)
            yield self._silent(role) if is_away else (f"{role}_lost", why, "")

    def _everywhere(self, now: Situation) -> Iterator[tuple[str, str, str]]:
        estop = _signal(self._d.io.client, "estop_ok")
        if estop.is_fresh and not estop.value and now.state is not State.OFFLINE:
            yield "estop", "", ""

    def late_causes(self, told: Mapping[str, Told]) -> Iterator[tuple[str, str, str]]:
        """(code, detail, remedy) of each open interlock that explains what another wire has latched a moment ago.

        told : what is latched, by code. The coupler's own reading comes within its stale limit; what opens later is another matter.
        """
        if "power" not in told and is_whole(told, self._clock.now()) and self._is_all_silent():
            yield "power", ALL_SILENT, ""
        for name, code in INTERLOCK_CAUSE.items():
            signal = _signal(self._d.io.client, name)
            if not signal.is_fresh or signal.value or code in told:
                continue
            since = [each.at for known, each in told.items() if is_explained(known, each.detail, by=code)]
            if since and self._clock.now() - max(since) <= signal.stale_s:
                yield code, "", ""
        if self._d.io.faults and any(is_explained(known, each.detail, by="io_fault") for known, each in told.items()):
            yield self._device_fault("io", self._d.io.faults)
        for role, why in self._late.items():
            code = f"{role}_lost"
            if any(is_explained(known, each.detail, by=code) for known, each in told.items()):
                yield code, why, ""

    def _is_all_silent(self) -> bool:
        """Whether no device of the machine answers any more."""
        clients = (self._d.laser.client, self._d.feeder.client, self._d.io.client)
        return self.cnc_age_s > self._cell.limits.status_stale_s and not any(_signal(one, "heartbeat_readback").is_fresh for one in clients)

    def unpermitted_emission(self, hand: LaserHand) -> Iterator[tuple[str, str, str]]:
        """Emission that is read back though the permit has been off for a while."""
        laser = self._d.laser
        emission = _signal(laser.client, "emission")
        if hand.is_permitted or not emission.is_fresh or not emission.value:
            return
        if self._clock.now() - hand.dark_since - emission.age_s > DARK_GRACE_S:
            yield "laser_emitting", f"{laser.power_readback_w:.0f} W", ""

    def _cnc(self) -> Iterator[tuple[str, str, str]]:
        if self.cnc_age_s > self._cell.limits.status_stale_s:
            yield "cnc_silent", f"last status report {self.cnc_age_s:.1f} s ago", ""
        elif self._d.cnc.status is not None and self._d.cnc.status.state == "Alarm":
            number = self._d.cnc.status.substate
            yield cause_of_alarm(number), f"ALARM:{number or ''}", "remove the cause, reset and home"

    def _cnc_door(self, now: Situation) -> Iterator[tuple[str, str, str]]:
        """The CNC's own door input: open, or, where lines ran, opened since (it brakes and waits until it is let go)."""
        status = self._d.cnc.status
        if status is None or status.state != "Door":
            return
        if status.substate in CNC_DOOR_OPEN or now.state is State.RUNNING:
            yield "door", "", ""

    def _interlocks(self) -> Iterator[tuple[str, str, str]]:
        io = self._d.io
        for name, code in INTERLOCK_CAUSE.items():
            signal = _signal(io.client, name)
            if not signal.is_fresh:
                yield self._silent("io")
                return
            if not signal.value and code != "estop":
                yield code, "", ""

    def _door(self) -> Iterator[tuple[str, str, str]]:
        door = _signal(self._d.io.client, "door_closed")
        if not door.is_fresh:
            yield self._silent("io")
        elif not door.value:
            yield "door", "", ""

    def _devices(self, now: Situation) -> Iterator[tuple[str, str, str]]:
        laser, feeder = self._d.laser, self._d.feeder
        if not _signal(laser.client, "fault_word").is_fresh or not _signal(laser.client, "emission").is_fresh:
            yield self._silent("laser")
        elif laser.faults:
            yield self._device_fault("laser", laser.faults)
        elif laser.is_enabled:
            for code, detail in causes_of_interlocks(laser.interlocks):
                yield code, detail, ""
        if not _signal(feeder.client, "fault_word").is_fresh or not _signal(feeder.client, "rate_readback").is_fresh:
            yield self._silent("feeder")
        elif feeder.faults:
            yield self._device_fault("feeder", feeder.faults)
        elif now.state is State.RUNNING and now.mode == DEPOSIT:
            yield from self._flow(now.powder_g_min, now.powder_before_g_min or now.powder_g_min)
        if self._d.io.faults:
            yield self._device_fault("io", self._d.io.faults)

    def _silent(self, role: str) -> tuple[str, str, str]:
        """A device whose readings are stale: the one that is at fault for it, and why."""
        at_fault, why = why_late(role, self._clients)
        return f"{at_fault}_silent", why or "its readings are stale", ""

    def _device_fault(self, role: str, faults: Sequence[str]) -> tuple[str, str, str]:
        """What a device reports of itself; a dead-man that tripped because of the wire is told as what kept the heartbeat away."""
        text = SEPARATOR.join(faults)
        if tells_of_heartbeat(text):
            at_fault, why = why_late(role, self._clients)
            if why:
                return f"{at_fault}_silent", f"{why}; {role}: {text}", ""
        return f"{role}_fault", text, ""

    def _flow(self, wanted: float, before: float) -> Iterator[tuple[str, str, str]]:
        read = self._d.feeder.rate_readback_g_min
        band = max(FLOW_BAND * self._cell.limits.powder_settle_tolerance * wanted, 0.5)
        if wanted <= 0 or min(wanted, before) - band <= read <= max(wanted, before) + band:
            self._flow_wrong_since = None
            return
        since = self._flow_wrong_since = (
            self._flow_wrong_since if self._flow_wrong_since is not None else self._clock.now()
        )
        if self._clock.now() - since > FLOW_GRACE_S:
            yield "powder_flow", f"{read:.1f} of {wanted:.1f} g/min", ""

    def _positions(self, now: Situation) -> Iterator[tuple[str, str, str]]:
        wanted = HEAD_PLACES.get(now.mode)
        if now.state is State.RUNNING and wanted is not None:
            place = _signal(self._d.io.client, wanted[0])
            if not place.is_fresh:
                yield self._silent("io")
            elif not place.value:
                yield self._head_left(wanted[1])
        status = self._d.cnc.status
        if (
            now.state is not State.RUNNING
            or now.tool is None
            or status is None
            or status.is_idle
            or not status.tool
            or status.tool == now.tool
        ):
            self._tool_wrong_since = None
            return
        since = self._tool_wrong_since = (
            self._tool_wrong_since if self._tool_wrong_since is not None else self._clock.now()
        )
        if self._clock.now() - since > TOOL_GRACE_S:
            yield "tool", f"T{status.tool} is mounted, the program needs T{now.tool}", ""

    def _head_kept(self, now: Situation) -> Iterator[tuple[str, str, str]]:
        """A head that stood in its place and leaves it while the job is held, or before it moves again; told once: what resumes verifies it."""
        wanted = HEAD_PLACES.get(now.mode)
        if wanted is None or self._d.io.is_deploying is not (now.mode == DEPOSIT):
            self._has_head_stood = False
            return
        place = _signal(self._d.io.client, wanted[0])
        if not place.is_fresh:
            return
        if not place.value and self._has_head_stood:
            yield self._head_left(wanted[1])
        self._has_head_stood = bool(place.value)

    def _head_left(self, where: str) -> tuple[str, str, str]:
        """A head that is not where it has to be: by itself, or because its coupler has not heard the heartbeat for long."""
        unfollowed_s = self._d.io.client.unfollowed_s
        if unfollowed_s:
            return "io_fault", f"it has not followed the heartbeat for {unfollowed_s:.1f} s, and its outputs fell back", ""
        return "head_position", where, ""


def is_whole(told: Mapping[str, Told], now: float) -> bool:
    """Whether a wire that fell silent was told so lately that the others, silent too, have the same cause."""
    return any(code in told and now - told[code].at <= TOGETHER_S for code in WIRES)
