"""The protocol class alone: bytes in, events out, in pieces of any size; texts as real firmwares send them."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.cnc.codes import ALARMS, ERRORS, explain_alarm, explain_error
from drivers.cnc.events import (
    AlarmRaised,
    LineAccepted,
    LineRejected,
    Message,
    ProtocolFault,
    StatusReport,
    Welcome,
)
from drivers.cnc.identity import check_identity, read_identity
from drivers.cnc.line import could_be_error
from drivers.cnc.program_stream import ProgramStream
from drivers.cnc.protocol import Answer, GrblProtocol
from drivers.cnc.status import StatusReader
from drivers.errors import FirmwareMismatch, FirmwareUnknown
from tests.unit.drivers.fakes import LETTERS, cnc_facts

GRBLHAL_SESSION = (
    b"\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n"
    b"[MSG:Caution: Unlocked]\r\nok\r\n"
    b"<Run:1|MPos:10.000,-3.500,-420.000,12.000,90.000|Bf:93,1001|Ln:812|FS:600,0|WCO:0.000,0.000,-420.000,0.000,0.000|Ov:90,100,100|Pn:PX>\r\n"
    b"ok\r\n<Hold:0|MPos:10.000,-3.500,-420.000,12.000,90.000|Bf:93,1001|FS:0,0>\r\nerror:20\r\nerror:20\r\nALARM:3\r\n"
)
GRBL_SESSION = (
    b"\r\nGrbl 1.1h ['$' for help]\r\n>G54G20:ok\r\n"
    b"ok\r\n<Idle|WPos:1.000,2.000,3.000|F:0|WCO:5.000,5.000,5.000>\r\nok\r\nerror:33\r\nok\r\nALARM:1\r\n[MSG:Reset to continue]\r\n"
)


def in_flight(protocol: GrblProtocol, count: int) -> None:
    for k in range(count):
        protocol.begin(k + 1, f"N{k + 1} G1", 6)
        protocol.finish()


def events_of(session: bytes, sizes: list[int], letters: tuple[str, ...], lines: int) -> list[object]:
    protocol = GrblProtocol(letters, 1000)
    head = session.index(b"help]\r\n") + 7
    found: list[object] = list(protocol.receive(session[:head], 1.0))
    in_flight(protocol, lines)
    rest = session[head:]
    while rest:
        size = sizes.pop() if sizes else 1
        found += protocol.receive(rest[:size], 1.0)
        rest = rest[size:]
    return found


def test_grblhal_session_is_read_and_its_latch_told_once() -> None:
    events = events_of(GRBLHAL_SESSION, [10**6], LETTERS, 4)
    kinds = [type(event) for event in events]
    assert kinds == [Welcome, Message, LineAccepted, StatusReport, LineAccepted, StatusReport, LineRejected, AlarmRaised]
    report = events[3]
    assert isinstance(report, StatusReport)
    status = report.status
    assert (status.state, status.substate, status.line, status.pins) == ("Run", 1, 812, "PX")
    assert status.work == pytest.approx({"X": 10, "Y": -3.5, "Z": 0, "A": 12, "C": 90})
    held = events[5]
    assert isinstance(held, StatusReport) and held.status.is_held
    assert held.status.work["Z"] == 0 and held.status.overrides == (90, 100, 100)


def test_grbl_session_is_read_and_a_dropped_line_does_not_move_the_acknowledged_count() -> None:
    protocol = GrblProtocol(("X", "Y", "Z"), 1000)
    in_flight(protocol, 4)
    events = protocol.receive(GRBL_SESSION.partition(b"help]\r\n")[2], 1.0)
    rejected = [event for event in events if isinstance(event, LineRejected)]
    assert [(event.n, event.code) for event in rejected] == [(3, 33)]
    assert protocol.acknowledged == 2 and protocol.unanswered == 0
    report = next(event for event in events if isinstance(event, StatusReport))
    assert report.status.machine == {"X": 6.0, "Y": 7.0, "Z": 8.0}


@pytest.mark.parametrize(("session", "letters"), [(GRBLHAL_SESSION, LETTERS), (GRBL_SESSION, ("X", "Y", "Z"))])
@given(sizes=st.lists(st.integers(1, 30), max_size=60))
def test_pieces_of_any_size_give_the_same_events(session: bytes, letters: tuple[str, ...], sizes: list[int]) -> None:
    whole = events_of(session, [10**6], letters, 4)
    assert events_of(session, list(sizes), letters, 4) == whole
    assert events_of(session, [], letters, 4) == whole


def test_answer_frees_the_oldest_line_and_nothing_else_does() -> None:
    protocol = GrblProtocol(LETTERS, 30)
    in_flight(protocol, 5)
    assert protocol.unanswered_bytes == 30 and not protocol.has_room(1)
    protocol.receive(b"[GC:G0]\r\n<Idle|MPos:0,0,0,0,0>\r\n>G54:ok\r\n$10=511\r\nALARM:2\r\n", 1.0)
    assert protocol.unanswered == 5
    protocol.receive(b"ok\r\n", 1.0)
    assert protocol.has_room(6) and not protocol.has_room(7)
    assert protocol.oldest is not None and protocol.oldest.n == 2


def test_answer_to_a_line_that_has_not_left_whole_is_a_fault_and_frees_nothing() -> None:
    protocol = GrblProtocol(LETTERS, 100)
    protocol.begin(1, "N1 G1", 6)
    events = protocol.receive(b"ok\r\n", 1.0)
    assert isinstance(events[0], ProtocolFault) and protocol.unanswered == 1


def test_answer_of_a_command_gets_its_own_feedback_and_error() -> None:
    protocol = GrblProtocol(LETTERS, 100)
    answer = Answer()
    protocol.begin(0, "$#", 3, answer)
    protocol.finish()
    protocol.receive(b"[G54:1,2,3,4,5]\r\n[MSG:hello]\r\nerror:9\r\n", 1.0)
    assert answer.lines == ["[G54:1,2,3,4,5]"] and (answer.done, answer.code) == (True, 9)


def test_banner_forgets_lines_in_flight_latch_and_remembered_offsets() -> None:
    protocol = GrblProtocol(LETTERS, 100)
    in_flight(protocol, 3)
    protocol.receive(b"<Idle|MPos:0,0,0,0,0|WCO:1,1,1,1,1>\r\nerror:20\r\n", 1.0)
    events = protocol.receive(b"\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n", 1.0)
    assert events == [Welcome("GrblHAL 1.1f ['$' or '$HELP' for help]", False, 2)]
    assert protocol.unanswered_bytes == 0 and not protocol.is_latched
    report = protocol.receive(b"<Idle|MPos:0,0,0,0,0>\r\n", 1.0)[0]
    assert isinstance(report, StatusReport) and report.status.wco == {}


@given(st.binary(max_size=400))
def test_noise_never_raises_and_never_frees_a_line_unless_it_is_an_answer(noise: bytes) -> None:
    protocol = GrblProtocol(LETTERS, 1000)
    in_flight(protocol, 50)
    protocol.receive(noise, 1.0)
    answers = sum(line.rstrip(b"\r") == b"ok" or line.startswith(b"error:") for line in noise.split(b"\n")[:-1])
    banner = b"grbl" in noise.lower()
    assert banner or protocol.unanswered >= 50 - answers


def test_endless_noise_without_a_newline_does_not_grow_in_memory() -> None:
    protocol = GrblProtocol(LETTERS, 100)
    rng = random.Random(1)
    for _ in range(200):
        protocol.receive(bytes(rng.choices(range(0x20, 0x7F), k=500)), 1.0)
    assert len(protocol._partial) <= 4096


@pytest.mark.parametrize("text", ["<Id*e|MPos:1", "Run|MPos:0,0,0,0,0>", "o*", "[MSG", "x"])
def test_damaged_report_or_ok_is_not_taken_for_an_error(text: str) -> None:
    assert not could_be_error(text)


@pytest.mark.parametrize("text", ["er*or:20", "error;20", "e*ror:2", "*rror:20"])
def test_damaged_error_is_recognised_as_a_line_that_may_be_missing(text: str) -> None:
    assert could_be_error(text)


@pytest.mark.parametrize("text", ["<>", "<Idle|MPos:a,b,c>", "<Idle|Bf:1>", "<Id le|MPos:1,2,3>", "<Idle|Ln:x>"])
def test_malformed_report_is_a_garbled_fault(text: str) -> None:
    events = GrblProtocol(LETTERS, 100).receive(text.encode() + b"\n", 1.0)
    assert [event.garbled for event in events if isinstance(event, ProtocolFault)] == [True]


def test_every_alarm_and_error_has_cause_and_remedy_and_unknown_numbers_say_so() -> None:
    for cause, remedy in (*ALARMS.values(), *ERRORS.values()):
        assert cause and remedy
    assert set(range(1, 39)) <= set(ERRORS) and set(range(1, 11)) <= set(ALARMS)
    assert "99" in explain_alarm(99)[0] and "99" in explain_error(99)[0]


def test_identity_of_grblhal_and_grbl_is_read_from_what_they_say() -> None:
    hal = read_identity(["[VER:1.1f.20260801:]", "[OPT:VNMSL,100,1024,5,0]", "[AXS:5:XYZAC]", "[FIRMWARE:grblHAL]"], "GrblHAL 1.1f", "p")
    assert (hal.firmware, hal.rx_bytes, hal.planner_blocks, hal.letters) == ("grblhal", 1024, 100, LETTERS)
    grbl = read_identity(["[VER:1.1h.20190825:]", "[OPT:V,15,128]"], "Grbl 1.1h ['$' for help]", "p")
    assert (grbl.firmware, grbl.rx_bytes, grbl.planner_blocks, grbl.letters) == ("grbl", 128, 15, ())


def test_firmware_that_states_no_buffer_or_another_name_is_refused() -> None:
    with pytest.raises(FirmwareUnknown, match="buffer sizes"):
        read_identity(["[VER:1.1h:]"], "Grbl 1.1h", "p")
    with pytest.raises(FirmwareUnknown, match="Marlin"):
        read_identity(["[FIRMWARE:Marlin]", "[OPT:V,15,128]"], "", "p")


def test_other_axes_than_in_the_cell_file_are_refused_with_both() -> None:
    identity = read_identity(["[VER:1.1f:]", "[OPT:V,15,128]", "[AXS:3:XYZ]", "[FIRMWARE:grblHAL]"], "", "p")
    with pytest.raises(FirmwareMismatch, match="axes XYZ, the cell file says XYZAC"):
        check_identity(identity, cnc_facts(), LETTERS, 5)


def test_tool_and_planner_fields_of_a_report_are_read() -> None:
    status = StatusReader(LETTERS).read("<Tool|MPos:0,0,0,0,0|Bf:12,34|FS:0,8000|T:3>", 7.0)
    assert (status.tool, status.planner_free, status.rx_free, status.rpm, status.at) == (3, 12, 34, 8000.0, 7.0)


def test_idle_with_blocks_still_planned_is_not_taken_for_the_end() -> None:
    program = ProgramStream(["N1 G1 X1"], 0, 80)
    program.released = 1
    line = program.peek()
    assert line is not None
    program.went(line)
    reader = StatusReader(LETTERS)
    program.follow(reader.read("<Idle|MPos:0,0,0,0,0|Bf:99,1023>", 1.0), 0, 100)
    assert program.executed == 0
    program.follow(reader.read("<Idle|MPos:1,0,0,0,0|Bf:100,1023>", 1.1), 0, 100)
    assert program.executed == 1


def test_line_number_outside_what_was_sent_or_going_back_is_ignored() -> None:
    program = ProgramStream([f"N{k + 1} G1" for k in range(10)], 0, 80)
    program.released = 10
    for _ in range(6):
        line = program.peek()
        assert line is not None
        program.went(line)
    reader = StatusReader(LETTERS)
    for number, executing in ((3, 3), (9, 3), (2, 3), (5, 5)):
        program.follow(reader.read(f"<Run|MPos:0,0,0,0,0|Ln:{number}>", 1.0), 1, 100)
        assert program.executing == executing and program.executed == executing - 1


@pytest.mark.parametrize("pins", ["PXYZR.S", "pxy", "P,H", "P0"])
def test_report_with_pins_that_no_firmware_has_is_damaged(pins: str) -> None:
    protocol = GrblProtocol(LETTERS, 1000)
    events = protocol.receive(f"<Idle|MPos:0,0,0,0,0|FS:0,0|Pn:{pins}>\r\n".encode(), 1.0)
    assert [type(event) for event in events] == [ProtocolFault] and protocol.garbled


def test_error_of_the_settings_before_the_banner_is_a_message_and_behind_it_an_answer() -> None:
    protocol = GrblProtocol(LETTERS, 1000)
    assert [type(event) for event in protocol.receive(b"error:7\r\nGrbl 1.1h ['$' for help]\r\n", 1.0)] == [Message, Welcome]
    assert [type(event) for event in protocol.receive(b"error:7\r\n", 1.0)] == [ProtocolFault]
