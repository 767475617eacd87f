"""Every register of a map, read with its meaning: raw words, value, unit, bounds, and whether the value can be true of a cell at rest."""

from __future__ import annotations

import math
from collections.abc import Mapping

from cellctl.doctor.report import Report, Verdict
from config.cell import Cell
from config.device import Device, Register
from drivers.errors import DriverError
from drivers.interfaces import ModbusLink
from drivers.modbus.registers import decode, meanings, spans

CHECK_MAP = "compare address, type, word order and scale in the register map with the device's document"
MEANING = {
    "enable": "power stage of the laser on", "emission_permit": "emission permitted", "power_setpoint": "laser power asked for",
    "heartbeat": "written anew all the time; the dead-man watches it", "heartbeat_readback": "heartbeat as the device has it",
    "power_readback": "laser power measured", "emission": "light comes out", "interlock_word": "hard-wired interlocks that are open",
    "fault_word": "latched faults", "fault_reset": "written 1 to clear latched faults", "pilot": "aiming beam on",
    "power_setpoint_readback": "laser power asked for, as the device has it", "temperature": "temperature of the device",
    "rate_setpoint": "powder rate asked for", "carrier_gas_setpoint": "carrier gas asked for", "shield_gas_setpoint": "shield gas asked for",
    "rate_readback": "powder rate measured", "carrier_gas_readback": "carrier gas measured", "shield_gas_readback": "shield gas measured",
    "rate_setpoint_readback": "powder rate asked for, as the device has it", "hopper_level": "powder left", "diverter": "powder to the bypass",
    "estop_ok": "E-stop chain closed", "door_closed": "doors closed", "chiller_ok": "cooling water runs", "gas_pressure_ok": "gas pressure there",
    "fume_extraction_ok": "extraction runs", "head_deploy": "deposition head asked out", "head_deployed": "deposition head is out",
    "head_parked": "deposition head is in", "estop_openings": "openings of the E-stop chain since power-up",
    "door_openings": "door openings since power-up", "chiller_openings": "failures of cooling since power-up",
    "gas_pressure_openings": "failures of gas pressure since power-up", "fume_extraction_openings": "failures of extraction since power-up",
}  # fmt: skip
"""What the names of a register map mean, for a person."""

MUST_BE_CLOSED = frozenset({"estop_ok", "door_closed", "chiller_ok", "gas_pressure_ok", "fume_extraction_ok"})
MUST_BE_OFF = frozenset({"enable", "emission_permit", "power_setpoint", "emission", "rate_setpoint", "pilot"})
TEMPERATURES = (-20.0, 120.0)  # degC: colder or hotter is another quantity
PLACES = {(False, True): "in", (True, False): "out", (False, False): "between its ends", (True, True): "in and out at once"}
FLOW_SLACK = 1.1  # a flow meter's reading above its greatest set-point
MEASURED = {"power_readback": "power_setpoint", "rate_readback": "rate_setpoint"}
MEASURED |= {"carrier_gas_readback": "carrier_gas_setpoint", "shield_gas_readback": "shield_gas_setpoint"}


async def examine_registers(role: str, device: Device, device_id: int, line: ModbusLink, cell: Cell, report: Report) -> dict[str, float]:
    """Read all of a device in the fewest requests and judge each value; the values by name."""
    section, values, raw = role.capitalize(), dict[str, float](), dict[str, str]()
    for span in spans(device.registers, device.registers):
        try:
            words = await line.read(device_id, span.table, span.address, span.count)
        except DriverError as error:
            report.fault(section, f"{span.table} {span.address}..{span.address + span.count - 1} ({', '.join(span.names)})", error)
            continue
        for name in span.names:
            register = device.registers[name]
            own = words[register.address - span.address :][: register.count]
            raw[name] = " ".join(str(word) if register.type == "bit" else f"{word:04x}" for word in own)
            values[name] = decode(register, own)
    for name in values:
        register = device.registers[name]
        verdict, why = judge_register(name, device, values, cell)
        place = f"{register.table} {register.address}"
        found = f"{shown(name, register, values[name])} (raw {raw[name]}; {place}, {register.type})"
        report.add(section, f"{name}: {MEANING.get(name, 'of this map alone')}", verdict, found, bounds(register), why)
    _judge_together(section, values, device, report)
    return values


def shown(name: str, register: Register, value: float) -> str:
    """A value for a person: flags in words, a bit as yes or no, a figure with its unit."""
    if register.bits:
        return ", ".join(meanings(name, register, value)) or "nothing set"
    if register.type == "bit":
        return "yes" if value else "no"
    return f"{value:g} {register.unit}".strip()


def bounds(register: Register) -> str:
    """What may be written, and what is written on a stop; empty for what is only read."""
    if not register.writable:
        return ""
    unit = f" {register.unit}" if register.unit else ""
    span = f"{register.min:g} to {register.max:g}{unit}, " if register.min is not None and register.max is not None else ""
    return f"{span}safe {register.safe:g}{unit}"


def judge_register(name: str, device: Device, values: Mapping[str, float], cell: Cell) -> tuple[Verdict, str]:
    """Verdict and remedy of one value in a cell at rest. values : all that were read"""
    register, value = device.registers[name], values[name]
    if not math.isfinite(value):
        return "FAULT", f"no finite number: {CHECK_MAP}"
    if register.bits and (flags := meanings(name, register, value)):
        if any("not in the register map" in flag for flag in flags):
            return "FAULT", f"bits without a meaning: {CHECK_MAP}"
        return "FAULT", "clear the cause, then reset the device's faults"
    if name in MUST_BE_CLOSED and not value:
        return "FAULT", "close it or switch it on; if it is, look at the contact and its address in the map"
    if name in MUST_BE_OFF and value:
        return "FAULT", f"must be off in a cell at rest: switch it off at the device, or {CHECK_MAP}"
    return _judge_range(name, register, value, device, values, cell)


def _judge_range(
    name: str, register: Register, value: float, device: Device, values: Mapping[str, float], cell: Cell
) -> tuple[Verdict, str]:
    if register.writable and register.type != "bit":
        low, high = register.min, register.max
        if (low is not None and value < low) or (high is not None and value > high):
            return "FAULT", f"beyond its own bounds: {CHECK_MAP}"
    asked = next((other for other, each in device.registers.items() if each.readback == name), None)
    if asked is not None and asked in values and abs(values[asked] - value) > device.registers[asked].readback_tolerance:
        unit = device.registers[asked].unit
        return "FAULT", f"{asked} is {values[asked]:g} {unit}, its read-back {value:g} {unit}: {CHECK_MAP}"
    if name == "power_readback" and value > cell.limits.emission_off_w:
        return "FAULT", f"more than limits.emission_off_w = {cell.limits.emission_off_w:g} W in a cell at rest: {CHECK_MAP}"
    if name in MEASURED:
        most = device.registers[MEASURED[name]].max
        if value < 0.0 or (most is not None and value > FLOW_SLACK * most):
            return "FAULT", f"cannot be: {CHECK_MAP}"
    if register.unit == "fraction" and not 0.0 <= value <= 1.0:
        return "FAULT", f"a fraction is 0 to 1: {CHECK_MAP}"
    if register.unit == "degC" and not TEMPERATURES[0] <= value <= TEMPERATURES[1]:
        return "FAULT", f"no temperature of a device: {CHECK_MAP}"
    if name == "hopper_level" and value < cell.limits.hopper_low_fraction:
        return "warning", "fill the hopper"
    return "ok", ""


def _judge_together(section: str, values: Mapping[str, float], device: Device, report: Report) -> None:
    """What two registers say together."""
    deployed, parked = values.get("head_deployed"), values.get("head_parked")
    if deployed is not None and parked is not None:
        text = PLACES[bool(deployed), bool(parked)]
        remedy = "look at the slide's end switches and their addresses"
        report.judge(section, "place of the deposition head", bool(deployed) != bool(parked), text, "in or out", remedy)
    beat, followed = values.get("heartbeat"), values.get("heartbeat_readback")
    if beat is not None and followed is not None:
        report.judge(
            section, "heartbeat and its read-back", beat == followed, f"{beat:g} and {followed:g}", "the same", f"{device.name}: {CHECK_MAP}"
        )
