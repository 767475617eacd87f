"""A Program whose form is mapped into memory: a start of a moment, constant memory and one descriptor, however many lines it has."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast, overload

import numpy as np
from numpy.typing import NDArray

from cellctl.cell import program_form as written
from cellctl.cell.arrays_file import MappedFile, block_sums
from cellctl.cell.first_cuts import spindle_speeds
from cellctl.cell.program_form import program_timeline
from cellctl.cell.program_text import mounted_tools
from cellctl.domain.timeline import MotionLimits, Timeline
from config.cell import Cell
from planner.errors import FileFormatError
from planner.program import Continues, ProcessWindow, Program


class MappedLines(Sequence[str]):
    """The lines of a text that is mapped: each is made when it is asked for."""

    def __init__(self, mapped: MappedFile, starts: NDArray[np.int64]) -> None:
        self._starts = starts
        self._text = mapped.bytes

    def __len__(self) -> int:
        return len(self._starts) - 1

    @property
    def sizes(self) -> NDArray[np.int64]:
        """(n,) bytes of each line, its newline included."""
        return np.diff(self._starts)

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
        body = form / written.BODY
        if body.stat().st_size != document["size"] or block_sums(body) != document["sums"]:
            raise FileFormatError(f"{body}: damaged (its checksums are not those in {written.INDEX})", "post the plan again")
        return _opened(body, document)
    except FileNotFoundError:
        return None
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise FileFormatError(f"{form}: cannot be read: {error}", "post the plan again") from None


def arrays_of_form(form: Path, names: Sequence[str]) -> list[NDArray[Any]]:
    """Some arrays of a form, by their names there, not verified. Raises OSError, ValueError, LookupError for what is none of this version."""
    places = json.loads((form / written.INDEX).read_text(encoding="utf-8"))["places"]
    mapped = MappedFile(form / written.BODY)
    return [mapped.array(places[name]) for name in names]


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


def _opened(body: Path, document: dict[str, Any]) -> OpenedProgram:
    mapped, places = MappedFile(body), document["places"]
    values = document["program"]
    for name in written.MATRICES:
        values[name] = np.array(values[name], dtype=np.float64)
    for name in ("axis_letters", "tools"):
        values[name] = tuple(values[name])
    if values.get("continues"):
        values["continues"] = Continues(**values["continues"])
    if values.get("window"):
        values["window"] = ProcessWindow.from_document(values["window"])
    columns: dict[str, Any] = {
        field.name: mapped.array(places[written.TIMELINE + field.name])
        for field in dataclasses.fields(Timeline)
        if written.TIMELINE + field.name in places
    }
    first, second = document["timeline"]["plane"]
    tables: dict[str, Any] = {name: mapped.array(places[name]) for name in written.TABLES}
    lines = MappedLines(mapped, mapped.array(places[written.STARTS]))
    return OpenedProgram(
        lines=cast("tuple[str, ...]", lines),
        **tables,
        **values,
        timeline=Timeline(**columns, plane=(first, second)),
        mounted=tuple((int(line), int(tool)) for line, tool in mapped.array(places[written.TOOLS])),
        speeds=tuple((int(line), float(rpm)) for line, rpm in document["speeds"]),
    )
