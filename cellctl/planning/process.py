"""Starts a worker for a task, follows its reports and ends it: killed when cancelled, its death told as a reason."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import msgspec
import structlog

from cellctl.planning.ending import kill, to_its_end
from cellctl.planning.engine import Progress, Waits, unheard
from cellctl.planning.task import Done, Failed, Report, Task
from cellctl.planning.task import Progress as ProgressReport

LINE_LIMIT = 64 << 20  # bytes of one report; findings of a bad mesh can be many
STDERR_TAIL = 2000
log = structlog.get_logger(__name__)


class WorkerError(Exception):
    """A task that was not done. failed : title, detail, hint   is_lost : its process ended without a word   log : the last lines of its stderr"""

    def __init__(self, failed: Failed, is_lost: bool = False, log: str = "") -> None:
        super().__init__(failed.detail)
        self.failed = failed
        self.is_lost = is_lost
        self.log = log


@dataclass(frozen=True)
class Workers:
    """The engine of one machine. folder : for task files and logs; memory_bytes : cap of each process; places : how many tasks it is asked for"""

    folder: Path
    memory_bytes: int
    places: int = 1

    async def run(self, task: Task, progress: Progress, waits: Waits = unheard) -> dict[str, Any]:
        """Carry a task out in a process of its own, at once; its summary. Raises WorkerError; a cancelled call kills the process."""
        task = replace_limits(task, os.getpid(), self.memory_bytes)
        with tempfile.TemporaryDirectory(dir=self.folder) as scratch, tempfile.TemporaryFile(dir=self.folder) as stderr:
            path = Path(scratch) / "task.json"
            path.write_bytes(msgspec.json.encode(task))
            command = [sys.executable, "-m", "cellctl.planning.worker", str(path)]
            process = await _started(command, stderr)
            try:
                end = await _follow(process, progress)
                code = await process.wait()
            finally:
                await to_its_end(kill(process))
            tail = _tail(stderr)
        if isinstance(end, Done):
            return end.summary
        is_lost = end is None
        if end is None:
            end = Failed(
                "The worker ended", f"the worker of this {task.kind} {_cause_of_death(code)}", "ask for it again", 503
            )
        if tail:
            log.warning("worker failed", kind=task.kind, part=task.part_name, detail=end.detail, stderr=tail)
        raise WorkerError(end, is_lost, tail)


def replace_limits(task: Task, parent: int, memory_bytes: int) -> Task:
    """The task with who waits for it and what it may use."""
    return msgspec.structs.replace(task, parent=parent, memory_bytes=memory_bytes)


async def _started(command: list[str], stderr: IO[bytes]) -> asyncio.subprocess.Process:
    """Start a process. A call that is cancelled meanwhile leaves none behind."""
    starting = asyncio.ensure_future(
        asyncio.create_subprocess_exec(
            *command,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=stderr,
            limit=LINE_LIMIT,
        )
    )
    try:
        return await to_its_end(starting)
    except asyncio.CancelledError:
        if not starting.cancelled() and starting.exception() is None:
            await to_its_end(kill(starting.result()))
        raise


async def _follow(process: asyncio.subprocess.Process, progress: Progress) -> Done | Failed | None:
    """Read reports until the worker closes its line; its last word, None if it left without one."""
    end: Done | Failed | None = None
    if process.stdout is None:
        return None
    async for line in process.stdout:
        report = msgspec.json.decode(line, type=Report)
        if isinstance(report, ProgressReport):
            progress(report.stage, report.fraction)
        else:
            end = report
    return end


def _cause_of_death(code: int) -> str:
    if code < 0:
        name = signal.Signals(-code).name if -code in set(signal.Signals) else str(-code)
        return f"was killed by signal {name}"
    return f"ended with code {code} and no result"


def _tail(file: Any) -> str:
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - STDERR_TAIL))
    return str(file.read().decode(errors="replace")).strip()
