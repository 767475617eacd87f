"""Tape to Program: rounding, dwells, predicted times, line table, schedule and text."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell
from planner.kinematics.chain import Chain, Floats
from planner.kinematics.timing import predicted_times
from planner.post import grblhal
from planner.post.tape import Move, Tape, schedule_of
from planner.program import LINE_DTYPE

Ints = NDArray[np.int64]

_LEAST_DWELL_S = 0.01


@dataclass(frozen=True)
class Assembly:
    """Lines, table, schedule and duration of a Program."""

    lines: tuple[str, ...]
    table: NDArray[np.void]
    schedule: NDArray[np.void]
    layer_starts: Ints
    duration_s: float


def assemble(tape: Tape, cell: Cell, chain: Chain, placed: Floats, work_offset: Floats, layer_count: int) -> Assembly:
    """Text and tables of a tape that began at the cell's home position.

    placed : (4, 4) float, table from build   work_offset : (5,) float
    Moves that rounding leaves without motion become part of the next line of their pass; dwells that have nothing to wait for are left out.
    """
    words = grblhal.Words.of(cell, work_offset)
    items, item_index = _moving(tape.items(), words)
    texts = _texts(tape, items)
    start = np.array([axis.home for axis in cell.axes])
    acceleration = np.array([axis.max_acceleration for axis in cell.axes])
    if tape.dwells:
        times = _times(items, start, acceleration)
        is_kept = _dwell(tape, items, item_index, times, texts)
        items, item_index = items[is_kept], item_index[is_kept]
        texts = [text for text, kept in zip(texts, is_kept.tolist(), strict=True) if kept]
    times = _times(items, start, acceleration)
    counts = np.vstack([words.counts(start[None, :]), words.counts(items["joints"])])
    is_rotary = np.array([axis.kind == "rotary" for axis in cell.axes])
    by_time = grblhal.inverse_time(counts, is_rotary, items["move"], items["chunk"].astype(np.int64))
    script = grblhal.Script(counts, items["move"], by_time, items["time_s"], items["way"], items["named"], texts)
    lines = grblhal.write(words, script, cell.cnc.line_length_max)
    table = _table(items, times, cell, chain, placed)
    line_of_item = np.searchsorted(item_index, np.arange(tape.count)).clip(0, len(items) - 1)
    starts = np.searchsorted(np.maximum.accumulate(items["layer"]), np.arange(layer_count))
    layer_starts = np.append(starts, len(items)).astype(np.int64)
    return Assembly(lines, table, schedule_of(tape.entries, line_of_item), layer_starts, float(times.sum()))


def _moving(items: NDArray[np.void], words: grblhal.Words) -> tuple[NDArray[np.void], Ints]:
    """Items with rounded joints, without moves that do not move; and which item each was."""
    counts = words.counts(items["joints"])
    items = items.copy()
    items["joints"] = words.joints(counts)
    moves = np.append(True, np.any(np.diff(counts, axis=0) != 0, axis=1))
    is_kept = moves | (items["move"] == Move.NONE) | (items["named"] != 0)
    dropped = np.flatnonzero(~is_kept)
    for i in dropped:  # the line before it, of the same pass, stands for its arc length too
        before = i - 1
        while before >= 0 and not is_kept[before]:
            before -= 1
        if before >= 0 and items[before]["chunk"] == items[i]["chunk"]:
            items[before]["arc_end_mm"] = items[i]["arc_end_mm"]
            items[before]["time_s"] += items[i]["time_s"]
            items[before]["way"] += items[i]["way"]
        elif i + 1 < len(items) and items[i + 1]["chunk"] == items[i]["chunk"]:
            items[i + 1]["arc_start_mm"] = items[i]["arc_start_mm"]
    return items[is_kept], np.flatnonzero(is_kept)


def _texts(tape: Tape, items: NDArray[np.void]) -> list[str | None]:
    return [tape.commands[index] if index >= 0 else None for index in items["command"].tolist()]


def _times(items: NDArray[np.void], start: Floats, acceleration: Floats) -> Floats:
    steps = np.diff(np.vstack([start, items["joints"]]), axis=0)
    stops = items["stop"] | np.append(False, items["stop"][:-1])
    return predicted_times(steps, items["time_s"], _before_motion(stops, items["move"]), acceleration)


def _before_motion(stops: NDArray[np.bool_], move: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Standing carried on over lines without motion to the next motion."""
    result = stops.copy()
    for i in np.flatnonzero(stops & (move == Move.NONE)):
        if i + 1 < len(result):
            result[i + 1] = True
    return result


def _dwell(
    tape: Tape, items: NDArray[np.void], item_index: Ints, times: Floats, texts: list[str | None]
) -> NDArray[np.bool_]:
    """Fill in the dwells' text and time; (n,) bool: all items but the dwells that have nothing to wait for."""
    is_kept = np.ones(len(items), dtype=np.bool_)
    starts = np.append(0.0, np.cumsum(times))
    waited = 0.0
    waited_before: dict[int, float] = {}
    marks = sorted({since for _, since in tape.dwells.values()} | set(tape.dwells))
    for item in marks:
        line = int(np.searchsorted(item_index, item))
        waited_before[item] = waited
        if item not in tape.dwells:
            continue
        least_s, since = tape.dwells[item]
        begun = starts[int(np.searchsorted(item_index, since))] + waited_before[since]
        rest = least_s - (starts[line] + waited - begun)
        if rest < _LEAST_DWELL_S:
            is_kept[line] = False
            continue
        hundredths = int(np.ceil(rest * 100.0))
        texts[line] = f"G4 P{grblhal.decimal(hundredths, 2)}"
        items["time_s"][line] = hundredths / 100.0
        waited += hundredths / 100.0
    return is_kept


def _table(items: NDArray[np.void], times: Floats, cell: Cell, chain: Chain, placed: Floats) -> NDArray[np.void]:
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
