"""The cell in the words of OPC UA for Machine Tools (OPC 40501-1): one table of variables, and what each is for a snapshot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cellctl.domain.snapshot import Snapshot
from cellctl.domain.states import State
from cellctl.shop.freshness import is_read

S = State
MANUAL, AUTOMATIC = 0, 1  # MachineOperationMode
ACTIVE, INTERRUPTED, RESET = 0, 1, 2  # ChannelState
CHANNEL_AUTOMATIC, JOG_MANUAL, REFERENCE, OTHER = 0, 2, 6, 7  # ChannelMode
READY, EMITTING, ERROR = 1, 2, 3  # LaserState

STATES: dict[State, tuple[int | None, int, int, str]] = {
    S.OFFLINE: (None, OTHER, RESET, "Interrupted"),
    S.UNHOMED: (MANUAL, OTHER, RESET, "Interrupted"),
    S.IDLE: (AUTOMATIC, CHANNEL_AUTOMATIC, RESET, "Interrupted"),
    S.HOMING: (MANUAL, REFERENCE, ACTIVE, "Interrupted"),
    S.JOGGING: (MANUAL, JOG_MANUAL, ACTIVE, "Interrupted"),
    S.PURGING: (MANUAL, OTHER, ACTIVE, "Interrupted"),
    S.PREPARING: (AUTOMATIC, CHANNEL_AUTOMATIC, ACTIVE, "Running"),
    S.RUNNING: (AUTOMATIC, CHANNEL_AUTOMATIC, ACTIVE, "Running"),
    S.HOLDING: (AUTOMATIC, CHANNEL_AUTOMATIC, INTERRUPTED, "Interrupted"),
    S.HELD: (AUTOMATIC, CHANNEL_AUTOMATIC, INTERRUPTED, "Interrupted"),
    S.RESUMING: (AUTOMATIC, CHANNEL_AUTOMATIC, ACTIVE, "Running"),
    S.ABORTING: (AUTOMATIC, CHANNEL_AUTOMATIC, INTERRUPTED, "Aborted"),
    S.FAULT: (AUTOMATIC, CHANNEL_AUTOMATIC, INTERRUPTED, "Interrupted"),
    S.STOPPED: (AUTOMATIC, CHANNEL_AUTOMATIC, INTERRUPTED, "Interrupted"),
    S.RESETTING: (MANUAL, OTHER, RESET, "Interrupted"),
}
"""OperationMode, ChannelMode, ChannelState, and State of an active program that has not ended."""

OUTCOMES = {"completed": "Ended", "aborted": "Aborted", "failed": "Aborted", "interrupted": "Interrupted"}

Plain = bool | int | float | str | list[str] | None


@dataclass(frozen=True)
class Variable:
    """A variable. path : browse names below the machine; kind : its type in OPC UA; read : its value, None: nothing is known"""

    path: str
    kind: str
    read: Callable[[Snapshot], Plain]


def _of(view: str, read: Callable[[Snapshot], Plain]) -> Callable[[Snapshot], Plain]:
    """What a device says, only while it is heard."""

    def value(snapshot: Snapshot) -> Plain:
        device = getattr(snapshot, view)
        return read(snapshot) if is_read(device.connected, device.age_s) else None

    return value


def program_state(snapshot: Snapshot) -> str | None:
    """State of the active program; None without one."""
    job = snapshot.job
    return None if job is None else OUTCOMES.get(job.outcome) or STATES[State(snapshot.state)][3]


def _laser_state(snapshot: Snapshot) -> int:
    if snapshot.laser.faults:
        return ERROR
    return EMITTING if snapshot.laser.emitting else READY


def _axis(letter: str) -> Callable[[Snapshot], Plain]:
    return _of("cnc", lambda s: s.cnc.machine.get(letter))


STANDARD = (
    Variable("Monitoring/MachineTool/OperationMode", "Int32", lambda s: STATES[State(s.state)][0]),
    Variable("Monitoring/Channel/ChannelMode", "Int32", lambda s: STATES[State(s.state)][1]),
    Variable("Monitoring/Channel/ChannelState", "Int32", lambda s: STATES[State(s.state)][2]),
    Variable("Monitoring/Channel/FeedOverride", "Double", _of("cnc", lambda s: float(s.overrides.feed_percent))),
    Variable("Monitoring/Spindle/IsRotating", "Boolean", _of("cnc", lambda s: s.cnc.spindle_rpm != 0.0)),
    Variable("Monitoring/Laser/ControllerIsOn", "Boolean", _of("laser", lambda s: s.laser.enabled)),
    Variable("Monitoring/Laser/LaserState", "Int32", _of("laser", _laser_state)),
    Variable("Production/ActiveProgram/Name", "String", lambda s: s.job.name if s.job else None),
    Variable("Production/ActiveProgram/NumberInList", "UInt16", lambda s: 0 if s.job else None),
    Variable("Production/ActiveProgram/JobIdentifier", "String", lambda s: s.job.id if s.job else None),
)
"""Variables of the standard; State of ActiveProgram is a state machine and stands beside them."""

OWN = (
    Variable("Process/State", "String", lambda s: s.state),
    Variable("Process/Because", "String", lambda s: s.waiting or s.because),
    Variable("Process/Alarms", "String[]", lambda s: [f"{one.code}: {one.cause}" for one in s.alarms]),
    Variable("Process/EmergencyStopOk", "Boolean", _of("io", lambda s: s.io.estop_ok)),
    Variable("Process/DoorClosed", "Boolean", _of("io", lambda s: s.io.door_closed)),
    Variable("Process/TipSpeed_mm_s", "Double", _of("cnc", lambda s: s.tip_speed_mm_s)),
    Variable("Process/SpindleSpeed_rpm", "Double", _of("cnc", lambda s: s.cnc.spindle_rpm)),
    Variable("Process/LaserPowerSetpoint_W", "Double", _of("laser", lambda s: s.laser.power_setpoint_w)),
    Variable("Process/LaserPowerReadback_W", "Double", _of("laser", lambda s: s.laser.power_readback_w)),
    Variable("Process/PowderSetpoint_g_min", "Double", _of("feeder", lambda s: s.feeder.rate_setpoint_g_min)),
    Variable("Process/PowderReadback_g_min", "Double", _of("feeder", lambda s: s.feeder.rate_readback_g_min)),
    Variable("Process/LineExecuting", "UInt32", lambda s: s.lines.executing if s.job else None),
    Variable("Process/LinesTotal", "UInt32", lambda s: s.lines.total if s.job else None),
)
"""What the standard has no word for, in a namespace of its own."""


def axes(letters: tuple[str, ...]) -> tuple[Variable, ...]:
    """Positions of the axes, mm or degrees, machine coordinates."""
    return tuple(Variable(f"Process/Axis{letter}", "Double", _axis(letter)) for letter in letters)
