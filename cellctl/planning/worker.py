"""One task in a process of its own: `python -m cellctl.planning.worker TASK.json`; reports as JSON lines on its stdout."""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys
import time
import tomllib
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from cellctl.faults import explain
from cellctl.planning.task import Done, Failed, Progress, Report, Task

PR_SET_PDEATHSIG = 1
NICENESS = 10
NICENESS_WAITED_FOR = 2  # somebody looks at an upload until it is inspected
REPORT_PERIOD_S = 0.1


def end_with(parent: int, sign: signal.Signals = signal.SIGKILL) -> None:
    """Get this signal when the parent ends, however it ends. Raises SystemExit if it has ended already."""
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, int(sign), 0, 0, 0)
    if os.getppid() != parent:
        raise SystemExit(1)


def be_modest(task: Task) -> None:
    """Low priority, and an address space that cannot take the machine down."""
    memory_bytes = task.memory_bytes
    os.nice(NICENESS_WAITED_FOR if task.kind == "inspect" else NICENESS)
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


class Line:
    """The way back: one JSON line per report, progress at most ten times a second. Whatever prints otherwise goes to stderr."""

    def __init__(self) -> None:
        self._file = os.fdopen(os.dup(1), "wb", buffering=0)
        os.dup2(2, 1)
        self._last = 0.0

    def send(self, report: Report) -> None:
        """Write one report."""
        self.write(msgspec.json.encode(report))

    def write(self, text: bytes) -> None:
        """Write one line."""
        self._file.write(text + b"\n")

    def progress(self, stage: str, fraction: float) -> None:
        """Tell how far it is, if it was not told just now."""
        now = time.monotonic()
        if now - self._last >= REPORT_PERIOD_S:
            self._last = now
            self.send(Progress(stage, min(max(float(fraction), 0.0), 1.0)))


def use_material(task: Task) -> None:
    """The task's own version of its material, written beside its results, is what the material's name stands for in this process.

    So is the name that the facts have themselves, which a plan goes on with: a copy of a shipped material may have kept that one's.
    """
    from config.base import prefer

    if task.material_toml:
        path = Path(task.folder) / "material.toml"
        path.write_text(task.material_toml, encoding="utf-8")
        for name in {task.material, str(tomllib.loads(task.material_toml).get("name", task.material))}:
            prefer("materials", name, path)


def stage_of(kind: str) -> Callable[[Task, Callable[[str, float], None]], dict[str, Any]]:
    """What carries out a task of this kind; loads no more than that needs."""
    if kind == "record":
        from cellctl.record.writing import record

        return record
    from cellctl.planning.stages import STAGES

    return STAGES[kind]


def work(task: Task, line: Line) -> None:
    """Carry the task out and report its end."""
    try:
        use_material(task)
        line.send(Done(stage_of(task.kind)(task, line.progress)))
    except MemoryError:
        limit = f"{task.memory_bytes / 2**30:.1f} GiB"
        line.send(
            Failed(
                "Out of memory",
                f"{task.part_name}: needs more than the {limit} that a worker may use",
                "use a coarser mesh or recipe",
            )
        )
    except Exception as error:  # noqa: BLE001  the task's edge: whatever happens is told to the one who waits
        fault = explain(error)
        if fault is not None:
            line.send(Failed(fault.title, fault.detail, fault.hint, fault.status))
            return
        traceback.print_exc()
        line.send(
            Failed(
                "Internal fault",
                f"{type(error).__name__}: {error}",
                "the service's log has the details; please report it",
                500,
            )
        )


def main(path: str) -> int:
    """Run the task in a file; exit 0 once its end was reported, whatever that is."""
    line = Line()
    task = msgspec.json.decode(Path(path).read_bytes(), type=Task)
    end_with(task.parent)
    be_modest(task)
    work(task, line)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
