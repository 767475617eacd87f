"""The CNC driver against a small firmware in memory, in simulated time."""

from __future__ import annotations

import pytest

from drivers.cnc.driver import CncDriver
from drivers.cnc.events import (
    AnswerOverdue,
    CncEvent,
    LineRejected,
    PortLost,
    ProtocolFault,
    StatusReport,
    Welcome,
)
from drivers.errors import (
    CommandRefused,
    DeviceFault,
    DeviceSilent,
    FirmwareMismatch,
    FirmwareUnknown,
    LinkLost,
    RangeError_,
)
from tests.unit.drivers.fakes import FakeCnc, ManualClock, far_end, program

KINDS = ["grblhal", "grbl"]


def run(driver: CncDriver, clock: ManualClock, seconds: float, step_s: float = 0.001) -> list[CncEvent]:
    """Pump for so long; everything that was told."""
    events: list[CncEvent] = []
    for _ in range(round(seconds / step_s)):
        events += driver.pump()
        clock.advance(step_s)
    return events


def of(events: list[CncEvent], kind: type) -> list[CncEvent]:
    return [event for event in events if isinstance(event, kind)]


@pytest.mark.parametrize("kind", KINDS)
async def test_identification_takes_the_smaller_of_stated_and_reported_buffer_less_a_margin(kind: str) -> None:
    driver, cnc, _, _ = far_end(FakeCnc(kind, rx=128, planner=15))
    identity = await driver.identify()
    assert (identity.firmware, identity.rx_bytes, identity.planner_blocks) == (kind, 128, 15)
    assert identity.window_bytes == 127 - 16
    assert identity.letters == ("X", "Y", "Z", "A", "C")
    assert (0x87 in cnc.realtime) == (kind == "grblhal")


async def test_full_status_byte_is_never_sent_to_a_firmware_that_would_run_a_macro_on_it() -> None:
    driver, cnc, _, _ = far_end(FakeCnc("grbl"))
    await driver.identify()
    assert 0x87 not in cnc.realtime


async def test_firmware_other_than_the_cell_file_says_is_refused_with_both_names() -> None:
    driver, _, _, _ = far_end(FakeCnc("grbl"))
    driver.facts = driver.facts.model_copy(update={"firmware": "grblhal"})
    with pytest.raises(FirmwareMismatch, match=r"grbl 1\.1, the cell file says grblHAL"):
        await driver.identify()


async def test_unknown_firmware_is_refused_with_its_own_name() -> None:
    class Fluid(FakeCnc):
        def _dollar(self, line: str) -> None:
            self.say("[VER:3.7 FluidNC v3.7.8:]")
            self.say("[OPT:PHSW,32,256]")
            self.say("ok")

        def reset(self) -> None:
            self.say("Grbl 3.7 [FluidNC v3.7.8 (wifi) '$' for help]")

    driver, _, _, _ = far_end(Fluid())
    with pytest.raises(FirmwareUnknown, match="FluidNC"):
        await driver.identify()


async def test_silent_port_is_one_clear_line() -> None:
    driver, cnc, _, _ = far_end()
    cnc.is_mute = True
    with pytest.raises(DeviceSilent, match="does not answer at 115200 baud"):
        await driver.identify()


async def test_half_a_line_left_by_a_dead_master_is_never_executed() -> None:
    driver, cnc, _, _ = far_end()
    cnc.receive(b"N7 G1 X5")
    await driver.identify()
    run(driver, driver.clock, 0.5)  # type: ignore[arg-type]
    assert cnc.executed == [] and not any("X5" in line for line in cnc.commands)


async def test_machine_found_moving_is_held_before_it_is_reset() -> None:
    driver, cnc, _, _ = far_end(FakeCnc(line_s=1000.0))
    cnc.receive(b"N1 G1 X500 F60\n")
    await driver.identify()
    assert cnc.realtime.index(0x21) < cnc.realtime.index(0x18)
    assert cnc.state == "Idle"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rx", [128, 254, 1024])
async def test_program_arrives_unchanged_and_in_order_and_never_overflows_the_buffer(kind: str, rx: int) -> None:
    driver, cnc, _, clock = far_end(FakeCnc(kind, rx=rx, planner=15, line_s=0.003))
    await driver.identify()
    lines = program(300)
    driver.load(lines)
    driver.release(len(lines))
    run(driver, clock, 2.0)
    assert cnc.executed == lines
    assert cnc.overflowed == 0
    assert driver.is_drained
    assert (driver.counts.sent, driver.counts.acknowledged, driver.counts.executed) == (300, 300, 300)


async def test_nothing_goes_before_it_is_released_and_counts_are_indices_from_the_first_line() -> None:
    driver, cnc, _, clock = far_end()
    await driver.identify()
    lines = program(40)
    driver.load(lines, first=10)
    run(driver, clock, 0.2)
    assert cnc.executed == []
    driver.release(20)
    run(driver, clock, 1.0)
    assert cnc.executed == lines[10:20]
    assert driver.is_drained and driver.counts.executed == 20


async def test_an_ok_is_not_progress_executed_follows_the_reported_line() -> None:
    driver, cnc, _, clock = far_end(FakeCnc(line_s=0.5))
    await driver.identify()
    driver.load(program(20))
    driver.release(20)
    run(driver, clock, 1.2)
    counts = driver.counts
    assert counts.acknowledged == 20
    assert counts.executing == cnc.line and counts.executed == cnc.line - 1
    assert counts.executed <= len(cnc.executed)


async def test_status_is_asked_for_at_most_ten_times_a_second() -> None:
    driver, cnc, _, clock = far_end()
    await driver.identify()
    cnc.realtime.clear()
    for _ in range(2000):
        driver.query_status()
        driver.pump()
        clock.advance(0.001)
    assert 18 <= cnc.realtime.count(0x3F) <= 21


async def test_work_offset_of_the_status_is_kept_between_the_reports_that_carry_it() -> None:
    driver, _, _, clock = far_end()
    await driver.identify()
    events = run(driver, clock, 0.35)
    status = [event.status for event in events if isinstance(event, StatusReport)][-1]
    assert status.work["C"] == pytest.approx(0.0) and status.machine["C"] == pytest.approx(5.0)
    assert status.tool == 1 and status.overrides == (100, 100, 100)


@pytest.mark.parametrize("kind", KINDS)
async def test_refused_line_stops_the_stream_and_holds_the_machine_under_both_firmware_behaviours(kind: str) -> None:
    driver, cnc, _, clock = far_end(FakeCnc(kind, rx=128, planner=15, line_s=0.05))
    await driver.identify()
    driver.load(program(200, bad=30))
    driver.release(200)
    events = run(driver, clock, 5.0)
    rejected = of(events, LineRejected)
    assert [event.n for event in rejected] == [30]
    assert cnc.state == "Hold" and 0x21 in cnc.realtime
    assert not any(line.startswith("N60 ") for line in cnc.commands)
    assert driver.is_halted and driver.counts.acknowledged == 29
    driver.reset()
    events = run(driver, clock, 0.3)
    assert of(events, Welcome)
    driver.load(program(5))
    driver.release(5)
    run(driver, clock, 1.0)
    assert cnc.executed[-5:] == program(5)


async def test_dollar_command_during_a_program_is_refused_here_as_it_would_poison_the_stream() -> None:
    driver, cnc, _, clock = far_end(FakeCnc(line_s=0.5))
    await driver.identify()
    driver.load(program(10))
    driver.release(10)
    run(driver, clock, 0.2)
    with pytest.raises(CommandRefused):
        await driver.command("$$")
    assert cnc.latch == 0


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("$H", "cannot be streamed"),
        ("N1 G1 X1 !", "character"),
        ("N1 (ü)", "character"),
        ("N2 G1 X1", "carries N2"),
        ("N1 " + "X1" * 150, "characters"),
    ],
)
async def test_line_that_would_do_harm_is_not_sent(line: str, why: str) -> None:
    driver, cnc, _, clock = far_end()
    await driver.identify()
    before = len(cnc.commands)
    driver.load([line])
    driver.release(1)
    rejected = of(run(driver, clock, 0.2), LineRejected)
    assert len(rejected) == 1 and why in rejected[0].text  # type: ignore[union-attr]
    assert cnc.commands[before:] == []


async def test_lost_ok_is_told_as_overdue_after_the_answer_time() -> None:
    driver, cnc, _, clock = far_end(answer_timeout_s=2.0)
    await driver.identify()
    cnc.eat_ok = 1
    driver.load(program(10))
    driver.release(10)
    assert not of(run(driver, clock, 1.9), AnswerOverdue)
    overdue = of(run(driver, clock, 2.0), AnswerOverdue)
    assert [event.n for event in overdue] == [10]
    assert not driver.is_drained


async def test_damaged_ok_is_no_answer_and_the_overdue_event_shows_it() -> None:
    driver, cnc, _, clock = far_end(answer_timeout_s=1.0)
    await driver.identify()
    cnc.spoil_ok = 1
    driver.load(program(10))
    driver.release(10)
    events = run(driver, clock, 3.0)
    assert [event.garbled for event in of(events, ProtocolFault)] == [True]
    assert of(events, AnswerOverdue)[0].garbled == "o*"


async def test_doubled_ok_is_a_protocol_fault_once_nothing_is_owed() -> None:
    driver, cnc, _, clock = far_end()
    await driver.identify()
    cnc.double_ok = 1
    driver.load(program(10))
    driver.release(10)
    faults = of(run(driver, clock, 1.0), ProtocolFault)
    assert len(faults) == 1 and not faults[0].garbled


@pytest.mark.parametrize("state", ["Hold", "Door", "Tool"])
async def test_answer_time_stands_still_while_the_machine_pauses(state: str) -> None:
    driver, cnc, _, clock = far_end(FakeCnc(rx=128, planner=2, line_s=0.2), answer_timeout_s=1.0)
    await driver.identify()
    driver.load(program(30))
    driver.release(30)
    run(driver, clock, 0.1)
    cnc.state = state
    assert not of(run(driver, clock, 20.0, 0.01), AnswerOverdue)
    assert driver.protocol.unanswered > 0
    cnc.state = "Run"
    assert not of(run(driver, clock, 10.0, 0.01), AnswerOverdue)
    assert driver.is_drained


async def test_answer_time_is_extended_by_the_predicted_time_of_what_the_controller_holds() -> None:
    lines = ["N1 G93 G1 X100 F2", "N2 X200 F2", "N3 G94", "N4 G4 P20", "N5 M2"]
    driver, _, _, clock = far_end(FakeCnc(planner=1, line_s=30.0), answer_timeout_s=1.0)
    await driver.identify()
    driver.load(lines)
    driver.release(5)
    assert not of(run(driver, clock, 55.0, 0.01), AnswerOverdue)


async def test_prediction_of_the_program_extends_the_answer_time_too() -> None:
    driver, cnc, _, clock = far_end(FakeCnc(planner=1, line_s=25.0), answer_timeout_s=1.0)
    await driver.identify()
    lines = program(3)
    driver.load(lines, times_s=[25.0, 50.0, 75.0])
    driver.release(3)
    assert not of(run(driver, clock, 24.0, 0.01), AnswerOverdue)
    cnc.is_mute = True
    assert of(run(driver, clock, 80.0, 0.01), AnswerOverdue)


async def test_reset_forgets_lines_in_flight_and_says_how_many() -> None:
    driver, cnc, port, clock = far_end(FakeCnc(rx=1024, planner=2, line_s=50.0))
    await driver.identify()
    driver.load(program(100))
    driver.release(100)
    run(driver, clock, 0.5)
    in_flight = driver.protocol.unanswered
    assert in_flight > 5
    driver.reset()
    assert port.discarded >= 1
    welcome = of(run(driver, clock, 0.2), Welcome)
    assert [(event.expected, event.forgotten) for event in welcome] == [(True, in_flight)]
    sent = len(cnc.commands)
    run(driver, clock, 0.5)
    assert len(cnc.commands) == sent


async def test_reset_of_the_controller_by_itself_stops_the_stream_and_is_told_as_unexpected() -> None:
    driver, cnc, _, clock = far_end(FakeCnc(line_s=0.05))
    await driver.identify()
    driver.load(program(2000))
    driver.release(2000)
    run(driver, clock, 1.0)
    cnc.reset()
    events = run(driver, clock, 0.5)
    assert [event.expected for event in of(events, Welcome)] == [False]
    assert driver.is_halted
    assert cnc.planner_size and not cnc.planner


async def test_hold_overtakes_what_has_not_been_written() -> None:
    driver, cnc, port, clock = far_end(FakeCnc(line_s=1.0))
    await driver.identify()
    driver.load(program(500))
    driver.release(500)
    for _ in range(50):
        driver.pump()
        clock.advance(0.0005)
    before = len(port.written)
    driver.hold()
    assert port.written[before:] == b"!"
    assert cnc.state == "Hold"


async def test_written_ahead_is_never_more_than_the_line_takes_in_two_milliseconds() -> None:
    driver, _, port, clock = far_end(FakeCnc(line_s=0.001))
    await driver.identify()
    driver.load(program(3000))
    driver.release(3000)
    clock.advance(1.0)
    start, began = len(port.written), clock.now()
    for _ in range(1000):
        driver.pump()
        behind = (len(port.written) - start) - (clock.now() - began) * 11520
        assert behind <= 11520 * 0.002 + 2  # a status byte may stand on top
        clock.advance(0.0007)
    assert len(port.written) - start > 0.99 * 0.7 * 11520


async def test_port_that_goes_away_is_told_once_and_commands_then_raise() -> None:
    driver, _, port, clock = far_end()
    await driver.identify()

    def gone() -> bytes:
        raise LinkLost("serial port memory is gone")

    port.read = gone  # type: ignore[method-assign]
    events = run(driver, clock, 0.1)
    assert len(of(events, PortLost)) == 1
    with pytest.raises(LinkLost):
        driver.hold()
    with pytest.raises(LinkLost):
        await driver.command("$#")


async def test_homing_waits_for_its_end_and_jog_unlock_offsets_and_settings_answer() -> None:
    driver, cnc, _, clock = far_end()
    await driver.identify()
    began = clock.now()
    await driver.home()
    assert clock.now() - began >= 1.99
    await driver.jog("C", -5.0, 600.0)
    await driver.unlock()
    assert any(line.startswith("$J=G91 G21 C-5.0000 F600") for line in cnc.commands)
    assert (await driver.work_offset())["Z"] == -420.0
    assert (await driver.settings())["32"] == "0"


async def test_jog_of_an_axis_that_the_machine_has_not_is_refused_with_its_axes() -> None:
    driver, _, _, _ = far_end()
    await driver.identify()
    with pytest.raises(RangeError_, match="this machine has XYZAC"):
        await driver.jog("B", 1.0, 100.0)
    with pytest.raises(RangeError_):
        await driver.jog("X", float("nan"), 100.0)


async def test_refused_command_clears_the_latch_so_that_the_next_program_runs() -> None:
    driver, cnc, _, clock = far_end()
    await driver.identify()
    with pytest.raises(DeviceFault) as caught:
        await driver.command("G1 BAD")
    assert caught.value.code == 20
    driver.load(program(3))
    driver.release(3)
    run(driver, clock, 0.5)
    assert cnc.executed == program(3)


@pytest.mark.parametrize("percent", [10, 95, 100, 137, 200])
async def test_feed_override_ends_at_the_asked_percentage_however_often_it_is_asked(percent: int) -> None:
    driver, cnc, _, _ = far_end()
    await driver.identify()
    for _ in range(2):
        cnc.realtime.clear()
        driver.feed_override(percent)
        steps = {0x91: 10, 0x92: -10, 0x93: 1, 0x94: -1}
        assert cnc.realtime[0] == 0x90
        assert 100 + sum(steps[byte] for byte in cnc.realtime[1:]) == percent
    with pytest.raises(RangeError_):
        driver.feed_override(201)


async def test_bytes_that_come_one_at_a_time_and_writes_that_are_taken_one_at_a_time_lose_nothing() -> None:
    driver, cnc, port, clock = far_end(FakeCnc("grbl", rx=128, planner=15, line_s=0.001))
    await driver.identify()
    port.takes = 1
    port.read_max = 1
    lines = program(20)
    driver.load(lines)
    driver.release(20)
    run(driver, clock, 4.0)
    assert cnc.executed == lines and driver.is_drained


async def test_program_from_an_iterator_ends_by_itself() -> None:
    driver, cnc, _, clock = far_end(FakeCnc(line_s=0.001))
    await driver.identify()
    driver.load(iter(program(30)))
    driver.release(10**9)
    run(driver, clock, 1.0)
    assert cnc.executed == program(30) and driver.is_drained


async def test_idle_said_before_the_ok_of_the_same_read_does_not_count_the_line_as_executed() -> None:
    driver, cnc, _, clock = far_end(FakeCnc(line_s=5.0))
    await driver.identify()
    driver.load(program(1))
    driver.release(1)
    idle = cnc.report().encode() + b"\r\n"
    while cnc.state != "Run":  # the line goes out at the line's pace; then its `ok` waits to be read
        clock.advance(0.001)
        driver.pump()
    cnc.out[:0] = idle * 5  # said while the machine still stood
    driver.pump()
    assert idle.startswith(b"<Idle") and cnc.state == "Run" and cnc.executed == []
    assert driver.counts.acknowledged == 1
    assert driver.counts.executed == 0 and not driver.is_drained
