"""Reads a Program's directory away from the event loop, at ordinary priority."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import os
from pathlib import Path

from planner.program import Program


async def read_off_loop(directory: Path) -> tuple[Program, str]:
    """The Program and the hash of its description (hex). Raises FileFormatError."""
    return await asyncio.to_thread(_read, directory)


def _read(directory: Path) -> tuple[Program, str]:
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # this thread only: the tick stays ahead of it
    from planner.files import read_program  # what it needs is not loaded before: a cell that was killed is back the sooner

    program = read_program(directory)
    return program, hashlib.sha256((directory / "program.json").read_bytes()).hexdigest()
