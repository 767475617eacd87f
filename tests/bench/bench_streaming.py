"""Streaming to the CNC: share of the wire, CPU, delay of a hold and every byte compared, per receive buffer and pattern of answers."""

from __future__ import annotations

import os

import numpy as np

from tests.bench.cnc_far_end import Answers
from tests.bench.streaming import Case, Outcome, over_a_wire, with_bare_loop, with_driver
from tests.bench.streaming_in_memory import in_memory
from tests.bench.table import Cell, Table

ANSWERS = (
    Answers("prompt"),
    Answers("2 ms late", delay_s=0.002),
    Answers("bunches of 4 ms", bunch=10**9, bunch_s=0.004),
    Answers("0 to 4 ms late", jitter_s=0.004),
    Answers("bunches of 16 ms", bunch=10**9, bunch_s=0.016),
)
BUFFERS = (128, 254, 1024)
LINES = 2000
MILLION = 1_000_000
USB_BLOCK_S = 0.00002
COLUMNS = (
    "near end", "rx bytes", "answers", "lines", "share of wire %", "buffer allows %", "lines/s", "CPU ms/1000 lines",
    "hold p50 ms", "hold p99 ms", "hold max ms", "overflowed", "lost", "doubled", "changed",
)  # fmt: skip


def row(name: str, case: Case, outcome: Outcome) -> list[Cell]:
    """One line of a table."""
    counts, late = outcome.counts, outcome.late_ms()
    holds: list[Cell] = [float(np.percentile(late, q)) for q in (50, 99, 100)] if late else ["-"] * 3
    share: list[Cell] = [100 * outcome.share(case.byte_s), 100 * case.possible] if case.byte_s else ["-", "-"]
    return [
        name, case.rx, case.answers.name, counts.lines, *share, outcome.lines_per_s, 1e6 * outcome.cpu_s / case.lines, *holds,
        counts.overflowed, counts.lost, counts.doubled, counts.changed,
    ]  # fmt: skip


def by_wire() -> Table:
    """At 115200 baud over a pseudo-terminal, far end in another process; the plain loop first."""
    cases = [Case(rx, answers, LINES) for rx in BUFFERS for answers in ANSWERS if rx > 128 or answers.bunch_s < 0.01]
    plain = Case(1024, ANSWERS[0], LINES)
    rows = [row("plain loop", plain, over_a_wire(plain, with_bare_loop))]
    rows += [row("driver", case, over_a_wire(case, with_driver)) for case in cases]
    note = (
        "53-byte five-axis lines at 115200 baud; the far end has the line's own clock, the buffer, 15 blocks and the answers' way back. "
        "Hold: from the call to the byte having left the line, at full load. Plain loop: counts characters, parses nothing, same pacing. "
        f"Load of the machine before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    )
    return Table("Streaming at 115200 baud by wire", COLUMNS, rows, note)


def a_million() -> Table:
    """A million lines at 115200 baud in the line's own time, spread over buffers and answers."""
    kinds = [(rx, answers) for rx in BUFFERS for answers in ANSWERS if rx > 128 or answers.bunch_s < 0.01]
    rows = []
    for rx, answers in kinds:
        case = Case(rx, answers, -(-MILLION // len(kinds)))
        rows.append(row("driver", case, in_memory(case)))
    note = "Driver and far end joined in memory at the line's own time; CPU is that of both, without system calls. Every line compared."
    return Table("A million lines at 115200 baud", COLUMNS, rows, note)


def usb() -> Table:
    """No baud rate: the window is the only limit. A million lines through the larger buffer."""
    cases = [Case(rx, ANSWERS[0], 100_000, 0, USB_BLOCK_S) for rx in BUFFERS]
    cases.append(Case(1024, ANSWERS[0], MILLION, 0, USB_BLOCK_S))
    rows = [row("driver", case, over_a_wire(case, with_driver)) for case in cases]
    return Table("Streaming at USB speed", COLUMNS, rows, "Pseudo-terminal without pace; the far end, in Python, shares the machine.")


def run() -> list[Table]:
    """All of it, about ten minutes."""
    return [by_wire(), a_million(), usb()]
