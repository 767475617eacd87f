"""Streaming to the CNC: share of the wire, CPU, delay of a hold and every byte compared, per receive buffer and pattern of answers.

`make bench ARGS="streaming million"` streams the million lines in memory alone, and a million by wire at USB speed.
"""

from __future__ import annotations

import os
import sys

import numpy as np

from tests.bench.cnc_far_end import Answers, FarEnd
from tests.bench.streaming import (
    Case,
    Outcome,
    five_axis_line,
    over_a_wire,
    with_bare_loop,
    with_driver,
    with_lone_bytes,
    with_unpaced_loop,
)
from tests.bench.streaming_in_memory import allowed, in_memory
from tests.bench.table import Cell, Table

ANSWERS = (
    Answers("prompt"),
    Answers("2 ms late", delay_s=0.002),
    Answers("bunches of 4 ms", bunch=10**9, bunch_s=0.004),
    Answers("0 to 4 ms late", jitter_s=0.004),
    Answers("bunches of 16 ms", bunch=10**9, bunch_s=0.016),
)
BUFFERS = (128, 254, 1024)
LINES = 800
USB_LINES = 25_000
SPREAD_LINES = 4000  # per buffer and pattern in the line's own time
MILLION = 1_000_000
USB_BLOCK_S = 0.00002
BLOCK_S = 0.0005
COLUMNS = (
    "near end", "rx bytes", "answers", "lines", "share of wire %", "buffer allows %", "lines/s", "CPU ms/1000 lines",
    "hold p50 ms", "hold p99 ms", "hold max ms", "overflowed", "lost", "doubled", "changed",
)  # fmt: skip


def row(name: str, case: Case, outcome: Outcome) -> list[Cell]:
    """One line of a table."""
    counts, late = outcome.counts, outcome.late_ms()
    holds: list[Cell] = [float(np.percentile(late, q)) for q in (50, 99, 100)] if late else ["-"] * 3
    share: list[Cell] = [100 * outcome.share(case.byte_s), 100 * allowed(case)] if case.byte_s else ["-", "-"]
    return [
        name, case.rx, case.answers.name, counts.lines, *share, outcome.lines_per_s, 1e6 * outcome.cpu_s / case.lines, *holds,
        counts.overflowed, counts.lost, counts.doubled, counts.changed,
    ]  # fmt: skip


def by_wire() -> Table:
    """At 115200 baud over a pseudo-terminal, far end in another process; the plain loop first."""
    cases = [Case(rx, answers, LINES) for rx in BUFFERS for answers in ANSWERS if rx > 128 or answers.bunch_s < 0.01]
    plain = Case(1024, ANSWERS[0], LINES)
    rows = [row("plain loop", plain, over_a_wire(plain, with_bare_loop)), row("unpaced loop", plain, over_a_wire(plain, with_unpaced_loop))]
    alone = over_a_wire(plain, with_lone_bytes).late_ms()
    rows += [row("driver", case, over_a_wire(case, with_driver)) for case in cases]
    note = (
        "53-byte five-axis lines at 115200 baud; the far end has the line's own clock, the buffer, 15 blocks and the answers' way back. "
        "Hold: from the call to the byte having left the line, at full load. Plain loop: counts characters, parses nothing, same pacing; "
        "unpaced: as fast as the buffer allows, so that a hold would stand behind it. "
        f"A lone byte on the idle pseudo-terminal: p50 {np.percentile(alone, 50):.2f}, p99 {np.percentile(alone, 99):.2f} ms. "
        f"Load of the machine before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    )
    return Table("Streaming at 115200 baud by wire", COLUMNS, rows, note)


def in_line_time(lines: int) -> Table:
    """So many lines at 115200 baud in the line's own time, spread over buffers and answers."""
    kinds = [(rx, answers) for rx in BUFFERS for answers in ANSWERS if rx > 128 or answers.bunch_s < 0.01]
    rows = []
    for rx, answers in kinds:
        case = Case(rx, answers, -(-lines // len(kinds)))
        rows.append(row("driver", case, in_memory(case)))
    note = "Driver and far end joined in memory at the line's own time; CPU is that of both, without system calls. Every line compared."
    return Table(f"{lines} lines at 115200 baud", COLUMNS, rows, note)


def slow_lines() -> Table:
    """A hidden queue before a line that is slower than its name: adapters with a clock of their own."""
    rows: list[list[Cell]] = []
    for rx in (254, 1024):
        for slower in (0.003, 0.006, 0.01, 0.02):
            case = Case(rx, ANSWERS[0], SPREAD_LINES)
            byte_s = case.byte_s * (1.0 + slower)
            far = FarEnd(rx, byte_s, case.answers, five_axis_line, lambda _: BLOCK_S, lambda _: True)
            outcome = in_memory(case, far=far)
            late = outcome.late_ms()
            settled = [float(np.percentile(late[len(late) // 3 :], q)) for q in (50, 99, 100)]
            rows.append([rx, 100 * slower, 100 * outcome.share(byte_s), max(late), *settled])
    columns = ("rx bytes", "slower by %", "share of the real wire %", "hold max ms, from the start", "settled p50 ms", "p99 ms", "max ms")
    return Table("A line slower than its name behind a hidden queue", columns, rows, "In the line's own time; settled: behind the first third.")


def usb(lines: int) -> Table:
    """No baud rate: the window is the only limit."""
    cases = [Case(rx, ANSWERS[0], lines, 0, USB_BLOCK_S) for rx in BUFFERS]
    rows = [row("driver", case, over_a_wire(case, with_driver)) for case in cases]
    return Table("Streaming at USB speed", COLUMNS, rows, "Pseudo-terminal without pace; the far end, in Python, shares the machine.")


def run() -> list[Table]:
    """About three minutes; the million lines are asked for by name."""
    if "million" in sys.argv[1:]:
        return [in_line_time(MILLION), usb(MILLION // len(BUFFERS))]
    return [by_wire(), in_line_time(SPREAD_LINES * 14), slow_lines(), usb(USB_LINES)]
