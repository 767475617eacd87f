"""The matrix of faults in simulated time: every fault in every situation, at random instants; `--seed KEY` repeats one run.

    python -m tests.bench.bench_faults [--runs N] [--only WORD] [--seed 'ROW/SITUATION/GATE/NUMBER']
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Sequence

from tests.bench.table import Cell, Table
from tests.cell.faults.play import Key, play, play_all
from tests.cell.faults.row import Row, bound_s
from tests.cell.faults.rows import LATER, ROWS
from tests.cell.faults.scene import GATES, SITUATIONS, Outcome, facts_of

RUNS = 5
FAILURES_SHOWN = 40


def keys_of(runs: int, word: str = "", first: int = 0) -> list[Key]:
    """Every row, situation and gate, `runs` times."""
    return [
        (row.name, situation, gate, seed)
        for row in ROWS
        if word in row.name
        for situation in SITUATIONS
        for gate in GATES
        for seed in range(first, first + runs)
    ]


def measure(runs: int, word: str = "") -> list[Outcome]:
    """Play them all on all cores."""
    return list(play_all(keys_of(runs, word), os.cpu_count() or 1))


def _ended(outcomes: Sequence[Outcome]) -> str:
    """How runs ended, most frequent first."""
    counts = Counter(outcome.ended for outcome in outcomes)
    return ", ".join(f"{name} {count}" for name, count in counts.most_common())


def _bound_ms(row: Row, gate: str, which: str) -> Cell:
    signal = str(getattr(row.on(facts_of(gate, row.cnc)), which))
    return round(1000 * bound_s(signal, facts_of(gate, row.cnc))) if signal else "-"


def _row(row: Row, outcomes: Sequence[Outcome]) -> list[Cell]:
    by_situation: dict[str, list[Outcome]] = defaultdict(list)
    for outcome in outcomes:
        by_situation[outcome.situation].append(outcome)
    cells: list[Cell] = [row.name, len(outcomes), sum(bool(outcome.wrong) for outcome in outcomes)]
    for gate in GATES:
        own = [outcome for outcome in outcomes if outcome.gate == gate]
        cells += [round(max((outcome.lit_ms for outcome in own), default=0.0)) if row.lit else "-", _bound_ms(row, gate, "lit")]
        cells += [round(max((outcome.standing_ms for outcome in own), default=0.0)), _bound_ms(row, gate, "standing")]
    return [*cells, *(_ended(by_situation[situation]) for situation in SITUATIONS)]


def tables_of(outcomes: Sequence[Outcome], took_s: float) -> list[Table]:
    """The matrix, and a line for every run in which something was wrong."""
    by_row: dict[str, list[Outcome]] = defaultdict(list)
    for outcome in outcomes:
        by_row[outcome.row].append(outcome)
    figures = [f"{gate}: {what}" for gate in GATES for what in ("lit after ms", "bound", "lit at standstill ms", "its bound")]
    columns = ["fault", "runs", "wrong", *figures, *SITUATIONS]
    rows = [_row(row, by_row[row.name]) for row in ROWS if by_row[row.name]]
    rows += [[name, 0, 0, *["-"] * len(figures), *["in bench_process_faults"] * len(SITUATIONS)] for name in LATER]
    note = (
        f"{len(outcomes)} runs in {took_s:.0f} s, random instants, in stream-gate and Modbus-gate cells, simulated time; times at the plant. "
        "bound: 30 ms, one request (100 ms at most) and the stale limit of the signal that was lost; where nobody can reach the laser, its dead-man."
    )
    wrong = [outcome for outcome in outcomes if outcome.wrong]
    failures: list[list[Cell]] = [[outcome.key, "; ".join(outcome.wrong)] for outcome in wrong[:FAILURES_SHOWN]]
    found = [Table("Faults: what must not be", ["--seed", "what was wrong"], failures, f"{len(wrong)} runs")] if failures else []
    return [Table("Faults by situation", columns, rows, note), *found]


def run() -> list[Table]:
    """Tables of `make bench`."""
    started = time.perf_counter()
    outcomes = measure(RUNS)
    return tables_of(outcomes, time.perf_counter() - started)


def main(words: Sequence[str]) -> int:
    """Of the command line; exit 1 if something was wrong."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--only", default="", help="rows whose names hold this")
    parser.add_argument("--seed", help="repeat one run: ROW/SITUATION/GATE/NUMBER")
    given = parser.parse_args(words)
    if given.seed:
        name, situation, gate, number = given.seed.split("/")
        outcome = play((name, situation, gate, int(number)))
        print(outcome)
        return 1 if outcome.wrong else 0
    started = time.perf_counter()
    outcomes = measure(given.runs, given.only)
    for table in tables_of(outcomes, time.perf_counter() - started):
        print(table.markdown())
    return 1 if any(outcome.wrong for outcome in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
