"""A Program whose form is mapped into memory: a start of a moment and constant memory, however many lines it has."""

from __future__ import annotations

import dataclasses
import json
import mmap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast, overload

import numpy as np
from numpy.typing import NDArray

from cellctl.cell import program_form as written
from cellctl.cell.first_cuts import spindle_speeds
from cellctl.cell.program_form import file_crc, program_timeline
from cellctl.cell.program_text import mounted_tools
from cellctl.domain.timeline import MotionLimits, Timeline
from config.cell import Cell
from planner.errors import FileFormatError
from planner.program import Continues, Program


class MappedLines(Sequence[str]):
    """The lines of a text that is mapped: each is made when it is asked for."""

    def __init__(self, text: Path, starts: NDArray[np.int64]) -> None:
        self._starts = starts
        with text.open("rb") as file:
            self._text: mmap.mmap | bytes = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if len(self) else b""

    def __len__(self) -> int:
        return len(self._starts) - 1

    @overload
    def __getitem__(self, index: int) -> str: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[str, ...]: ...

    def __getitem__(self, index: int | slice) -> str | tuple[str, ...]:
        """A line without its newline, or several."""
        if isinstance(index, slice):
            return tuple(self[k] for k in range(*index.indices(len(self))))
        if index < 0:
            index += len(self)
        if not 0 <= index < len(self):
            raise IndexError(f"line {index} of {len(self)}")
        return self._text[int(self._starts[index]) : int(self._starts[index + 1]) - 1].decode("ascii")


@dataclass(frozen=True)
class OpenedProgram(Program):
    """A Program on its form.

    timeline : but for how the control accelerates; mounted : (line index, tool) of every tool change; speeds : as of spindle_speeds
    """

    timeline: Timeline | None = None
    mounted: tuple[tuple[int, int], ...] = ()
    speeds: tuple[tuple[int, float], ...] = ()


def open_form(form: Path, program_sha256: str) -> OpenedProgram | None:
    """The Program on a form that is verified; None if there is none for this program, or of another version.

    Raises FileFormatError for a damaged one.
    """
    try:
        document = json.loads((form / written.INDEX).read_text(encoding="utf-8"))
        if document["form"] != written.FORM or document["program_sha256"] != program_sha256:
            return None
        for name, (size, crc) in document["sums"].items():
            path = form / name
            if path.stat().st_size != size or file_crc(path) != crc:
                raise FileFormatError(f"{path}: damaged (its checksum is not the one in {written.INDEX})", "post the plan again")
        return _opened(form, document)
    except FileNotFoundError:
        return None
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise FileFormatError(f"{form}: cannot be read: {error}", "post the plan again") from None


def timeline_of(program: Program, cell: Cell) -> Timeline:
    """The Timeline of a Program on this cell: the form's, or computed here."""
    known = program.timeline if isinstance(program, OpenedProgram) else None
    limits = MotionLimits(np.array([axis.max_acceleration for axis in cell.axes]), cell.cnc.junction_deviation_mm)
    return dataclasses.replace(known if known is not None else program_timeline(program, cell), limits=limits)


def tools_of(program: Program) -> list[tuple[int, int]]:
    """(line index, tool number) of every tool change."""
    return list(program.mounted) if isinstance(program, OpenedProgram) else mounted_tools(program)


def speeds_of(program: Program) -> list[tuple[int, float]]:
    """(line index, rpm from there on) wherever the spindle is set going or stopped."""
    return list(program.speeds) if isinstance(program, OpenedProgram) else spindle_speeds(program)


def _mapped(path: Path) -> NDArray[Any]:
    return np.asarray(np.load(path, mmap_mode="r"))


def _opened(form: Path, document: dict[str, Any]) -> OpenedProgram:
    values = document["program"]
    for name in written.MATRICES:
        values[name] = np.array(values[name], dtype=np.float64)
    for name in ("axis_letters", "tools"):
        values[name] = tuple(values[name])
    if values.get("continues"):
        values["continues"] = Continues(**values["continues"])
    columns: dict[str, Any] = {
        field.name: _mapped(path)
        for field in dataclasses.fields(Timeline)
        if (path := form / f"{written.TIMELINE}{field.name}.npy").exists()
    }
    first, second = document["timeline"]["plane"]
    tables: dict[str, Any] = {name: _mapped(form / f"{name}.npy") for name in written.TABLES}
    lines = MappedLines(form / written.TEXT, _mapped(form / written.STARTS))
    opened = OpenedProgram(
        lines=cast("tuple[str, ...]", lines),
        **tables,
        **values,
        timeline=Timeline(**columns, plane=(first, second)),
        mounted=tuple((int(line), int(tool)) for line, tool in _mapped(form / written.TOOLS)),
    )
    return dataclasses.replace(opened, speeds=tuple(spindle_speeds(opened)))  # reads every row: here, and not in the event loop
