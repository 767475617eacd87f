"""A cell process with a handicap: `python -m tests.bench.cell_variant [--slow-commit S] [--ordinary] -- OPTIONS of cellctl.cell`.

--slow-commit : every commit of the journal takes so long, as on a slow disk (its thread sleeps where it would wait for fsync)
--ordinary : as a user to whom SCHED_FIFO is refused
"""

from __future__ import annotations

import argparse
import os
import sys
import time

from cellctl.cell import __main__ as cell_process
from cellctl.cell import tick
from cellctl.cell.record import Journal


def main(words: list[str]) -> int:
    """Handicap, then run."""
    split = words.index("--")
    parser = argparse.ArgumentParser()
    parser.add_argument("--slow-commit", type=float, default=0.0)
    parser.add_argument("--ordinary", action="store_true")
    given = parser.parse_args(words[:split])
    if given.ordinary:
        tick.os.sched_setscheduler = _refuse  # type: ignore[attr-defined]
    if given.slow_commit:
        commit = Journal.commit

        def slowly(journal: Journal) -> None:
            commit(journal)
            time.sleep(given.slow_commit)

        setattr(Journal, "commit", slowly)  # noqa: B010
    return cell_process.main(words[split + 1 :])


def _refuse(*_: object) -> None:
    raise PermissionError(1, os.strerror(1))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
