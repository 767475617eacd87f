"""Random walks through commands, faults, repairs, time and kills: 10,000 sequences, the invariants asked of the plant after every step."""

from __future__ import annotations

import os
import time

from tests.bench.table import Cell, Table
from tests.cell.faults.walk import STEPS, walk_all

SEQUENCES = 10_000
PER_WALK = 25
SEED = 1_000  # `make test` takes the seeds below
SHOWN = 20


def run() -> list[Table]:
    """How many sequences were gone through, and what was wrong in them."""
    started = time.perf_counter()
    jobs = [(SEED + k, PER_WALK) for k in range(SEQUENCES // PER_WALK)]
    results = list(walk_all(jobs, os.cpu_count() or 1))
    took_s = time.perf_counter() - started
    wrong = [text for _, text in results if text]
    row: list[Cell] = [sum(count for count, _ in results), STEPS, len(wrong), round(took_s), 1000.0 * took_s / SEQUENCES]
    note = f"{PER_WALK} sequences on one cell, then a fresh one; every third cell is gated by Modbus; a walk with a violation counts as none"
    columns = ["sequences", "steps of each", "walks with a violation", "s", "ms per sequence"]
    tables = [Table("Random walks and the invariants", columns, [row], note)]
    if wrong:
        shown: list[list[Cell]] = [[text.splitlines()[0][:300]] for text in wrong[:SHOWN]]
        tables.append(Table("Random walks: violations", ["invariant, seed"], shown, f"{len(wrong)} walks"))
    return tables
