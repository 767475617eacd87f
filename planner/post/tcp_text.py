"""Numbers, words and lines of programs in workpiece coordinates, for many blocks at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.post.tcp_blocks import Blocks, Say, What
from planner.program import LINE_DTYPE

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

Rows = NDArray[np.void]
Texts = list[str]
"""One text per block; empty where the block has no such word."""


def numbers(values: Floats, decimals: int, point: str = "") -> Texts:
    """Texts of (n,) numbers, rounded, as short as they go, without exponents; point : what whole numbers end with ("." or nothing)."""
    rounded = np.round(values, decimals) + 0.0
    texts = [repr(value) for value in rounded.tolist()]
    whole = rounded == np.rint(rounded)
    for i in np.flatnonzero(whole).tolist():
        texts[i] = texts[i][:-2] + point
    for i in np.flatnonzero((np.abs(rounded) < 1e-3) & ~whole).tolist():
        texts[i] = f"{rounded[i]:.{decimals}f}".rstrip("0")
    return texts


def words(letter: str, values: Floats, decimals: int, says: Bools, point: str = "", plus: bool = False) -> Texts:
    """Words of those blocks that say them; plus : positive numbers carry their sign."""
    found = [""] * len(values)
    rows = np.flatnonzero(says)
    texts = numbers(values[rows], decimals, point)
    for i, text in zip(rows.tolist(), texts, strict=True):
        found[i] = f"{letter}+{text}" if plus and text[0] != "-" else letter + text
    return found


def changed(values: Floats, decimals: int, applies: Bools, anew: Bools) -> Bools:
    """(n,) bool: blocks whose number differs from that of the last block it applied to, or that have to say it anyway.

    values : (n,) or (n, k) float   applies : (n,) bool, blocks that may say it   anew : (n,) bool
    """
    rows = np.flatnonzero(applies)
    result = np.zeros(len(values), dtype=np.bool_)
    if rows.size == 0:
        return result
    rounded = np.round(values[rows].reshape(len(rows), -1), decimals)
    differs = np.append(True, np.any(np.diff(rounded, axis=0) != 0.0, axis=1))
    told_anew = np.cumsum(anew)[rows]
    result[rows] = differs | np.append(True, np.diff(told_anew) > 0)
    return result


def joined(columns: Sequence[Texts], between: str = " ") -> Texts:
    """The words of each block side by side."""
    return [between.join(filter(None, row)) for row in zip(*columns, strict=True)]


@dataclass(frozen=True)
class Written:
    """Lines of a program and what each stands for.

    table : (lines,) LINE_DTYPE   items : (lines,) int, item of the tape
    """

    lines: tuple[str, ...]
    table: NDArray[np.void]
    items: Ints


def laid_out(
    blocks: Blocks,
    texts: Sequence[str | list[str]],
    number: Callable[[Texts], Texts],
    build_from_workpiece: Callable[[Floats], Floats],
    rotation: Floats,
) -> Written:
    """The lines of all blocks, numbered, and their table; of a block of several lines the last one moves. One text more closes the program.

    rotation : (3, 3) float, workpiece from build, for the axes
    """
    rows = blocks.rows if len(texts) == len(blocks.rows) else np.append(blocks.rows, _last(blocks.rows))
    lines: Texts = []
    counts = np.ones(len(rows), dtype=np.int64)
    for i, text in enumerate(texts):
        if isinstance(text, str) and text:
            lines.append(text)
        else:  # of a block that says nothing new there is no line
            lines += text
            counts[i] = len(text)
    of_line = np.repeat(np.arange(len(rows)), counts)
    is_last = np.append(of_line[1:] != of_line[:-1], True) if len(of_line) else np.zeros(0, dtype=np.bool_)
    table = np.zeros(len(lines), LINE_DTYPE)
    table["n"] = np.arange(1, len(lines) + 1)
    for name in ("kind", "layer", "operation", "pass_", "arc_start_mm", "arc_end_mm"):
        table[name] = rows[name][of_line]
    table["arc_end_mm"] = np.where(is_last, table["arc_end_mm"], table["arc_start_mm"])
    ends = np.cumsum(rows["time_s"])
    starts = ends - rows["time_s"]
    table["time_start_s"] = starts[of_line]
    table["time_end_s"] = np.where(is_last, ends[of_line], starts[of_line])
    table["tip_end"] = build_from_workpiece(rows["tip_end"])[of_line]
    table["axis_end"] = (rows["axis_end"] @ rotation)[of_line]
    table["joints_end"] = rows["joints"][of_line]
    return Written(tuple(number(lines)), table, rows["item"][of_line].astype(np.int64))


def _last(rows: Rows) -> Rows:
    """A row that stands where the last one ended."""
    row = rows[-1:].copy()
    row["time_s"], row["arc_start_mm"] = 0.0, row["arc_end_mm"]
    return row


def speaks_anew(blocks: Blocks) -> Bools:
    """(n,) bool: commands behind which every word is said again: the beginning and changes of the tool."""
    index = blocks.rows["command"]
    changes = np.array([command.say in (Say.TOOL, Say.BEGIN) for command in blocks.commands], dtype=np.bool_)
    return np.asarray((index >= 0) & changes[index])


def machine_edges(blocks: Blocks) -> tuple[Bools, Bools]:
    """(n,) bool each: blocks before which the transformation has to go off, and blocks after which it has to come on.

    It is off for machine moves, tool changes and the end, and comes on as soon as the machine stands where the next move of the tip begins.
    """
    what, index = blocks.rows["what"], blocks.rows["command"]
    stands = np.array([command.say in (Say.TOOL, Say.END) for command in blocks.commands], dtype=np.bool_)
    is_machine = (what == What.MACHINE) | ((index >= 0) & stands[index])
    marks = np.flatnonzero((what != What.COMMAND) | is_machine)
    off, on = np.zeros(len(what), dtype=np.bool_), np.zeros(len(what), dtype=np.bool_)
    here = is_machine[marks]
    off[marks[here & ~np.append(True, here[:-1])]] = True
    on[marks[here & ~np.append(here[1:], True)]] = True
    return off, on
