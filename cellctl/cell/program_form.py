"""A Program as it is run: its text with the offset of each line, and its tables as arrays, in one file that is mapped; nothing left to compute.

Written where time does not matter (by the planning worker, or by a process of its own before a start), beside the Program's directory.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import itertools
import json
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from cellctl.cell.arc_ways import bows, plane_of
from cellctl.cell.arrays_file import append_array, block_sums
from cellctl.cell.first_cuts import spindle_speeds
from cellctl.cell.program_text import gate_of_lines, mounted_tools
from cellctl.domain.timeline import Timeline
from config.cell import Cell
from planner.program import Program

FORM = 3
INDEX = "form.json"
BODY = "form.bin"
STARTS = "starts"
TOOLS = "tools"
TABLES = ("table", "schedule", "layer_starts")
MATRICES = ("machine_from_build", "build_from_part", "work_offset")
TIMELINE = "timeline_"
BATCH_LINES = 65_536


def form_beside(directory: Path) -> Path:
    """Where the form of a Program's directory lies."""
    return directory.with_name(f"{directory.name}.form")


def write_form(program: Program, cell: Cell, target: Path, program_sha256: str) -> None:
    """Write the form of a Program for the cell that it was posted for; an older one at `target` is replaced in one step.

    program_sha256 : of its program.json. Raises OSError.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    try:
        timeline = program_timeline(program, cell)
        with (folder / BODY).open("wb") as file:
            places = _write_body(program, timeline, file)
        sums = block_sums(folder / BODY)
        document = {"form": FORM, "program_sha256": program_sha256, "size": (folder / BODY).stat().st_size, "sums": sums}
        document |= {"places": places, "program": _scalars(program), "speeds": spindle_speeds(program)}
        document["timeline"] = {"plane": list(timeline.plane)}
        (folder / INDEX).write_text(json.dumps(document, indent=1), encoding="utf-8")
        if target.exists():
            shutil.rmtree(target)
        folder.rename(target)
    finally:
        shutil.rmtree(folder, ignore_errors=True)  # in its place by now, or of no use


def program_timeline(program: Program, cell: Cell) -> Timeline:
    """The Timeline of a Program, but for how the control accelerates."""
    schedule = program.schedule
    barriers = np.unique(schedule["n"][schedule["barrier"] == 1]).astype(np.int64)
    return Timeline.from_table(
        program.table, gate_of_lines(program), bows(program, cell), plane_of(program), None, barriers - 1
    )


def _write_body(program: Program, timeline: Timeline, file: BinaryIO) -> dict[str, int]:
    """The text first, then the arrays; where each of these begins (bytes)."""
    places = {STARTS: append_array(file, _write_text(program.lines, file))}
    for name in TABLES:
        places[name] = append_array(file, getattr(program, name))
    for field in dataclasses.fields(timeline):
        column = getattr(timeline, field.name)
        if isinstance(column, np.ndarray):
            places[TIMELINE + field.name] = append_array(file, column)
    places[TOOLS] = append_array(file, np.array(mounted_tools(program), dtype=np.int64).reshape(-1, 2))
    return places


def _write_text(lines: Any, file: BinaryIO) -> NDArray[np.int64]:
    """(n + 1,) where each line begins, and the end of the last."""
    starts: NDArray[np.int64] = np.zeros(len(lines) + 1, dtype=np.int64)
    place = 0
    for first in range(0, len(lines), BATCH_LINES):
        batch = lines[first : first + BATCH_LINES]
        lengths = np.fromiter((len(line) + 1 for line in batch), dtype=np.int64, count=len(batch))
        starts[first + 1 : first + len(batch) + 1] = place + np.cumsum(lengths)
        place += file.write("".join(itertools.chain.from_iterable((line, "\n") for line in batch)).encode("ascii"))
    return starts


def _scalars(program: Program) -> dict[str, Any]:
    """Everything of a Program that is no table, as JSON."""
    values = {}
    for field in dataclasses.fields(Program):
        value = getattr(program, field.name)
        if field.name in ("lines", *TABLES):
            continue
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            value = dataclasses.asdict(value)
        values[field.name] = value.tolist() if isinstance(value, np.ndarray) else value
    return values


def main(words: list[str] | None = None) -> int:
    """`python -m cellctl.cell.program_form DIRECTORY TARGET --cell FILE`: verify a Program, write its form. 2 with one line if it is none."""
    from config import ConfigError, load_cell
    from planner.errors import PlannerError
    from planner.files import read_program

    parser = argparse.ArgumentParser(prog="python -m cellctl.cell.program_form")
    parser.add_argument("directory", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--cell", required=True)
    given = parser.parse_args(words)
    os.nice(10)
    try:
        program = read_program(given.directory)
        digest = hashlib.sha256((given.directory / "program.json").read_bytes()).hexdigest()
        write_form(program, load_cell(given.cell), given.target, digest)
    except (PlannerError, ConfigError) as error:
        print(json.dumps([error.message, error.hint]), file=sys.stdout)
        return 2
    except (OSError, ValueError) as error:
        print(json.dumps([f"{given.directory}: cannot be made ready: {error}", "look at the disk"]), file=sys.stdout)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
