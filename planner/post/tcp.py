"""Programs in workpiece coordinates: the entry that posting calls, for every five-axis control."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell, Placement
from config.macros import VALUES, Macros
from planner.kinematics.chain import Chain
from planner.plan import Operation
from planner.post import apt, fanuc, heidenhain, read_apt, read_fanuc, read_heidenhain, read_siemens, siemens
from planner.post.assemble import Assembly
from planner.post.clock import item_times
from planner.post.header import About, header_texts
from planner.post.macros import MacroBook
from planner.post.reading import Reading, Signals
from planner.post.reread import RereadReport
from planner.post.tape import Tape, schedule_of
from planner.post.tcp_build import Builder
from planner.post.tcp_check import compare
from planner.post.tcp_job import Job, frame_of
from planner.post.tcp_pass import Control, Frame
from planner.post.tcp_text import laid_out
from planner.post.tcp_words import SMOOTHING_SHARE, Vocabulary, nurbs_remark, output_remarks, plain
from planner.program import Program

if TYPE_CHECKING:
    from planner.post.sequence import Sequencer

Floats = NDArray[np.float64]

WRITERS: Mapping[str, ModuleType] = {"siemens": siemens, "fanuc": fanuc, "heidenhain": heidenhain, "apt": apt}
"""Five-axis controls: name of the dialect -> its words."""
READERS: Mapping[str, Callable[[Sequence[str], Sequence[str], Signals], Reading]] = {
    "siemens": read_siemens.read,
    "fanuc": read_fanuc.read,
    "heidenhain": read_heidenhain.read,
    "apt": read_apt.read,
}
"""Their readers, which share nothing with the writers."""

_LEAST_DWELL_S = 0.01


def write_tcp(dialect: str, sequencer: Sequencer, placement: Placement, about: About) -> Assembly:
    """Text and tables of the sequencer's tape for a five-axis control, in workpiece coordinates.

    sequencer : after run(): its tape, the operations as posted, cell, chain and placed matrix count   about : for the header
    Raises PostError where the tape says what the control has no word for, or a work offset turns a rotary axis.
    """
    writer, cell, tape, plan = WRITERS[dialect], sequencer.cell, sequencer.tape, about.plan
    work_offset = np.array([placement.work_offset.get(letter, 0.0) for letter in cell.letters])
    frame = frame_of(sequencer.placed, cell, work_offset)
    times = tape_times(tape, cell)
    dwells = dwell_times(tape, times)
    job = Job(tape, sequencer.posted, cell, sequencer.chain, sequencer.placed, frame, times, dwells)
    control: Control = writer.CONTROL.fitted(cell.cnc.takes_nurbs)
    blocks = Builder(job, control).build()
    remarks = [*about.remarks, *nurbs_remark(writer.CONTROL, control), *output_remarks(macros_of(writer, cell))]
    vocabulary = _vocabulary(writer, sequencer, replace(about, remarks=remarks), frame, float(times.sum()))
    written = laid_out(blocks, writer.texts(blocks, vocabulary), writer.numbered, frame.back, frame.rotation)
    items = np.maximum.accumulate(written.items)
    line_of_item = np.searchsorted(items, np.arange(tape.count)).clip(0, len(items) - 1)
    starts = np.searchsorted(np.maximum.accumulate(written.table["layer"]), np.arange(len(plan.layers)))
    layer_starts = np.append(starts, len(items)).astype(np.int64)
    duration_s = float(written.table["time_end_s"][-1])
    return Assembly(written.lines, written.table, schedule_of(tape.entries, line_of_item), layer_starts, duration_s)


def _vocabulary(writer: ModuleType, sequencer: Sequencer, about: About, frame: Frame, duration_s: float) -> Vocabulary:
    cell = sequencer.cell
    low, high = about.plan.bounds
    corners = frame.points(np.array(list(itertools.product(*zip(low.tolist(), high.tolist(), strict=True)))))
    joints = sequencer.tape.items()["joints"]
    path_mm, axis_deg = SMOOTHING_SHARE * cell.chord_tolerance_mm, SMOOTHING_SHARE * cell.axis_tolerance_deg
    values = {"path_mm": plain(path_mm), "merge_mm": plain(path_mm), "axis_deg": plain(axis_deg)}
    return Vocabulary(
        book=MacroBook(cell, writer.NAME, writer.MACROS, values),
        header=header_texts(about, joints.min(axis=0), joints.max(axis=0), duration_s),
        letters=cell.letters,
        output=1 + (cell.cnc.laser_gate_output or 0),
        rapid_mm_min=60.0 * min(axis.max_velocity for axis in cell.axes if axis.kind == "linear"),
        name=program_name(about.plan.part_name),
        box_mm=(tuple(corners.min(axis=0).tolist()), tuple(corners.max(axis=0).tolist())),
        smoothing_mm=path_mm,
        smoothing_deg=axis_deg,
        rotary=tuple(k for k, axis in enumerate(cell.axes) if axis.kind == "rotary"),
        point=writer.POINT,
    )


def read_back(program: Program, posted: Mapping[int, Operation], cell: Cell, chain: Chain) -> RereadReport:
    """The program's text read by the dialect's own reader and compared with the Plan as posted.

    posted : operations by number, with the axes that they are run with (`Sequencer.posted`)   chain : that of the placement
    Raises PostError if the text cannot be read.
    """
    writer = WRITERS[program.dialect]
    signals = Signals(macros_of(writer, cell), 1 + (cell.cnc.laser_gate_output or 0))
    reading = READERS[program.dialect](program.lines, cell.letters, signals)
    return compare(reading, program, posted, cell, chain)


def macros_of(writer: ModuleType, cell: Cell) -> dict[str, tuple[str, ...]]:
    """Lines of every macro: the cell file's, or else the dialect's own."""
    given, own = cell.macros.get(writer.NAME, Macros()), writer.MACROS
    return {name: getattr(own, name) or () if getattr(given, name) is None else getattr(given, name) for name in VALUES}


def program_name(part: str) -> str:
    """Letters, digits and underscores, 1 to 24 of them, beginning with a letter."""
    kept = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in part).upper()[:24]
    return kept if kept[:1].isalpha() else f"P{kept}"[:24]


def tape_times(tape: Tape, cell: Cell) -> Floats:
    """(items,) s: times of the items as the cell's axes take them, dwells as 0: those that the levels follow."""
    waits = np.array(sorted({entry.item for entry in tape.entries if entry.is_barrier}), dtype=np.int64)
    return item_times(tape.items(), cell, waits)


def dwell_times(tape: Tape, times: Floats) -> dict[int, float]:
    """Item -> s, of the dwells that have something to wait for; the times (items,) of these items are set to it."""
    starts = np.append(0.0, np.cumsum(times))
    waits: list[tuple[int, float]] = []
    found = {}
    for item in sorted(tape.dwells):
        least_s, since = tape.dwells[item]
        waited = sum(rest for at, rest in waits if since <= at < item)
        rest = float(np.ceil(100.0 * (least_s - (starts[item] - starts[since] + waited)))) / 100.0
        if rest >= _LEAST_DWELL_S:
            waits.append((item, rest))
            found[item] = rest
    for item, rest in found.items():
        times[item] = rest
    return found
