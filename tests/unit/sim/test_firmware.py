"""The simulated firmware over bytes in memory: what protocols and firmware sources say it answers."""

from __future__ import annotations

import re

import pytest

from config import Cell, load_cell
from sim.cnc.firmware import Firmware


def cell_with(firmware: str = "grblhal", **simulation: int) -> Cell:
    cell = load_cell("trunnion_tcp")
    return cell.model_copy(
        update={
            "cnc": cell.cnc.model_copy(update={"firmware": firmware}),
            "simulation": cell.simulation.model_copy(update=simulation),
        }
    )


def started(firmware: str = "grblhal", **simulation: int) -> Firmware:
    machine = Firmware(cell_with(firmware, **simulation))
    machine.transmit()
    return machine


def said(machine: Firmware) -> list[str]:
    return [line for line in machine.transmit().decode("ascii").split("\r\n") if line]


def ask(machine: Firmware, text: str) -> list[str]:
    machine.receive(text.encode() + b"\n")
    return said(machine)


def run(machine: Firmware, seconds: float, step: float = 0.01) -> list[str]:
    for _ in range(round(seconds / step)):
        machine.step(step)
    return said(machine)


def status(machine: Firmware) -> dict[str, str]:
    machine.receive(b"?")
    report = next(line for line in said(machine) if line.startswith("<"))
    state, *fields = report.strip("<>").split("|")
    return {"state": state, **dict(field.split(":", 1) for field in fields)}


def test_power_up_says_which_firmware_it_is() -> None:
    assert b"GrblHAL 1.1f" in Firmware(cell_with()).transmit()
    assert b"Grbl 1.1h" in Firmware(cell_with("grbl")).transmit()


def test_build_report_tells_buffers_axes_and_name() -> None:
    lines = ask(started(), "$I")
    assert "[AXS:5:XYZAC]" in lines
    assert "[FIRMWARE:grblHAL]" in lines
    assert any(re.fullmatch(rf"\[OPT:\w+,100,1024,5,{len(load_cell('trunnion_tcp').tools)}\]", line) for line in lines)
    assert lines[-1] == "ok"
    assert "[OPT:VMN,15,128]" in ask(started("grbl"), "$I")
    assert len(ask(started(), "$I+")) > len(lines)


def test_idle_status_has_one_byte_less_than_the_build_report_says() -> None:
    assert status(started())["Bf"] == "100,1023"


def test_offset_report_holds_the_work_offset_of_the_placement() -> None:
    assert "[G54:0.000,0.000,-420.000,0.000,0.000]" in ask(started(), "$#")


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ("G5.2 X1 Y1 P1", 20),
        ("G93 G1 X1", 22),
        ("G1 X1", 22),
        ("M66 P0", 20),
        ("G1 X1 X2 F100", 25),
        ("G1 Xx F100", 2),
        ("1G1", 1),
        ("G0 G1 X1 F10", 21),
        ("N10000001 G0 X1", 27),
        ("N1.5 G0 X1", 23),
        ("G4", 28),
        ("G10 L2 P9 X0", 29),
        ("G53 G2 X1 Y1 I1 F10", 30),
        ("G80 X1", 31),
        ("G2 Z-1 I1 F10", 32),
        ("G2 X1 Y1 F10", 35),
        ("G2 X50 Y0 I10 F10", 33),
        ("G2 X50 R1 F10", 34),
        ("G0 X1 I5", 36),
        ("G43.1 X5", 37),
        ("T88", 38),
        ("M62 P99", 39),
        ("G1 F-5 X1", 4),
        ("$nonsense", 3),
    ],
)
def test_refused_lines_carry_the_error_that_the_firmware_source_gives(line: str, error: int) -> None:
    assert ask(started("grbl"), line) == [f"error:{error}"]


def test_a_refused_line_changes_nothing() -> None:
    machine = started("grbl")
    before = ask(machine, "$G")
    assert ask(machine, "G91 G20 M3 S500 G1 X1 I2 F100") == ["error:36"]
    assert ask(machine, "$G") == before


def test_lines_beyond_the_limit_overflow() -> None:
    assert ask(started(), "G0 X1" + " " * 252) == ["error:11"]
    assert ask(started("grbl"), "G0 X1" + " " * 252) == ["ok"]
    assert ask(started("grbl"), "G0X1" + "0" * 76) == ["error:11"]


def test_grblhal_answers_the_same_error_until_an_empty_line() -> None:
    machine = started()
    assert ask(machine, "G5.2 X1") == ["error:20"]
    assert ask(machine, "G0 X1") == ["error:20"]
    assert ask(machine, "") == ["ok"]
    assert ask(machine, "G0 X1") == ["ok"]


def test_a_system_command_that_succeeds_ends_the_error_latch() -> None:
    machine = started()
    ask(machine, "G5.2 X1")
    assert ask(machine, "$G")[-1] == "ok"
    assert ask(machine, "G0 X1") == ["ok"]


def test_grbl_goes_on_after_an_error() -> None:
    machine = started("grbl")
    assert ask(machine, "G5.2 X1") == ["error:20"]
    assert ask(machine, "G0 X1") == ["ok"]


def test_a_system_command_refused_while_running_poisons_the_stream() -> None:
    machine = started()
    ask(machine, "G0 X100")
    machine.step(0.01)
    assert ask(machine, "$$") == ["error:8"]
    assert ask(machine, "G0 X50") == ["error:8"]


def test_carriage_returns_cost_a_second_ok_on_grbl_only() -> None:
    for firmware, answers in (("grbl", 2), ("grblhal", 1)):
        machine = started(firmware)
        machine.receive(b"G0 X1\r\n")
        assert said(machine) == ["ok"] * answers


def test_one_byte_chunks_give_the_same_answers() -> None:
    whole, bytewise = started(), started()
    text = b"G21G90\n$G\n?G0X5(note)\nG5.2X1\n\n!~"
    whole.receive(text)
    for byte in text:
        bytewise.receive(bytes([byte]))
    assert whole.transmit() == bytewise.transmit()


def test_a_flood_beyond_the_ring_loses_lines_without_an_error() -> None:
    machine = started("grbl")
    machine.receive(b"G4 P1\n")
    lines = [f"G0 X{k}".encode() + b"\n" for k in range(40)]
    machine.receive(b"".join(lines))
    answers = run(machine, 30.0)
    assert machine.rx.lost > 0
    assert answers.count("ok") < 41


def test_counted_characters_lose_nothing() -> None:
    machine = started("grbl")
    waiting = [f"G1 X{k % 5} F3000\n".encode() for k in range(300)]
    in_flight: list[int] = []
    answered = 0
    while answered < 300:
        while waiting and sum(in_flight) + len(waiting[0]) <= 127:
            in_flight.append(len(waiting[0]))
            machine.receive(waiting.pop(0))
        machine.step(0.02)
        for line in said(machine):
            assert line == "ok"
            answered += 1
            in_flight.pop(0)
    assert machine.rx.lost == 0


def test_synchronising_lines_answer_when_the_planner_has_emptied() -> None:
    machine = started()
    assert ask(machine, "G91 G1 X10 F600") == ["ok"]
    assert ask(machine, "G4 P0.01") == []
    assert run(machine, 0.95) == []
    assert run(machine, 0.1) == ["ok"]


def test_no_ok_comes_while_held() -> None:
    machine = started(planner_blocks=4)
    for _ in range(6):
        machine.receive(b"G91 G1 X10 F600\n")
    said(machine)
    machine.receive(b"!")
    assert run(machine, 5.0) == []
    machine.receive(b"~")
    assert "ok" in run(machine, 3.0)


def test_hold_goes_through_slowing_to_standing() -> None:
    machine = started()
    ask(machine, "G91 G1 X100 F12000")
    run(machine, 0.3)
    machine.receive(b"!")
    assert status(machine)["state"] == "Hold:1"
    run(machine, 0.5)
    assert status(machine)["state"] == "Hold:0"
    assert machine.machine.motion.speed == 0.0


def test_status_names_the_executing_line_and_a_later_ok_does_not_change_it() -> None:
    machine = started()
    for n in range(1, 6):
        assert ask(machine, f"N{n} G91 G1 X10 F600") == ["ok"]
    run(machine, 2.5)
    assert status(machine)["Ln"] == "3"


def test_work_offset_comes_now_and_then_and_is_machine_minus_work() -> None:
    machine = started()
    ask(machine, "G92 X5")
    reports = [status(machine) for _ in range(40)]
    shifts = [report["WCO"] for report in reports if "WCO" in report]
    assert 1 <= len(shifts) < 10
    assert shifts[-1] == "-5.000,0.000,-420.000,0.000,0.000"


def test_report_mask_chooses_the_fields() -> None:
    machine = started()
    status(machine)
    assert ask(machine, "$10=1") == ["ok"]
    assert set(status(machine)) == {"state", "MPos"}
    ask(machine, "$10=2")
    assert set(status(machine)) == {"state", "WPos", "Bf"}


def test_reset_in_motion_alarms_and_lines_in_flight_get_no_answer() -> None:
    machine = started()
    ask(machine, "G91 G1 X100 F6000")
    machine.receive(b"G4 P1\nG1 X1\n")
    run(machine, 0.2)
    machine.receive(b"\x18")
    lines = said(machine)
    assert lines[0] == "ALARM:3"
    assert any("GrblHAL" in line for line in lines)
    assert "ok" not in lines
    assert ask(machine, "G0 X0") == ["error:9"]
    assert run(machine, 3.0) == []


def test_reset_in_motion_leaves_axes_where_the_counter_does_not_say() -> None:
    machine = started()
    ask(machine, "G91 G1 X100 F12000")
    run(machine, 0.3)
    machine.receive(b"\x18")
    error = machine.machine.joints[0] - machine.machine.motion.position[0]
    assert error == pytest.approx(200.0**2 / (2 * 1500.0))
    said(machine)
    assert ask(machine, "$H") == []
    assert run(machine, 5.0) == ["ok"]
    assert machine.machine.joints[0] == machine.machine.motion.position[0] == 0.0


def test_reset_at_standstill_is_no_alarm_and_brings_defaults() -> None:
    machine = started()
    ask(machine, "G91 G20 G93 M3 S1000")
    run(machine, 1.0)
    machine.receive(b"\x18")
    assert not any("ALARM" in line for line in said(machine))
    assert status(machine)["state"] == "Idle"
    assert "G21 G90 G94" in ask(machine, "$G")[0]


def test_soft_limit_brakes_alarms_and_refuses_until_reset() -> None:
    machine = started()
    ask(machine, "G1 X10 F600")
    run(machine, 0.1)
    machine.receive(b"G0 X9999\n")
    lines = run(machine, 1.0)
    assert "ALARM:2" in lines
    assert machine.machine.motion.speed == 0.0
    assert ask(machine, "G0 X1") == ["error:9"]
    assert ask(machine, "$X")[-1].startswith("error:")
    machine.receive(b"\x18")
    said(machine)
    assert ask(machine, "$X")[-1] == "ok"
    assert ask(machine, "G0 X1") == ["ok"]


def test_tool_change_takes_seconds_then_the_status_shows_the_tool() -> None:
    machine = started()
    assert ask(machine, "M6 T2") == []
    run(machine, 1.0)
    assert status(machine)["state"] == "Tool"
    assert run(machine, 5.0) == ["ok"]
    machine.receive(b"\x87")
    assert said(machine)[0].endswith("|T:2>")


def test_pause_holds_until_resumed() -> None:
    machine = started()
    assert ask(machine, "M0") == []
    assert status(machine)["state"] == "Hold:0"
    assert run(machine, 1.0) == []
    machine.receive(b"~")
    assert said(machine) == ["ok"]


def test_door_signal_brakes_and_resumes_only_when_closed() -> None:
    machine = started()
    ask(machine, "G91 G1 X100 F6000")
    run(machine, 0.2)
    machine.machine.door(True)
    assert status(machine)["state"] == "Door:2"
    run(machine, 0.5)
    report = status(machine)
    assert report["state"] == "Door:1"
    assert report["Pn"] == "D"
    machine.receive(b"~")
    assert status(machine)["state"] == "Door:1"
    machine.machine.door(False)
    assert status(machine)["state"] == "Door:0"
    machine.receive(b"~")
    run(machine, 3.0)
    assert machine.machine.motion.position[0] == pytest.approx(100.0)


def test_estop_input_alarms_and_reset_does_not_clear_it_while_pressed() -> None:
    machine = started()
    machine.estop(True)
    assert status(machine)["state"] == "Alarm:10"
    machine.receive(b"\x18")
    said(machine)
    assert status(machine)["state"] == "Alarm:10"
    machine.estop(False)
    machine.receive(b"\x18")
    said(machine)
    assert status(machine)["state"] == "Alarm:11"
    assert ask(machine, "$X")[-1] == "ok"


def test_jog_leaves_modal_state_alone_and_is_cancelled_by_its_byte() -> None:
    machine = started()
    before = ask(machine, "$G")
    assert ask(machine, "$J=G91 G20 X2 F1000") == ["ok"]
    assert status(machine)["state"] == "Jog"
    assert ask(machine, "G0 X0") == ["error:9"]
    run(machine, 0.05)
    machine.receive(b"\x85")
    run(machine, 0.5)
    assert status(machine)["state"] == "Idle"
    assert 0.0 < machine.machine.motion.position[0] < 50.0
    assert ask(machine, "$G") == before


@pytest.mark.parametrize(("line", "error"), [("$J=X1", 22), ("$J=G91 X9999 F100", 15), ("$J=G2 X1 F100", 16), ("$J=F100", 26)])
def test_jogs_that_cannot_be_are_refused(line: str, error: int) -> None:
    assert ask(started(), line) == [f"error:{error}"]


def test_check_mode_parses_without_moving_and_is_refused_while_running() -> None:
    machine = started()
    assert ask(machine, "$C")[-1] == "ok"
    assert ask(machine, "G0 X50") == ["ok"]
    assert run(machine, 1.0) == []
    assert machine.machine.motion.position[0] == 0.0
    ask(machine, "$C")
    ask(machine, "G0 X50")
    machine.step(0.01)
    assert ask(machine, "$C") == ["error:8"]


def test_full_status_byte_is_unknown_to_grbl() -> None:
    machine = started("grbl")
    machine.receive(b"\x87")
    assert said(machine) == []


def test_auto_report_comes_by_itself() -> None:
    machine = started()
    ask(machine, "$481=100")
    reports = [line for line in run(machine, 1.0) if line.startswith("<")]
    assert 9 <= len(reports) <= 10


def test_overrides_show_in_the_status_and_have_bounds() -> None:
    machine = started()
    machine.receive(b"\x91" * 20 + b"\x97" + b"\x9b\x9d")
    reports = [status(machine) for _ in range(3)]
    assert next(report["Ov"] for report in reports if "Ov" in report) == "200,25,89"


def test_lost_doubled_and_garbled_answers_come_as_scripted() -> None:
    machine = started()
    machine.transmitter.oks_to_lose = 1
    assert ask(machine, "G90") == []
    machine.transmitter.oks_to_double = 1
    assert ask(machine, "G90") == ["ok", "ok"]
    machine.transmitter.answers_to_garble = 1
    assert ask(machine, "G90") == ["o*"]
    assert ask(machine, "G90") == ["ok"]
