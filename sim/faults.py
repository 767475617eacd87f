"""Scripted faults: a text such as `at=12.5s door_open` or `line=120 estop`, and what it does to the simulated cell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim.world import World

DEVICES = ("laser", "feeder", "io")


class FaultScriptError(Exception):
    """A fault text that cannot be understood. `message` is one line, `hint` says how it is written."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint or "write '[at=SECONDSs|line=N] KIND [ARGUMENTS]'; kinds: " + ", ".join(sorted(KINDS))


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong: when (process time, or when a line begins to execute; neither: at once), what, and with which arguments."""

    kind: str
    arguments: tuple[str | float, ...] = ()
    at_s: float | None = None
    line: int | None = None

    def __str__(self) -> str:
        when = f"at={self.at_s:g}s " if self.at_s is not None else f"line={self.line} " if self.line is not None else ""
        return when + " ".join([self.kind, *(f"{a:g}" if isinstance(a, float) else a for a in self.arguments)])


@dataclass(frozen=True)
class Kind:
    """What a fault does; `parameters` name its arguments ("device", or a number's name); `defaults` fill the last ones."""

    act: Callable[..., None]
    parameters: tuple[str, ...] = ()
    defaults: tuple[float, ...] = ()


def _silence_laser(world: World) -> None:
    world.wires["laser"].is_silent = True
    world.laser.cut()


def _cut_serial(world: World, is_cut: bool) -> None:
    world.cnc.is_cut_off = is_cut


def _set_clog(world: World, is_clogged: bool) -> None:
    world.feeder.is_clogged = is_clogged


def _set_hopper(world: World, fraction: float) -> None:
    world.feeder.hopper_g = world.feeder.capacity_g * min(max(fraction, 0.0), 1.0)


def _set_level(name: str, level: bool) -> Callable[[World], None]:
    def act(world: World) -> None:
        setattr(world.io, name, level)
        world.wire_interlocks()

    return act


def _set_wire(name: str) -> Callable[[World, str, float], None]:
    def act(world: World, device: str, value: float) -> None:
        wire = world.wires[device]
        setattr(wire, name, type(getattr(wire, name))(value))

    return act


def _fail_feeder(world: World, bits: float) -> None:
    world.feeder.faults |= int(bits)


def _add_to_transmitter(name: str) -> Callable[[World, float], None]:
    def act(world: World, count: float) -> None:
        transmitter = world.cnc.transmitter
        setattr(transmitter, name, getattr(transmitter, name) + int(count))

    return act


def _open_fibre(world: World) -> None:
    world.laser.fibre_is_open = True
    world.wire_interlocks()


KINDS: dict[str, Kind] = {
    "door_open": Kind(lambda world: world.open_door()),
    "door_close": Kind(lambda world: world.close_door()),
    "estop": Kind(lambda world: world.press_estop()),
    "estop_press": Kind(lambda world: world.press_estop()),
    "estop_release": Kind(lambda world: world.release_estop()),
    "laser_fault": Kind(lambda world, bits: world.laser.fail(int(bits)), ("bits",), (8.0,)),
    "laser_dead": Kind(_silence_laser),
    "fibre_open": Kind(_open_fibre),
    "feeder_fault": Kind(_fail_feeder, ("bits",), (8.0,)),
    "feeder_clog": Kind(lambda world: _set_clog(world, True)),
    "feeder_clear": Kind(lambda world: _set_clog(world, False)),
    "hopper_empty": Kind(lambda world: _set_hopper(world, 0.0)),
    "hopper_fill": Kind(_set_hopper, ("fraction",), (1.0,)),
    "gas_low": Kind(_set_level("gas_pressure_ok", False)),
    "gas_ok": Kind(_set_level("gas_pressure_ok", True)),
    "chiller_fail": Kind(_set_level("chiller_ok", False)),
    "chiller_ok": Kind(_set_level("chiller_ok", True)),
    "fume_fail": Kind(_set_level("fume_extraction_ok", False)),
    "fume_ok": Kind(_set_level("fume_extraction_ok", True)),
    "modbus_silent": Kind(_set_wire("is_silent"), ("device", "on"), (1.0,)),
    "modbus_exception": Kind(_set_wire("exception"), ("device", "code"), (4.0,)),
    "modbus_slow": Kind(_set_wire("delay_s"), ("device", "seconds"), (0.3,)),
    "modbus_wrong_count": Kind(_set_wire("extra_count"), ("device", "registers"), (-1.0,)),
    "modbus_ok": Kind(lambda world, device: world.wires[device].mend(), ("device",)),
    "serial_silent": Kind(lambda world: _cut_serial(world, True)),
    "serial_ok": Kind(lambda world: _cut_serial(world, False)),
    "serial_garble": Kind(_add_to_transmitter("answers_to_garble"), ("answers",), (1.0,)),
    "lost_ok": Kind(_add_to_transmitter("oks_to_lose"), ("answers",), (1.0,)),
    "doubled_ok": Kind(_add_to_transmitter("oks_to_double"), ("answers",), (1.0,)),
    "firmware_reset": Kind(lambda world: world.cnc.power_cycle()),
    "alarm": Kind(lambda world, number: world.cnc.trip(int(number)), ("number",), (1.0,)),
    "feed_hold": Kind(lambda world: world.cnc.machine.hold()),
    "cycle_start": Kind(lambda world: world.cnc.machine.resume()),
}


def parse_fault(text: str) -> Fault:
    """Fault of one text.

    Raises FaultScriptError with one line that names the word at fault.
    """
    words = text.split()
    at_s: float | None = None
    line: int | None = None
    if words and "=" in words[0]:
        name, _, value = words.pop(0).partition("=")
        if name == "at":
            at_s = _number(text, value.removesuffix("s"), "a time in seconds")
        elif name == "line":
            line = int(_number(text, value, "a line number"))
        else:
            raise FaultScriptError(f"fault '{text}': '{name}=' is unknown, at= and line= are known")
    if not words:
        raise FaultScriptError(f"fault '{text}': says nothing that goes wrong")
    kind = KINDS.get(words[0])
    if kind is None:
        raise FaultScriptError(f"fault '{text}': '{words[0]}' is unknown")
    return Fault(words[0], _arguments(text, kind, words[1:]), at_s, line)


def _arguments(text: str, kind: Kind, words: Sequence[str]) -> tuple[str | float, ...]:
    least, most = len(kind.parameters) - len(kind.defaults), len(kind.parameters)
    if not least <= len(words) <= most:
        needs = " ".join(kind.parameters) or "no argument"
        raise FaultScriptError(f"fault '{text}': needs {needs}, has {len(words)} argument(s)")
    found: list[str | float] = []
    for name, word in zip(kind.parameters, words, strict=False):
        if name == "device":
            if word not in DEVICES:
                raise FaultScriptError(f"fault '{text}': no device '{word}'; devices: {', '.join(DEVICES)}")
            found.append(word)
        else:
            found.append(_number(text, word, name))
    return (*found, *kind.defaults[len(words) - least :])


def _number(text: str, word: str, what: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = -1.0 if what == "registers" else float("nan")
    if value != value or abs(value) == float("inf") or (value < 0.0 and what != "registers"):
        raise FaultScriptError(f"fault '{text}': '{word}' is not {what}")
    return value


class Faults:
    """Faults to come, in no particular order, and those that have been."""

    def __init__(self) -> None:
        self.pending: list[Fault] = []
        self.past: list[Fault] = []

    def add(self, fault: Fault | str) -> Fault:
        """Schedule a fault. Raises FaultScriptError."""
        parsed = parse_fault(fault) if isinstance(fault, str) else fault
        self.pending.append(parsed)
        return parsed

    @property
    def waits_for_line(self) -> bool:
        """Whether one of them hangs on a line."""
        return any(fault.line is not None for fault in self.pending)

    def until_next(self, now_s: float) -> float:
        """Seconds to the next timed one; infinite without."""
        return min(
            (max(fault.at_s - now_s, 0.0) for fault in self.pending if fault.at_s is not None), default=float("inf")
        )

    def strike(self, world: World) -> None:
        """Let everything happen that is due."""
        executing = world.cnc.machine.motion.line
        for fault in list(self.pending):
            is_due = fault.line is None if fault.at_s is None else fault.at_s <= world.time_s + 1e-9
            if fault.line is not None:
                is_due = executing >= fault.line
            if is_due:
                self.pending.remove(fault)
                self.past.append(fault)
                KINDS[fault.kind].act(world, *fault.arguments)
