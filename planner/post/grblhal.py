"""G-code for grblHAL: five axes, G93 where a rotary axis moves, G94 where none does, modal words once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell
from planner.errors import PostError
from planner.kinematics.chain import Floats
from planner.post.tape import Move

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_ROUNDING_SHARE = 0.1
"""Of the chord tolerance: what rounding of one word may move the tip."""
_FEED_DIGITS = 5  # significant; 0.001 % of a speed is below what any drive holds

HEADER = ("G21", "G90", "G94", "G54", "G49")
"""mm, absolute, feed per minute, first work offset, no length offset (tool lengths are in the numbers)."""
END = "M2"


@dataclass(frozen=True)
class Words:
    """How joints become axis words: letters, decimals and work offset, in the order of the cell's axes."""

    letters: tuple[str, ...]
    decimals: Ints
    offset: Floats

    @classmethod
    def of(cls, cell: Cell, work_offset: Floats) -> Words:
        """Fewest decimals whose rounding moves no tip in the build volume by more than a tenth of the chord tolerance."""
        low, high = np.array(cell.build_volume.min_mm), np.array(cell.build_volume.max_mm)
        reach = float(np.linalg.norm(high - low))  # mm per radian
        step = 2.0 * _ROUNDING_SHARE * cell.chord_tolerance_mm
        steps = np.array([step if axis.kind == "linear" else np.rad2deg(step / reach) for axis in cell.axes])
        decimals = np.maximum(np.ceil(-np.log10(steps)), 0).astype(np.int64)
        return cls(cell.letters, np.minimum(decimals, 6), work_offset)

    def counts(self, joints: Floats) -> Ints:
        """(n, 5) int: words of joints (n, 5), in units of their last decimal."""
        return np.asarray(np.rint((joints - self.offset) * 10.0**self.decimals), dtype=np.int64)

    def joints(self, counts: Ints) -> Floats:
        """(n, 5) float: machine coordinates that the words stand for."""
        return counts / 10.0**self.decimals + self.offset


def decimal(count: int, decimals: int) -> str:
    """A number of fixed point as few characters as it has digits: 12500, 3 -> 12.5."""
    if decimals == 0:
        return str(count)
    sign = "-" if count < 0 else ""
    whole, part = divmod(abs(count), 10**decimals)
    digits = f"{part:0{decimals}d}".rstrip("0")
    return f"{sign}{whole}.{digits}" if digits else f"{sign}{whole}"


def feed_words(feeds: Floats) -> list[str]:
    """F-words of (n,) feeds to _FEED_DIGITS significant digits, without exponents."""
    magnitude = np.floor(np.log10(np.maximum(feeds, 1e-6))).astype(np.int64)
    places = np.clip(_FEED_DIGITS - 1 - magnitude, 0, 6)
    counts = np.rint(feeds * 10.0**places).astype(np.int64)
    return ["F" + decimal(count, place) for count, place in zip(counts.tolist(), places.tolist(), strict=True)]


def inverse_time(counts: Ints, is_rotary: Bools, move: NDArray[np.uint8], chunk: Ints) -> Bools:
    """(n,) bool: moves at feed that go by inverse time: all of a chunk in which a rotary word changes.

    counts : (n + 1, 5) words before the first and after each item
    """
    turns = np.any(np.diff(counts, axis=0)[:, is_rotary] != 0, axis=1) & (move == Move.FEED)
    turning = np.zeros(int(chunk.max(initial=0)) + 1, dtype=np.bool_)
    turning[chunk[turns]] = True
    return np.asarray(turning[chunk] & (move == Move.FEED))


@dataclass(frozen=True)
class Script:
    """What is to be written, one row per line.

    counts : (n + 1, 5) int, words before the first line and after each   move : (n,) Move   by_time : (n,) bool, G93
    times_s : (n,) float, nominal   way : (n,) float, of the joints before rounding   named : (n,) int, bit k: name axis k even if its word stays
    commands : (n,) text of a line that is not a motion, None for a move
    """

    counts: Ints
    move: NDArray[np.uint8]
    by_time: Bools
    times_s: Floats
    way: Floats
    named: NDArray[np.uint8]
    commands: Sequence[str | None]


def write(words: Words, script: Script, length_max: int) -> tuple[str, ...]:
    """Lines of the program, line i with N(i + 1); modal words and words of axes that stay are left out.

    Raises PostError if a line is longer than the controller takes.
    """
    move = script.move.tolist()
    timed = script.by_time.tolist()
    feeds = _feeds(script)
    axes = _axis_words(words, script)
    lines = []
    motion, mode, feed = "", "G94", ""
    for i, text in enumerate(script.commands):
        if text is not None:
            lines.append(f"N{i + 1} {text}")
            continue
        line = f"N{i + 1}"
        is_feed = move[i] == Move.FEED
        if is_feed and mode != ("G93" if timed[i] else "G94"):
            mode, feed = ("G93" if timed[i] else "G94"), ""
            line += mode
        code = "G1" if is_feed else "G0"
        if code != motion:
            line += code
            motion = code
        line += axes[i]
        if is_feed and (timed[i] or feeds[i] != feed):
            line += feeds[i]
            feed = feeds[i]
        lines.append(line)
    _check_length(lines, length_max)
    return tuple(lines)


def _feeds(script: Script) -> list[str]:
    safe = np.maximum(script.times_s, 1e-9)
    return feed_words(np.where(script.by_time, 60.0 / safe, 60.0 * script.way / safe))


def _axis_words(words: Words, script: Script) -> list[str]:
    """Text of the axis words of each line: those that change, and those that are named anyway."""
    texts = [""] * len(script.move)
    for k, letter in enumerate(words.letters):
        column = script.counts[:, k]
        says = (np.diff(column) != 0) | ((script.named >> k) & 1).astype(np.bool_)
        places = int(words.decimals[k])
        rows = np.flatnonzero(says & (script.move != Move.NONE))
        for i, count in zip(rows.tolist(), column[rows + 1].tolist(), strict=True):
            texts[i] += letter + decimal(count, places)
    return texts


def _check_length(lines: Sequence[str], length_max: int) -> None:
    longest = max(range(len(lines)), key=lambda i: len(lines[i]), default=0)
    if lines and len(lines[longest]) >= length_max:
        raise PostError(
            f"line {longest + 1} has {len(lines[longest])} characters, the controller takes fewer than {length_max}",
            "raise cnc.line_length_max if the firmware takes it",
        )
