"""Plays runs of the matrix, one or many, here or in worker processes."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import structlog

from tests.cell.faults.rows import ROWS
from tests.cell.faults.scene import Outcome, Scene

Key = tuple[str, str, str, int]
"""Row's name, situation, gate, seed."""
QUIET = 50  # critical alone: the outcome tells what there is to tell
MEMORY = Path("/dev/shm")


def play(key: Key) -> Outcome:
    """One run in a fresh cell with a store in memory."""
    name, situation, gate, seed = key
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(QUIET))
    row = next(row for row in ROWS if row.name == name)
    with tempfile.TemporaryDirectory(prefix="fault-", dir=MEMORY if os.access(MEMORY, os.W_OK) else None) as folder:
        return asyncio.run(Scene(row, situation, gate, seed).play(Path(folder)))


def play_all(keys: Sequence[Key], workers: int) -> Iterator[Outcome]:
    """All of them, in any order."""
    if workers <= 1:
        yield from map(play, keys)
        return
    with multiprocessing.get_context("forkserver").Pool(workers) as pool:
        yield from pool.imap_unordered(play, keys, chunksize=8)
