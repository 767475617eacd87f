"""The simulated plant: light, powder and contacts follow physics and wires, whatever the registers say."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from config import load_cell, load_device
from sim.fault_kinds import KINDS
from sim.faults import FaultScriptError, parse_fault
from sim.plant.feeder import Feeder
from sim.plant.laser import Laser
from sim.world import World

CELL = load_cell("trunnion_tcp")
DEVICES = {role: load_device(link.device) for role, link in CELL.links.items()}


def new_world(*faults: str, cell: str = "trunnion_tcp", dead_man: bool = False, time_scale: float = 1.0) -> World:
    chosen = load_cell(cell)
    return World(chosen, dict(DEVICES), dead_man=dead_man, faults=faults, time_scale=time_scale)


def deposit_along_x(world: World, length: int = 100) -> None:
    """Everything on, and a depositing move of 10 mm/s under way."""
    for name, value in (("power_setpoint", 1000.0), ("enable", 1.0), ("emission_permit", 1.0)):
        world.laser.write(name, value)
    for name, value in (("rate_setpoint", 6.0), ("carrier_gas_setpoint", 5.0), ("shield_gas_setpoint", 10.0)):
        world.feeder.write(name, value)
    world.cnc.receive(f"M62 P0\nN1 G1 X{length} F600\nM63 P0\nN2 G1 Y10\n".encode())
    world.step(0.5)


def test_light_comes_only_with_enable_permit_setpoint_and_gate() -> None:
    for missing in ("enable", "emission_permit", "power_setpoint"):
        world = new_world()
        deposit_along_x(world)
        assert world.laser.emission_w == pytest.approx(1000.0)
        world.laser.write(missing, 0.0)
        world.step(0.1)
        assert not world.laser.is_emitting


def test_the_gate_follows_the_motion_to_the_millimetre() -> None:
    world = new_world()
    deposit_along_x(world, 10)
    lit = 0.0
    while world.cnc.machine.motion.count:
        world.step(0.005)
        trace = world.trace
        lit += float(np.linalg.norm(trace.tip1 - trace.tip0, axis=1)[trace.emission_w > 500.0].sum())
    assert lit == pytest.approx(10.0 - 5.0, abs=0.1)
    assert not world.laser.is_emitting


def test_without_a_wired_gate_the_permit_is_the_gate() -> None:
    world = new_world(cell="trunnion_rtu")
    for name, value in (("power_setpoint", 800.0), ("enable", 1.0), ("emission_permit", 1.0)):
        world.laser.write(name, value)
    world.step(0.1)
    assert world.laser.emission_w == pytest.approx(800.0)


def test_door_opened_while_depositing_cuts_the_light_before_any_time_goes_by() -> None:
    world = new_world()
    deposit_along_x(world)
    world.open_door()
    assert world.laser.emission_w == 0.0
    world.step(1.0)
    assert world.cnc.state == ("Door", 1)
    world.close_door()
    world.step(1.0)
    assert not world.laser.is_emitting


def test_estop_cuts_light_motion_and_powder() -> None:
    world = new_world()
    deposit_along_x(world)
    world.press_estop()
    assert world.laser.emission_w == 0.0
    where = world.tip_position
    world.step(10.0)
    assert np.array_equal(world.tip_position, where)
    assert world.feeder.rate_at_nozzle_g_min == pytest.approx(0.0, abs=0.01)
    assert world.cnc.state == ("Alarm", 10)


@given(st.lists(st.tuples(st.floats(1e-4, 0.05), st.booleans()), min_size=1, max_size=20), st.floats(1e-4, 0.02))
def test_emitted_energy_equals_the_fine_sum_over_the_ramp(pieces: list[tuple[float, bool]], tau: float) -> None:
    laser = Laser(DEVICES["laser"], tau, has_gate=True)
    laser.watches_heartbeat = False
    for name, value in (("power_setpoint", 500.0), ("enable", 1.0), ("emission_permit", 1.0)):
        laser.write(name, value)
    dt = np.array([piece[0] for piece in pieces])
    gates = np.array([float(piece[1]) for piece in pieces])
    energy = float(laser.step(gates, dt, 0.0) @ dt)
    power, expected = 0.0, 0.0
    for seconds, gate in pieces:
        fine = 400
        for _ in range(fine):
            before = power
            power += (500.0 * gate - power) * (1.0 - math.exp(-seconds / fine / tau))
            expected += 0.5 * (before + power) * seconds / fine
    assert energy == pytest.approx(expected, rel=0.02, abs=0.01)


def test_latched_laser_fault_keeps_it_dark_until_reset_and_enabled_again() -> None:
    world = new_world()
    deposit_along_x(world)
    world.laser.fail(8)
    assert not world.laser.is_emitting
    for name in ("enable", "emission_permit"):
        world.laser.write(name, 1.0)
    world.step(0.05)
    assert not world.laser.is_emitting
    assert world.laser.values["fault_word"] == 8.0
    world.laser.write("fault_reset", 1.0)
    for name, value in (("power_setpoint", 1000.0), ("enable", 1.0), ("emission_permit", 1.0)):
        world.laser.write(name, value)
    world.step(0.05)
    assert world.laser.is_emitting


def test_dead_man_runs_on_wire_time() -> None:
    world = new_world(dead_man=True, time_scale=20.0)
    world.laser.write("heartbeat", 1.0)
    world.feeder.write("heartbeat", 1.0)
    laser_s, feeder_s = world.laser.device.dead_man_s, world.feeder.device.dead_man_s
    deposit_along_x(world)
    world.step(0.8 * laser_s * 20.0 - 0.5)
    assert world.laser.is_emitting
    assert world.feeder.values["rate_setpoint"] == 6.0
    world.step(0.3 * laser_s * 20.0)
    assert not world.laser.is_emitting
    assert world.laser.values["fault_word"] == 1.0
    assert world.feeder.values["rate_setpoint"] == (6.0 if 1.1 * laser_s < feeder_s else 0.0)
    world.step((feeder_s - laser_s) * 20.0)
    assert world.feeder.values["rate_setpoint"] == 0.0


def test_a_heartbeat_that_stands_still_is_none() -> None:
    world = new_world(dead_man=True)
    for k in range(30):
        world.laser.write("heartbeat", float(min(k, 5)))
        if k == 0:
            world.laser.write("enable", 1.0)
        world.step(0.05)
    assert world.laser.values["enable"] == 0.0


def test_powder_arrives_after_the_transport_delay_and_settles_exponentially() -> None:
    feeder = Feeder(DEVICES["feeder"], 2000.0, 1.2, 0.6)
    feeder.watches_heartbeat = False
    feeder.write("carrier_gas_setpoint", 6.0)
    feeder.step(np.array([2.0]), 0.0)
    feeder.write("rate_setpoint", 6.0)
    feeder.step(np.array([1.2]), 0.0)
    assert feeder.rate_at_nozzle_g_min == pytest.approx(0.0, abs=1e-9)
    feeder.step(np.full(60, 0.01), 0.0)
    assert feeder.rate_at_nozzle_g_min == pytest.approx(6.0 * (1 - math.exp(-1.0)))


@given(st.lists(st.floats(0.001, 0.7), min_size=3, max_size=40))
def test_powder_at_the_nozzle_does_not_depend_on_the_steps(steps: list[float]) -> None:
    def feeder_after(split: bool) -> tuple[float, float]:
        feeder = Feeder(DEVICES["feeder"], 2000.0, 1.2, 0.6)
        feeder.watches_heartbeat = False
        feeder.carrier_l_min = feeder.values["carrier_gas_setpoint"] = 6.0
        feeder.write("rate_setpoint", 8.0)
        if split:
            mass = sum(float(feeder.step(np.array([dt]), 0.0)[0]) * dt for dt in steps)
        else:
            mass = float(feeder.step(np.array(steps), 0.0) @ np.array(steps))
        return feeder.rate_at_nozzle_g_min, mass

    assert feeder_after(True) == pytest.approx(feeder_after(False), abs=0.01)


def test_hopper_loses_what_is_fed_and_then_runs_dry() -> None:
    feeder = Feeder(DEVICES["feeder"], 10.0, 1.0, 0.5)
    feeder.watches_heartbeat = False
    feeder.carrier_l_min = feeder.values["carrier_gas_setpoint"] = 6.0
    feeder.write("rate_setpoint", 30.0)
    feeder.step(np.full(100, 0.1), 0.0)
    assert feeder.hopper_g == pytest.approx(5.0)
    for _ in range(200):
        feeder.step(np.full(1, 0.1), 0.0)
    assert feeder.rate_at_nozzle_g_min == pytest.approx(0.0, abs=1e-3)
    assert int(feeder.values["fault_word"]) & 2


def test_without_carrier_gas_no_powder_comes() -> None:
    world = new_world()
    world.feeder.write("rate_setpoint", 6.0)
    world.step(10.0)
    assert world.feeder.rate_at_nozzle_g_min == 0.0


def test_head_slide_takes_a_second_each_way() -> None:
    world = new_world()
    world.io.write("head_deploy", 1.0)
    world.step(0.5)
    assert not world.io.is_deployed and not world.io.is_parked
    world.step(0.6)
    assert world.io.is_deployed
    world.io.write("head_deploy", 0.0)
    world.step(1.1)
    assert world.io.is_parked


def test_trace_covers_all_the_time_and_joins_up() -> None:
    world = new_world()
    deposit_along_x(world, 10)
    total, last = 0.0, world.trace.tip1[-1]
    for _ in range(40):
        world.step(0.05)
        trace = world.trace
        assert np.allclose(trace.tip0[0], last)
        assert np.allclose(trace.tip0[1:], trace.tip1[:-1])
        last = trace.tip1[-1]
        total += trace.dt.sum()
    assert total == pytest.approx(2.0)


# -- scripted faults -----------------------------------------------------------------------------------------------


def test_timed_fault_strikes_at_its_time_even_inside_a_long_step() -> None:
    world = new_world("at=12.5s door_open")
    world.step(12.4)
    assert world.io.door_closed
    world.step(5.0)
    assert not world.io.door_closed
    assert world.time_s == pytest.approx(17.4)


def test_line_fault_strikes_while_that_line_executes() -> None:
    world = new_world("line=2 estop")
    world.cnc.receive(b"N1 G1 X10 F600\nN2 G1 X20\nN3 G1 X30\n")
    world.step(30.0)
    assert 10.0 <= world.cnc.machine.motion.position[0] <= 10.2


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("at=12.5s dor_open", "dor_open"),
        ("at=soon door_open", "soon"),
        ("when=3 door_open", "when="),
        ("at=3s", "nothing"),
        ("modbus_silent", "device"),
        ("modbus_silent pump", "pump"),
        ("alarm x", "'x'"),
        ("door_open now", "argument"),
        ("line=-4 estop", "-4"),
    ],
)
def test_a_fault_that_cannot_be_understood_names_the_word(text: str, names: str) -> None:
    with pytest.raises(FaultScriptError) as caught:
        parse_fault(text)
    assert names in caught.value.message
    assert "\n" not in caught.value.message


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_fault_kind_strikes_and_reads_back_as_written(kind: str) -> None:
    words = {"device": "laser", "interlock": "door", "register": "power_readback"}
    arguments = [words.get(name, "1") for name in KINDS[kind].parameters]
    fault = parse_fault(" ".join(["at=0.01s", kind, *arguments]))
    assert parse_fault(str(fault)) == fault
    world = new_world()
    deposit_along_x(world)
    world.faults.add(fault)
    world.step(0.5)
    assert world.faults.past[0] == fault
    assert np.isfinite(world.tip_position).all()


@pytest.mark.parametrize(
    "kind", ["door_open", "estop_press", "laser_fault", "laser_dead", "fibre_open", "chiller_fail"]
)
def test_faults_in_the_laser_chain_turn_the_light_off(kind: str) -> None:
    world = new_world()
    deposit_along_x(world)
    assert world.laser.is_emitting
    world.faults.add(kind)
    world.step(0.005)
    assert not world.laser.is_emitting


@pytest.mark.parametrize("kind", ["feeder_clog", "hopper_empty", "gas_low", "feeder_fault"])
def test_faults_in_the_powder_path_starve_the_nozzle(kind: str) -> None:
    world = new_world()
    deposit_along_x(world)
    world.step(8.0)
    assert world.feeder.rate_at_nozzle_g_min == pytest.approx(6.0, rel=0.01)
    world.faults.add(kind)
    world.step(10.0)
    assert world.feeder.rate_at_nozzle_g_min < 0.05


def test_a_cut_serial_line_neither_hears_nor_speaks_but_motion_goes_on() -> None:
    world = new_world()
    deposit_along_x(world)
    world.cnc.transmit()
    world.faults.add("serial_silent")
    before = world.tip_position
    world.step(0.5)
    world.cnc.receive(b"?!")
    assert world.cnc.transmit() == b""
    assert np.linalg.norm(world.tip_position - before) == pytest.approx(5.0, abs=0.01)


def test_power_loss_of_the_firmware_forgets_the_position_and_needs_homing() -> None:
    world = new_world()
    deposit_along_x(world)
    before = world.tip_position
    world.faults.add("firmware_reset")
    world.step(0.001)
    assert np.linalg.norm(world.tip_position - before) < 0.1
    assert world.cnc.machine.motion.position[0] == 0.0
    assert world.cnc.state == ("Alarm", 11)
