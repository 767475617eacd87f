"""The cell in MTConnect's words: one table of data items, and what each is for a snapshot. Source: MTConnect Part 2 and 3, version 2.0."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cellctl.domain.snapshot import Snapshot
from cellctl.domain.states import EXECUTION, State
from cellctl.shop.freshness import is_read
from config.cell import Cell

S = State


@dataclass(frozen=True)
class Active:
    """One active condition. level : FAULT or WARNING"""

    level: str
    code: str
    text: str


Value = str | tuple[Active, ...] | None
"""What a data item is: its text, for a condition what is active (nothing: NORMAL), None: UNAVAILABLE."""

MODE: dict[State, str | None] = {
    S.OFFLINE: None,
    S.UNHOMED: "MANUAL",
    S.IDLE: "AUTOMATIC",
    S.HOMING: "MANUAL",
    S.JOGGING: "MANUAL",
    S.PURGING: "MANUAL",
    S.PREPARING: "AUTOMATIC",
    S.RUNNING: "AUTOMATIC",
    S.HOLDING: "AUTOMATIC",
    S.HELD: "AUTOMATIC",
    S.RESUMING: "AUTOMATIC",
    S.ABORTING: "AUTOMATIC",
    S.FAULT: "AUTOMATIC",
    S.STOPPED: "AUTOMATIC",
    S.RESETTING: "MANUAL",
}
"""ControllerMode of each state; Execution's table is domain.states.EXECUTION."""

LINKS = ("laser", "feeder", "io", "cnc")
COMMUNICATION = ("offline", "_silent", "_lost", "answer_overdue", "cnc_reset")
PROGRAM = ("cnc_error", "cnc_alarm", "dark_pass", "laser_standing", "off_path", "program")


@dataclass(frozen=True)
class Item:
    """One data item. component : id of what it belongs to; read : its value for a fresh snapshot"""

    id: str
    component: str
    category: str
    type: str
    read: Callable[[Snapshot], Value]
    sub_type: str = ""
    units: str = ""
    attributes: tuple[tuple[str, str], ...] = ()

    @property
    def element(self) -> str:
        """Name of its element in streams: PATH_FEEDRATE is PathFeedrate, x:MASS_FLOW is x:MassFlow."""
        prefix, colon, words = self.type.rpartition(":")
        return prefix + colon + "".join(word.capitalize() for word in words.split("_"))


@dataclass(frozen=True)
class Component:
    """One component of the device. element : its type in MTConnect; inside : id of the one that holds it, "" for the device"""

    id: str
    element: str
    name: str
    inside: str = ""


def execution(snapshot: Snapshot) -> str:
    """Execution; an idle cell whose job was completed says so."""
    state = State(snapshot.state)
    if state is S.IDLE and snapshot.job is not None and snapshot.job.outcome == "completed":
        return "PROGRAM_COMPLETED"
    return EXECUTION[state]


def condition_of(code: str) -> str:
    """Which condition an alarm belongs to."""
    if any(part in code for part in COMMUNICATION):
        return "COMMUNICATIONS"
    return "LOGIC_PROGRAM" if code.startswith(PROGRAM) else "SYSTEM"


def conditions(snapshot: Snapshot, kind: str) -> tuple[Active, ...]:
    """What is active of a condition: latched alarms as faults, silent links and an untrusted position as warnings."""
    found = [Active("FAULT", one.code, one.cause) for one in snapshot.alarms if condition_of(one.code) == kind]
    if kind == "COMMUNICATIONS":
        told = {one.code.split("_")[0] for one in found}
        views = ((name, getattr(snapshot, name)) for name in LINKS)
        found += [
            Active("WARNING", f"{name}_silent", f"no fresh reading of {name}")
            for name, view in views
            if not is_read(view.connected, view.age_s) and name not in told
        ]
    if kind == "SYSTEM" and snapshot.position:
        found.append(Active("WARNING", "position", snapshot.position))
    return tuple({one.code: one for one in reversed(found)}.values())[::-1]


def number(value: float) -> str:
    """A number as MTConnect writes it."""
    return f"{value:.6g}" if abs(value) < 1e6 else repr(float(value))


def _of(view: str, read: Callable[[Snapshot], Value]) -> Callable[[Snapshot], Value]:
    """What a device says, only while it is heard."""

    def value(snapshot: Snapshot) -> Value:
        device = getattr(snapshot, view)
        return read(snapshot) if is_read(device.connected, device.age_s) else None

    return value


def _axis(letter: str) -> Callable[[Snapshot], Value]:
    def position(snapshot: Snapshot) -> Value:
        value = snapshot.cnc.machine.get(letter)
        return None if value is None else number(value)

    return _of("cnc", position)


def _conditions(kind: str) -> Callable[[Snapshot], Value]:
    return lambda snapshot: conditions(snapshot, kind)


def components_of(cell: Cell) -> list[Component]:
    """The device's components, each after the one that holds it."""
    axes = [
        Component(axis.letter.lower(), "Linear" if axis.kind == "linear" else "Rotary", axis.letter, "axes") for axis in cell.axes
    ]
    return [
        Component("axes", "Axes", "axes"),
        *axes,
        Component("spindle", "Rotary", "S", "axes"),
        Component("controller", "Controller", "controller"),
        Component("path", "Path", "path", "controller"),
        Component("door", "Door", "door"),
        Component("systems", "Systems", "systems"),
        Component("laser", "ProcessPower", "laser", "systems"),
        Component("feeder", "Feeder", "powder", "systems"),
    ]


def items_of(cell: Cell) -> list[Item]:
    """All data items but those that the agent itself tells, in the order of their components."""
    axes = [
        Item(f"{axis.letter.lower()}_position", axis.letter.lower(), "SAMPLE", "POSITION", _axis(axis.letter), "ACTUAL", "MILLIMETER")
        if axis.kind == "linear"
        else Item(f"{axis.letter.lower()}_angle", axis.letter.lower(), "SAMPLE", "ANGLE", _axis(axis.letter), "ACTUAL", "DEGREE")
        for axis in cell.axes
    ]
    machine = (("coordinateSystem", "MACHINE"),)
    return [
        Item("avail", "", "EVENT", "AVAILABILITY", lambda s: "AVAILABLE"),
        Item("system", "", "CONDITION", "SYSTEM", _conditions("SYSTEM")),
        *(Item(one.id, one.component, one.category, one.type, one.read, one.sub_type, one.units, machine) for one in axes),
        *_controller_items(),
        Item("door_state", "door", "EVENT", "DOOR_STATE", _of("io", lambda s: "CLOSED" if s.io.door_closed else "OPEN")),
        *_process_items(),
    ]


def _controller_items() -> list[Item]:
    """Spindle, controller and path."""
    job = "job"

    def of_job(read: Callable[[Snapshot], Value]) -> Callable[[Snapshot], Value]:
        return lambda snapshot: read(snapshot) if getattr(snapshot, job) is not None else None

    return [
        Item("spindle_speed", "spindle", "SAMPLE", "ROTARY_VELOCITY", _of("cnc", lambda s: number(s.cnc.spindle_rpm)), "ACTUAL", "REVOLUTION/MINUTE"),
        Item("communications", "controller", "CONDITION", "COMMUNICATIONS", _conditions("COMMUNICATIONS")),
        Item("logic", "controller", "CONDITION", "LOGIC_PROGRAM", _conditions("LOGIC_PROGRAM")),
        Item("estop", "controller", "EVENT", "EMERGENCY_STOP", _of("io", lambda s: "ARMED" if s.io.estop_ok else "TRIGGERED")),
        Item("message", "controller", "EVENT", "MESSAGE", lambda s: s.waiting or s.because),
        Item("execution", "path", "EVENT", "EXECUTION", execution),
        Item("mode", "path", "EVENT", "CONTROLLER_MODE", lambda s: MODE[State(s.state)]),
        Item("program", "path", "EVENT", "PROGRAM", of_job(lambda s: s.job.name if s.job else None)),
        Item("line", "path", "EVENT", "LINE_NUMBER", of_job(lambda s: str(s.lines.executing)), "ABSOLUTE"),
        Item("tool", "path", "EVENT", "TOOL_NUMBER", _of("cnc", lambda s: str(s.cnc.tool))),
        Item(
            "feed_override", "path", "EVENT", "PATH_FEEDRATE_OVERRIDE", _of("cnc", lambda s: str(s.overrides.feed_percent)), "PROGRAMMED"
        ),
        Item("feed", "path", "SAMPLE", "PATH_FEEDRATE", _of("cnc", lambda s: number(s.tip_speed_mm_s)), "ACTUAL", "MILLIMETER/SECOND"),
    ]  # fmt: skip


def _process_items() -> list[Item]:
    """Laser, powder and gas. MTConnect 2.0 has no word for a mass per time: x:MASS_FLOW, in g/min."""

    def gas(name: str) -> Callable[[Snapshot], Value]:
        return _of("feeder", lambda s: number(getattr(s.feeder, name) / 60.0))

    grams = "x:GRAM_PER_MINUTE"
    return [
        Item("laser_power", "laser", "SAMPLE", "WATTAGE", _of("laser", lambda s: number(s.laser.power_readback_w)), "ACTUAL", "WATT"),
        Item("laser_target", "laser", "SAMPLE", "WATTAGE", _of("laser", lambda s: number(s.laser.power_setpoint_w)), "TARGET", "WATT"),
        Item("powder", "feeder", "SAMPLE", "x:MASS_FLOW", _of("feeder", lambda s: number(s.feeder.rate_readback_g_min)), "ACTUAL", grams),
        Item("powder_target", "feeder", "SAMPLE", "x:MASS_FLOW", _of("feeder", lambda s: number(s.feeder.rate_setpoint_g_min)), "TARGET", grams),
        Item("hopper", "feeder", "SAMPLE", "FILL_LEVEL", _of("feeder", lambda s: number(100.0 * s.feeder.hopper_fraction)), "", "PERCENT"),
        Item("carrier_gas", "feeder", "SAMPLE", "FLOW", gas("carrier_gas_readback_l_min"), "ACTUAL", "LITER/SECOND"),
        Item("shield_gas", "feeder", "SAMPLE", "FLOW", gas("shield_gas_readback_l_min"), "ACTUAL", "LITER/SECOND"),
    ]


PART_COUNT = Item("parts", "path", "EVENT", "PART_COUNT", lambda _snapshot: None, "ALL")
"""Jobs completed on this cell; the snapshot does not tell it."""


def observe(items: list[Item], snapshot: Snapshot | None, completed: int | None) -> dict[str, Value]:
    """Every data item's value by id; all are unavailable without a snapshot."""
    if snapshot is None:
        return {**{item.id: None for item in items}, PART_COUNT.id: None}
    values = {item.id: item.read(snapshot) for item in items}
    return {**values, PART_COUNT.id: None if completed is None else str(completed)}
