"""Drawings of a plan or a program that an earlier version made, or that are lost: made anew in a process of their own."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import threading
from pathlib import Path

from cellctl.planning.track import INDEX, track_beside, write_track
from cellctl.planning.view import WHOLE, write_layer, write_overview

TIME_LIMIT_S = 900.0
_LOCK = threading.Lock()


class RedrawError(Exception):
    """The drawing could not be made; one line."""


def redraw_plan(plan: Path, folder: Path) -> None:
    """Write the view folder of a plan file, over what is there of an older version. Raises PlannerError, OSError."""
    from planner.files import read_plan

    read = read_plan(plan)
    folder.mkdir(parents=True, exist_ok=True)
    for number, layer in enumerate(read.layers):
        write_layer(layer, number, folder)
    write_overview(read, folder)
    for old in folder.glob("layer_*.json"):
        old.unlink(missing_ok=True)


def redraw_program(program: Path, folder: Path) -> None:
    """Write the track of a program's directory. Raises PlannerError, OSError."""
    from planner.files import read_program

    write_track(read_program(program), folder)


def view_of(plan: Path, folder: Path) -> Path:
    """The view folder of a plan, as this version draws it. Blocks while it is made. Raises RedrawError."""
    return _there(folder / WHOLE, "plan", plan, folder)


def track_of(program: Path) -> Path:
    """The track folder of a program's directory. Blocks while it is made. Raises RedrawError."""
    folder = track_beside(program)
    return _there(folder / INDEX, "program", program, folder)


def _there(last: Path, kind: str, source: Path, folder: Path) -> Path:
    if last.is_file():
        return folder
    with _LOCK:
        if not last.is_file():
            _run(kind, source, folder)
    return folder


def _run(kind: str, source: Path, folder: Path) -> None:
    command = [sys.executable, "-m", "cellctl.planning.redraw", kind, str(source), str(folder)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIME_LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        raise RedrawError(f"the drawing of the {kind} took more than {TIME_LIMIT_S:g} s") from None
    if done.returncode:
        said = (done.stdout.strip() or done.stderr.strip() or "it ended without a word").splitlines()[-1]
        raise RedrawError(f"the drawing of the {kind} could not be made: {said}")


def main(words: list[str] | None = None) -> int:
    """`python -m cellctl.planning.redraw plan|program SOURCE FOLDER`: exit 2 with one line if it cannot be made."""
    from planner.errors import PlannerError

    parser = argparse.ArgumentParser(prog="python -m cellctl.planning.redraw")
    parser.add_argument("kind", choices=("plan", "program"))
    parser.add_argument("source", type=Path)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args(words)
    os.nice(10)
    try:
        (redraw_plan if given.kind == "plan" else redraw_program)(given.source, given.folder)
    except (PlannerError, OSError) as error:
        print(error)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
