"""The driver against a far end with the line's own clock: every byte, the wire's share, the delay of a hold, memory, the planner's fill."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from drivers.cnc.events import ProtocolFault
from tests.bench.bench_streaming import ANSWERS, BUFFERS
from tests.bench.cnc_far_end import Answers, FarEnd
from tests.bench.streaming import Case, five_axis_line
from tests.bench.streaming_in_memory import allowed, in_memory
from tests.unit.drivers.fakes import FakeCnc, far_end, program

LINES = 400


@pytest.mark.parametrize("answers", ANSWERS, ids=lambda answers: answers.name)
@pytest.mark.parametrize("rx", BUFFERS)
def test_every_line_arrives_once_and_unchanged_at_the_pace_of_the_wire(rx: int, answers: Answers) -> None:
    case = Case(rx, answers, LINES)
    outcome = in_memory(case)
    counts = outcome.counts
    assert (counts.lines, counts.lost, counts.doubled, counts.changed, counts.overflowed) == (LINES, 0, 0, 0, 0)
    assert outcome.share(case.byte_s) >= allowed(case) - 0.01
    assert np.percentile(outcome.late_ms(), 99) <= 2.0


def test_hold_passes_a_full_window_of_lines_that_the_machine_is_slow_to_take() -> None:
    case = Case(1024, ANSWERS[0], LINES, block_s=0.02)
    outcome = in_memory(case)
    assert outcome.counts.lines == LINES and max(outcome.late_ms()) <= 2.0


@pytest.mark.parametrize("slower", [1.006, 1.02])
def test_adapter_whose_clock_is_slow_and_whose_queue_is_hidden_does_not_delay_a_hold_ever_more(slower: float) -> None:
    case = Case(1024, ANSWERS[0], 1500)
    slow = FarEnd(case.rx, slower * case.byte_s, case.answers, five_axis_line, lambda _: case.block_s, lambda _: True)
    late = in_memory(case, far=slow).late_ms()
    assert max(late[len(late) // 2 :]) < 6.0


def test_lines_of_a_usb_link_are_limited_by_the_window_alone() -> None:
    case = Case(1024, ANSWERS[0], 3000, 0, 0.00002)
    outcome = in_memory(case)
    assert outcome.counts.lines == 3000 and outcome.counts.overflowed == 0
    assert outcome.lines_per_s > 5000


def test_program_of_five_million_lines_is_streamed_in_constant_memory() -> None:
    case = Case(1024, ANSWERS[0], 5_000_000)
    in_memory(case, upto=50)
    tracemalloc.start()
    assert in_memory(case, upto=400).counts.lines == 400
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 500_000


@pytest.mark.parametrize("rx", [128, 1024])
async def test_doubled_answer_in_the_middle_of_a_stream_is_found_by_the_fill_of_the_buffer_before_anything_is_lost(rx: int) -> None:
    driver, cnc, _, clock = far_end(FakeCnc(rx=rx, planner=4, line_s=0.05))
    await driver.identify()
    driver.load(program(400))
    driver.release(400)
    faults = []
    for k in range(3000):
        faults += [event for event in driver.pump() if isinstance(event, ProtocolFault)]
        if k == 1000:
            cnc.double_ok = 1
        clock.advance(0.001)
    assert [fault.garbled for fault in faults] == [False] and "more than it should" in faults[0].text
    assert driver.is_halted and cnc.state == "Hold"
