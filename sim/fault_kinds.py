"""What can go wrong in the simulated cell: one table from a fault's name to what it does and the arguments that it takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim.world import World

DEVICES = ("laser", "feeder", "io")
INTERLOCKS = ("door", "estop", "chiller", "gas", "fume")
UNSUPPORTED = 20.0  # grbl's error for a word that it does not know
HARD_LIMIT = 1
BLINK_S = 0.005  # half a tick of the cell


@dataclass(frozen=True)
class Kind:
    """What a fault does; `parameters` name its arguments (the words of WORDS, or a number's name); `defaults` fill the last ones."""

    act: Callable[..., None]
    parameters: tuple[str, ...] = ()
    defaults: tuple[str | float, ...] = ()


WORDS = ("device", "interlock", "register", "port")
"""Parameters that are words, not numbers."""


# -- contacts ----------------------------------------------------------------------------------------------------------


def _set_level(name: str, level: bool) -> Callable[[World], None]:
    def act(world: World) -> None:
        setattr(world.io, name, level)
        world.wire_interlocks()

    return act


OPENS: dict[str, tuple[str, str]] = {
    "door": ("door_open", "door_close"),
    "estop": ("estop_press", "estop_release"),
    "chiller": ("chiller_fail", "chiller_ok"),
    "gas": ("gas_low", "gas_ok"),
    "fume": ("fume_fail", "fume_ok"),
}
"""Interlock -> kinds that open and close it."""


def _blink(world: World, interlock: str, seconds: float) -> None:
    """Open now, closed again after so many seconds of the wires' time."""
    opens, closes = OPENS[interlock]
    KINDS[opens].act(world)
    world.faults.add(f"at={world.time_s + seconds * world.time_scale:.9f}s {closes}")


# -- devices -----------------------------------------------------------------------------------------------------------


def _silence_laser(world: World) -> None:
    world.wires["laser"].is_silent = True
    world.laser.cut()


def _open_fibre(world: World, is_open: bool = True) -> None:
    world.laser.fibre_is_open = is_open
    world.wire_interlocks()


def _fail_feeder(world: World, bits: float) -> None:
    world.feeder.faults |= int(bits)


def _set_clog(world: World, is_clogged: bool) -> None:
    world.feeder.is_clogged = is_clogged


def _set_hopper(world: World, fraction: float) -> None:
    world.feeder.hopper_g = world.feeder.capacity_g * min(max(fraction, 0.0), 1.0)


def _delay_powder(world: World, seconds: float) -> None:
    """The hose takes so much longer than the cell file says."""
    world.feeder.transport_s = world.cell.simulation.powder_transport_s + seconds


def _device_off(world: World, device: str) -> None:
    world.wires[device].is_silent = True
    world.plants[device].restart()
    world.wire_interlocks()


def _restart(world: World, device: str) -> None:
    """Power-up values, and every connection is dropped; an RTU line has none."""
    world.plants[device].restart()
    if any(role == device and link.transport == "tcp" for role, link in world.cell.links.items()):
        world.wires[device].breaks += 1
    world.wire_interlocks()


def _device_on(world: World, device: str) -> None:
    world.wires[device].is_silent = False
    _restart(world, device)


def _power(world: World, is_on: bool) -> None:
    for device in DEVICES:
        (_device_on if is_on else _device_off)(world, device)
    if is_on:
        world.cnc.power_on()
    else:
        world.cnc.power_off()


# -- wires -------------------------------------------------------------------------------------------------------------


def _set_wire(name: str) -> Callable[[World, str, float], None]:
    def act(world: World, device: str, value: float) -> None:
        wire = world.wires[device]
        setattr(wire, name, type(getattr(wire, name))(value))

    return act


def _gone(world: World, device: str, on: float) -> None:
    """Nothing listens; on an RTU line the port is away, for all that hangs on it."""
    port: dict[str, str] = {role: link.serial_port for role, link in world.cell.links.items() if link.transport == "rtu"}
    for role in [each for each in port if device in port and port[each] == port[device]] or [device]:
        world.wires[role].is_gone = bool(on)
        world.wires[role].breaks += 1


def _be_late(world: World, device: str, seconds: float, answers: float) -> None:
    wire = world.wires[device]
    wire.late_answers, wire.late_s = int(answers), seconds


def _show(world: World, device: str, register: str, value: float) -> None:
    world.banks[device].shown[register] = value


def _mend(world: World, device: str) -> None:
    if world.wires[device].is_gone:
        _gone(world, device, 0.0)
    world.wires[device].mend()
    world.banks[device].mend()


def _cut_serial(world: World, is_cut: bool, is_deaf: bool = False) -> None:
    world.cnc.is_cut_off, world.cnc.is_deaf = is_cut, is_deaf
    world.cnc.transmitter.is_silent = False


def _mute(world: World) -> None:
    world.cnc.transmitter.is_silent = True


def _add_to(part: str, name: str) -> Callable[[World, float], None]:
    def act(world: World, count: float) -> None:
        target = getattr(world.cnc, part)
        setattr(target, name, getattr(target, name) + int(count))

    return act


def _refuse(world: World, code: float, line: float) -> None:
    world.cnc.refusals[int(line)] = int(code)


KINDS: dict[str, Kind] = {
    # contacts
    "door_open": Kind(lambda world: world.open_door()),
    "door_close": Kind(lambda world: world.close_door()),
    "estop": Kind(lambda world: world.press_estop()),
    "estop_press": Kind(lambda world: world.press_estop()),
    "estop_release": Kind(lambda world: world.release_estop()),
    "gas_low": Kind(_set_level("gas_pressure_ok", False)),
    "gas_ok": Kind(_set_level("gas_pressure_ok", True)),
    "chiller_fail": Kind(_set_level("chiller_ok", False)),
    "chiller_ok": Kind(_set_level("chiller_ok", True)),
    "fume_fail": Kind(_set_level("fume_extraction_ok", False)),
    "fume_ok": Kind(_set_level("fume_extraction_ok", True)),
    "blink": Kind(_blink, ("interlock", "seconds"), (BLINK_S,)),
    # devices
    "laser_fault": Kind(lambda world, bits: world.laser.fail(int(bits)), ("bits",), (8.0,)),
    "laser_dead": Kind(_silence_laser),
    "fibre_open": Kind(_open_fibre),
    "fibre_close": Kind(lambda world: _open_fibre(world, False)),
    "feeder_fault": Kind(_fail_feeder, ("bits",), (8.0,)),
    "feeder_clog": Kind(lambda world: _set_clog(world, True)),
    "feeder_clear": Kind(lambda world: _set_clog(world, False)),
    "hopper_empty": Kind(lambda world: _set_hopper(world, 0.0)),
    "hopper_fill": Kind(_set_hopper, ("fraction",), (1.0,)),
    "powder_late": Kind(_delay_powder, ("seconds",)),
    "device_off": Kind(_device_off, ("device",)),
    "device_on": Kind(_device_on, ("device",)),
    "power_off": Kind(lambda world: _power(world, False)),
    "power_on": Kind(lambda world: _power(world, True)),
    # Modbus
    "modbus_silent": Kind(_set_wire("is_silent"), ("device", "on"), (1.0,)),
    "modbus_gone": Kind(_gone, ("device", "on"), (1.0,)),
    "modbus_exception": Kind(_set_wire("exception"), ("device", "code"), (4.0,)),
    "modbus_slow": Kind(_set_wire("delay_s"), ("device", "seconds"), (0.3,)),
    "modbus_stale": Kind(_be_late, ("device", "seconds", "answers"), (0.15, 1.0)),
    "modbus_wrong_count": Kind(_set_wire("extra_count"), ("device", "registers"), (-1.0,)),
    "modbus_wrong_value": Kind(_show, ("device", "register", "value")),
    "modbus_stuck": Kind(lambda world, device, register: world.banks[device].stick(register), ("device", "register")),
    "modbus_restart": Kind(_restart, ("device",)),
    "modbus_ok": Kind(_mend, ("device",)),
    # serial line
    "serial_unplug": Kind(lambda world: world.plug.pull()),
    "serial_plug": Kind(lambda world, port: world.plug.put(port), ("port",), ("",)),
    "serial_silent": Kind(lambda world: _cut_serial(world, True)),
    "serial_deaf": Kind(lambda world: _cut_serial(world, False, True)),
    "serial_mute": Kind(_mute),
    "serial_ok": Kind(lambda world: _cut_serial(world, False)),
    "serial_garble": Kind(_add_to("transmitter", "answers_to_garble"), ("answers",), (1.0,)),
    "serial_garble_reports": Kind(_add_to("transmitter", "reports_to_garble"), ("reports",), (1.0,)),
    "serial_garble_lines": Kind(_add_to("noise", "lines_to_garble"), ("lines",), (1.0,)),
    "half_answer": Kind(_add_to("transmitter", "lines_to_halve"), ("lines",), (1.0,)),
    "half_line": Kind(_add_to("noise", "lines_to_halve"), ("lines",), (1.0,)),
    "lost_ok": Kind(_add_to("transmitter", "oks_to_lose"), ("answers",), (1.0,)),
    "doubled_ok": Kind(_add_to("transmitter", "oks_to_double"), ("answers",), (1.0,)),
    # CNC
    "reject_line": Kind(_refuse, ("code", "line"), (UNSUPPORTED, 0.0)),
    "firmware_reset": Kind(lambda world: world.cnc.power_cycle()),
    "cnc_off": Kind(lambda world: world.cnc.power_off()),
    "cnc_on": Kind(lambda world: world.cnc.power_on()),
    "alarm": Kind(lambda world, number: world.cnc.trip(int(number)), ("number",), (1.0,)),
    "limit_hit": Kind(lambda world: world.cnc.trip(HARD_LIMIT)),
    "feed_hold": Kind(lambda world: world.cnc.machine.hold()),
    "cycle_start": Kind(lambda world: world.cnc.machine.resume()),
}
