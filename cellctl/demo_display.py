"""How the demo shows a job: bars and figures on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from cellctl.cli.output import duration

if TYPE_CHECKING:
    from cellctl.client_documents import Job

LINE_PERIOD_S = 5.0  # between plain lines of the same stage
STAGES = {
    "submitted": "waiting for a worker",
    "planning": "planning",
    "posting": "posting",
    "proving": "proving in the twin",
    "queued": "starting",
    "running": "building",
    "held": "HELD",
}
Document = dict[str, Any]


def figures(snapshot: Document | None) -> str:
    """Layer, operation, line, power, powder and remaining time in one line."""
    if snapshot is None or snapshot["job"] is None:
        return ""
    job, lines = snapshot["job"], snapshot["lines"]
    operation = str(job["operation_kind"]).replace("_", " ")
    return "  ".join(
        [
            f"layer {job['layer'] + 1}/{job['layers']}",
            f"{operation or 'link':16}",
            f"line {lines['executed']}/{lines['total']}",
            f"laser {snapshot['laser']['power_readback_w']:4.0f}/{snapshot['laser']['power_setpoint_w']:.0f} W",
            f"powder {snapshot['feeder']['rate_readback_g_min']:4.1f}/{snapshot['feeder']['rate_setpoint_g_min']:.1f} g/min",
            f"remaining {duration(max(job['remaining_s'], 0.0))} of process time",
            str(snapshot["waiting"]),
        ]
    ).rstrip()


class Display:
    """Use as a context; `show` as often as there is news, `say` for lines that stay. quiet : nothing at all"""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._bar: Any = None
        self._task: Any = None
        self._stage = ""
        self._told_at = 0.0

    def __enter__(self) -> Self:
        if not self._quiet and sys.stdout.isatty():
            from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

            columns = (
                TextColumn("{task.description:22}", markup=False),
                BarColumn(30),
                TaskProgressColumn(),
                TextColumn("{task.fields[figures]}", markup=False),
            )
            self._bar = Progress(*columns, expand=False)
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    def say(self, text: str) -> None:
        """A line that stays."""
        if self._quiet:
            return
        if self._bar is not None:
            self._bar.console.print(text, markup=False, highlight=False)
        else:
            sys.stdout.write(text + "\n")
            sys.stdout.flush()

    def show(self, job: Job, snapshot: Document | None) -> None:
        """Where the job stands."""
        if self._quiet or job["state"] not in STAGES:
            return
        name, text = STAGES[job["state"]], figures(snapshot) or str(job["why"])
        is_new, self._stage = name != self._stage, name
        if self._bar is not None:
            if is_new:
                self._task = self._bar.add_task(name, total=1.0, figures="")
            self._bar.update(self._task, completed=job["progress"], figures=text)
        elif is_new or time.monotonic() - self._told_at > LINE_PERIOD_S:
            self._told_at = time.monotonic()
            self.say(f"{name:22} {100 * job['progress']:3.0f} %  {text}".rstrip())
