"""Tape to Program: rounding, dwells, what the dialect and the macros add, predicted times, line table, schedule and text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell
from planner.kinematics.chain import Chain, Floats
from planner.plan import Operation
from planner.post.blocks import Script, inverse_time
from planner.post.clock import item_times
from planner.post.dialect import JointDialect
from planner.post.draft import Draft
from planner.post.header import About, header_texts, operation_text, remark
from planner.post.macros import MacroBook
from planner.post.splines import Splines
from planner.post.tape import Entry, Tape, schedule_of
from planner.post.words import Words, decimal
from planner.program import LINE_DTYPE, Channel

Ints = NDArray[np.int64]

_LEAST_DWELL_S = 0.01
_DEPOSIT = 1  # mode in which the laser may emit
_POWER_DECIMALS = 2  # of a watt


@dataclass(frozen=True)
class Assembly:
    """Lines, table, schedule and duration of a Program."""

    lines: tuple[str, ...]
    table: NDArray[np.void]
    schedule: NDArray[np.void]
    layer_starts: Ints
    duration_s: float


@dataclass(frozen=True)
class Setting:
    """What a tape is assembled for.

    cell : fitted to the dialect   placed : (4, 4) float, table from build   work_offset : (5,) float
    posted : the operations as they are run, by number
    """

    cell: Cell
    chain: Chain
    placed: Floats
    work_offset: Floats
    about: About
    posted: Mapping[int, Operation]
    dialect: JointDialect


def assemble(tape: Tape, setting: Setting) -> Assembly:
    """Text and tables of a tape that began at the cell's home position.

    Moves that rounding leaves without motion become part of the next line of their pass; dwells that have nothing to wait for are left out.
    """
    cell = setting.cell
    words = Words.of(cell, setting.work_offset)
    draft = Draft.of(tape, words)
    start = np.array([axis.home for axis in cell.axes])
    if tape.dwells:
        draft = _dwelt(tape, draft, _times(draft, setting, tape))
    entries = tape.entries
    if setting.dialect.has_splines:
        draft = _splined(draft, words, setting, start, entries)
    if cell.cnc.power_output is not None:
        entries = _streamed_power(draft, entries, cell.cnc.power_output)
    _remark_operations(draft, setting)
    header = _header(draft, setting, 0.0)
    for text in header:
        draft.add_first(text)
    book = MacroBook(cell, setting.dialect.NAME, setting.dialect.MACROS, setting.dialect.values(cell))
    draft = draft.completed(book)
    items = draft.items
    times = _times(draft, setting, tape)
    for line, text in enumerate(_header(draft, setting, float(times.sum()))):
        draft.texts[line] = text
    lines = _lines(draft, words, setting, start)
    layers = len(setting.about.plan.layers)
    starts = np.searchsorted(np.maximum.accumulate(items["layer"]), np.arange(layers))
    layer_starts = np.append(starts, len(items)).astype(np.int64)
    schedule = schedule_of(entries, draft.line_of_item(tape.count))
    return Assembly(lines, line_table(items, times, setting.placed, setting.chain, setting.cell), schedule, layer_starts, float(times.sum()))


def _splined(draft: Draft, words: Words, setting: Setting, start: Floats, entries: list[Entry]) -> Draft:
    cell = setting.cell
    tips = {tool.number: np.array(tool.tip_mm) for tool in cell.tools}
    found = Splines(draft, words, setting.chain, setting.posted, setting.placed, tips, cell.chord_tolerance_mm)
    return found.applied(start, entries)


def _lines(draft: Draft, words: Words, setting: Setting, start: Floats) -> tuple[str, ...]:
    items = draft.items
    counts = np.vstack([words.counts(start[None, :]), words.counts(items["joints"])])
    is_rotary = np.array([axis.kind == "rotary" for axis in setting.cell.axes])
    by_time = inverse_time(counts, is_rotary, items["move"], items["chunk"].astype(np.int64))
    script = Script(
        counts, items["move"], by_time, items["time_s"], items["way"], items["named"], items["bulge"], draft.texts
    )
    return setting.dialect.write(words, script, setting.cell.cnc.line_length_max)


def _streamed_power(draft: Draft, entries: list[Entry], output: int) -> list[Entry]:
    """The laser's levels said in the text: with the next motion (M67), 0 at once where a mode without laser begins (M68); the other entries."""
    said = ""
    for entry in entries:
        if entry.channel == Channel.LASER_W:
            value = decimal(round(entry.value * 10**_POWER_DECIMALS), _POWER_DECIMALS)
            if value != said:
                draft.add(entry.item, f"M67 E{output} Q{value}")
            said = value
        elif entry.channel == Channel.MODE and entry.value != _DEPOSIT:
            draft.add(entry.item, f"M68 E{output} Q0")
            said = "0"
    return [entry for entry in entries if entry.channel != Channel.LASER_W]


def _header(draft: Draft, setting: Setting, duration_s: float) -> list[str]:
    if not setting.cell.cnc.takes_comments:
        return []
    joints = draft.items["joints"]
    return [remark(text) for text in header_texts(setting.about, joints.min(axis=0), joints.max(axis=0), duration_s)]


def _remark_operations(draft: Draft, setting: Setting) -> None:
    """A line before the first item of each operation."""
    if not setting.cell.cnc.takes_comments:
        return
    number = draft.items["operation"]
    for row in np.flatnonzero((np.diff(number, prepend=-1) != 0) & (number >= 0)):
        operation = setting.posted[int(number[row])]
        tool = int(draft.items["tool"][number == number[row]][-1])
        draft.add_remark(int(row), remark(operation_text(int(number[row]), operation, tool)))


def _times(draft: Draft, setting: Setting, tape: Tape) -> Floats:
    """(n,) s that the rows take, waits at barriers not counted."""
    waits = np.array(sorted({entry.item for entry in tape.entries if entry.is_barrier}), dtype=np.int64)
    return item_times(draft.items, setting.cell, draft.line_of_item(tape.count)[waits])


def _dwelt(tape: Tape, draft: Draft, times: Floats) -> Draft:
    """The draft with the dwells' text and time, without those that have nothing to wait for."""
    is_kept = np.ones(len(draft.items), dtype=np.bool_)
    starts = np.append(0.0, np.cumsum(times))
    waited = 0.0
    waited_before: dict[int, float] = {}
    marks = sorted({since for _, since in tape.dwells.values()} | set(tape.dwells))
    for item in marks:
        line = int(np.searchsorted(draft.keys, item))
        waited_before[item] = waited
        if item not in tape.dwells:
            continue
        least_s, since = tape.dwells[item]
        begun = starts[int(np.searchsorted(draft.keys, since))] + waited_before[since]
        rest = least_s - (starts[line] + waited - begun)
        if rest < _LEAST_DWELL_S:
            is_kept[line] = False
            continue
        hundredths = int(np.ceil(rest * 100.0))
        draft.texts[line] = f"G4 P{decimal(hundredths, 2)}"
        draft.items["time_s"][line] = hundredths / 100.0
        waited += hundredths / 100.0
    return draft.only(is_kept)


def line_table(items: NDArray[np.void], times: Floats, placed: Floats, chain: Chain, cell: Cell) -> NDArray[np.void]:
    """(n,) LINE_DTYPE of a tape's items, (n,) ITEM_DTYPE, a line each.

    times : (n,) s, predicted   placed : (4, 4), build frame to table frame, mm; tips and axes are told in the build frame
    """
    table = np.zeros(len(items), LINE_DTYPE)
    table["n"] = np.arange(1, len(items) + 1)
    for name in ("kind", "layer", "operation", "pass_", "arc_start_mm", "arc_end_mm", "bulge"):
        table[name] = items[name]
    ends = np.cumsum(times)
    table["time_end_s"] = ends
    table["time_start_s"] = np.append(0.0, ends[:-1])[: len(items)]
    table["joints_end"] = items["joints"]
    build_from_table = np.linalg.inv(placed)
    for number in np.unique(items["tool"]):
        of_tool = items["tool"] == number
        tool_tip = next((np.array(tool.tip_mm) for tool in cell.tools if tool.number == number), np.zeros(3))
        tip, axis = chain.forward(items["joints"][of_tool], tool_tip)
        table["tip_end"][of_tool] = tip @ build_from_table[:3, :3].T + build_from_table[:3, 3]
        table["axis_end"][of_tool] = axis @ build_from_table[:3, :3].T
    return table
