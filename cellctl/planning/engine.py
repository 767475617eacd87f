"""Who carries tasks out for the planning queue: processes of this machine, or a pool of machines. The seam between the queue and its hands."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from cellctl.planning.task import Task

Progress = Callable[[str, float], None]
Waits = Callable[[str], None]


def unheard(_why: str) -> None:
    """Nobody asks why a task waits."""


class Engine(Protocol):
    """Carries out tasks of `cellctl.planning.stages`. The same task gives the same files and the same summary whoever carries it out."""

    @property
    def places(self) -> int:
        """How many tasks it takes at once; 1 or more."""

    async def run(self, task: Task, progress: Progress, waits: Waits = unheard) -> dict[str, Any]:
        """Carry a task out, its files in the task's folder; its summary. A cancelled call ends the work, wherever it is done.

        progress : told the stage and the share of it done, at most ten times a second
        waits : told why nothing is done yet, "" once it goes on
        Raises WorkerError.
        """
