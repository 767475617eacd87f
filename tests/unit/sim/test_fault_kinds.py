"""Faults of wires and devices do at the far end what they are named after, and can be mended."""

from __future__ import annotations

from typing import Any

import pytest

from config import load_cell, load_device
from sim.faults import FaultScriptError
from sim.modbus.pdu import answer
from sim.world import World

READ_INPUT, WRITE_REGISTER = 4, 6


def new_world(cell: str = "trunnion_tcp", **cnc: Any) -> World:
    facts = load_cell(cell)
    facts = facts.model_copy(update={"cnc": facts.cnc.model_copy(update=cnc)})
    return World(facts, {role: load_device(link.device) for role, link in facts.links.items()}, dead_man=False)


def strike(world: World, *faults: str) -> None:
    for fault in faults:
        world.faults.add(fault)
    world.faults.strike(world)


def said(world: World, *lines: str) -> list[str]:
    world.cnc.transmit()
    for line in lines:
        world.cnc.receive(line.encode() + b"\n")
    world.step(0.01)
    return world.cnc.transmit().decode().split("\r\n")[:-1]


def power_at_setpoint(world: World, watts: float) -> float:
    """The set-point is written, then its read-back register is read, as a master does."""
    bank, wire = world.banks["laser"], world.wires["laser"]
    answer(bytes([WRITE_REGISTER, 0, 0, *divmod(round(watts * 10), 256)]), bank, wire)
    world.step(0.001)
    reply = answer(bytes([READ_INPUT, 0, 4, 0, 1]), bank, wire)
    return int.from_bytes(reply[2:4]) / 10.0


def test_a_line_that_is_refused_latches_grblhal_and_not_grbl() -> None:
    for firmware, later in (("grblhal", "error:20"), ("grbl", "ok")):
        world = new_world(firmware=firmware)
        strike(world, "reject_line 20 3")
        assert said(world, "N2 G21", "N3 G90", "N4 G90") == ["ok", "error:20", later]


def test_the_next_line_is_refused_when_no_number_is_named() -> None:
    world = new_world(firmware="grbl")
    strike(world, "reject_line")
    assert said(world, "N7 G90", "N8 G90") == ["error:20", "ok"]


def test_half_a_line_runs_into_the_next_one_and_costs_an_answer() -> None:
    world = new_world(firmware="grbl")
    strike(world, "half_line")
    assert said(world, "N12 G90 G21", "N13 G90", "N14 G90") == ["error:25", "ok"]  # N twice in one block


def test_a_garbled_line_is_refused() -> None:
    world = new_world(firmware="grbl")
    strike(world, "serial_garble_lines")
    assert said(world, "N12 G90", "N13 G90")[0].startswith("error:")


def test_noise_hits_a_line_that_comes_byte_by_byte() -> None:
    world = new_world(firmware="grbl")
    strike(world, "serial_garble_lines 1")
    for byte in b"N12 G90\nN13 G90\n":
        world.cnc.receive(bytes([byte]))
    world.step(0.01)
    answers = world.cnc.transmit().decode().split("\r\n")
    assert [text[:5] for text in answers if text in ("ok",) or text.startswith("error")] == ["error", "ok"]


def test_half_an_answer_runs_into_the_next_one() -> None:
    world = new_world()
    strike(world, "half_answer")
    assert said(world, "N1 G90", "N2 G90") == ["ook"]


def test_a_deaf_machine_still_talks_and_a_mute_one_still_hears() -> None:
    world = new_world()
    strike(world, "serial_deaf")
    world.cnc.report()
    assert said(world, "N1 G90") == [] and world.cnc.transmit() == b""
    world.cnc.report()
    assert world.cnc.transmit().startswith(b"<Idle")
    strike(world, "serial_ok", "serial_mute")
    assert said(world, "N2 G91") == [] and world.cnc.interpreter.modal.distance == 910
    strike(world, "serial_ok")
    assert said(world, "N3 G90") == ["ok"]


def test_a_register_that_sticks_takes_no_value_and_one_that_reads_wrong_holds_the_right_one() -> None:
    world = new_world()
    assert power_at_setpoint(world, 500.0) == 500.0
    strike(world, "modbus_stuck laser power_setpoint")
    assert power_at_setpoint(world, 700.0) == 500.0 and world.laser.values["power_setpoint"] == 500.0
    strike(world, "modbus_ok laser", "modbus_wrong_value laser power_setpoint_readback 123")
    assert power_at_setpoint(world, 700.0) == 123.0 and world.laser.values["power_setpoint"] == 700.0
    strike(world, "modbus_ok laser")
    assert power_at_setpoint(world, 700.0) == 700.0


def test_a_register_that_the_device_has_not_is_refused_by_name() -> None:
    with pytest.raises(FaultScriptError, match="laser has no register 'rate_setpoint'"):
        new_world().faults.add("modbus_stuck laser rate_setpoint")


def test_a_device_that_restarts_is_at_its_power_up_values_and_drops_its_connections() -> None:
    world = new_world()
    for name in ("enable", "emission_permit"):
        world.laser.write(name, 1.0)
    power_at_setpoint(world, 900.0)
    world.laser.write("heartbeat", 7.0)
    world.cnc.receive(b"M62 P0\nN1 G1 X50 F600\n")
    world.step(0.3)
    assert world.laser.is_emitting
    breaks = world.wires["laser"].breaks
    strike(world, "modbus_restart laser")
    assert not world.laser.is_emitting and world.wires["laser"].breaks == breaks + 1
    values = world.laser.values
    assert (values["enable"], values["power_setpoint"], values["heartbeat_readback"]) == (0.0, 0.0, 0.0)


def test_interlock_blinks_within_one_tick_and_the_laser_stays_off() -> None:
    world = new_world()
    for name in ("enable", "emission_permit"):
        world.laser.write(name, 1.0)
    strike(world, "blink door")
    assert not world.io.door_closed
    world.step(0.01)
    assert world.io.door_closed and world.laser.interlocks == 0
    assert world.laser.values["enable"] == 0.0, "the chain has to be closed again by the host"
    assert world.cnc.machine.suspend.name == "DOOR"


def test_without_power_nothing_moves_or_shines_and_afterwards_nothing_is_remembered() -> None:
    world = new_world()
    world.laser.write("enable", 1.0)
    said(world, "N1 G1 X50 F600")
    world.step(0.5)
    strike(world, "power_off")
    world.step(0.1)
    assert world.cnc.machine.motion.speed == 0.0 and world.cnc.transmit() == b""
    assert all(world.wires[device].is_silent for device in ("laser", "feeder", "io"))
    strike(world, "power_on")
    world.step(0.1)
    assert b"GrblHAL" in world.cnc.transmit()
    assert world.cnc.state[0] == "Alarm" and world.laser.values["enable"] == 0.0


def test_powder_arrives_later_by_what_is_said() -> None:
    world = new_world()
    usual = world.feeder.transport_s
    strike(world, "powder_late 2.5")
    assert world.feeder.transport_s == usual + 2.5
    strike(world, "powder_late 0")
    assert world.feeder.transport_s == usual


def test_a_port_of_before_the_plug_was_pulled_is_dead_and_another_name_means_another_port() -> None:
    plug = new_world().plug
    plug.pull()
    plug.pull()
    assert plug.is_out and plug.pulls == 1
    plug.put("cnc2")
    plug.put("cnc2")
    assert not plug.is_out and plug.pulls == 1 and plug.name == "cnc2"
    plug.put("")
    assert plug.pulls == 2 and plug.name == ""


def test_devices_on_one_rtu_line_are_gone_together() -> None:
    world = new_world("trunnion_rtu")
    strike(world, "modbus_gone feeder")
    assert all(world.wires[device].is_gone for device in ("laser", "feeder", "io"))
    strike(world, "modbus_ok laser")
    assert not any(world.wires[device].is_gone for device in ("laser", "feeder", "io"))
    lone = new_world()
    strike(lone, "modbus_gone feeder")
    assert [lone.wires[device].is_gone for device in ("laser", "feeder", "io")] == [False, True, False]


def test_a_door_that_opens_ends_homing_with_its_alarm() -> None:
    world = new_world()
    said(world, "$J=G53 X-100 F10000")
    world.step(2.0)
    said(world, "$H")
    assert world.cnc.state[0] == "Home"
    world.open_door()
    world.step(0.01)
    assert "ALARM:7" in world.cnc.transmit().decode() and world.cnc.state[0] == "Alarm"
    assert world.cnc.machine.motion.speed == 0.0
