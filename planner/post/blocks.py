"""Numbered blocks of the RS274/NGC family as text: G93 where a rotary axis moves, G94 where none does, modal words once."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.errors import PostError
from planner.kinematics.chain import Floats
from planner.post.tape import Move
from planner.post.words import Words, feed_counts

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]

_NONE, _RAPID, _STRAIGHT, _CLOCKWISE, _COUNTER = 0, 1, 2, 3, 4  # motion that is modal; G0 to G3 but for _NONE
_COMMENT = re.compile(r"\([^)]*\)")
_LEAVES_MODES = re.compile(r"G(?!4(?![\d.]))|[XYZABC]")
_SAME_FEED = 2e-4  # relative: a feed this near to the one that stands is not said again
_LINE_BYTES = 176  # N, G93, G3, five axes, I, J and F of at most 19 characters each
ARC_EXTRA_DECIMALS = 1
"""Of I and J beyond X and Y: so that both ends lie on the circle as nearly as their own rounding lets them."""


@dataclass(frozen=True)
class Script:
    """What is to be written, one row per line.

    counts : (n + 1, 5) int, words before the first line and after each   move : (n,) Move   by_time : (n,) bool, G93
    times_s : (n,) float, nominal   way : (n,) float, of the joints before rounding   named : (n,) int, bit k: name axis k even if its word stays
    bulge : (n,) float, tan(sweep / 4) of arcs in XY, counter-clockwise > 0   commands : (n,) text of a line, None: a move is written
    """

    counts: Ints
    move: NDArray[np.uint8]
    by_time: Bools
    times_s: Floats
    way: Floats
    named: NDArray[np.uint8]
    bulge: Floats
    commands: Sequence[str | None]


def inverse_time(counts: Ints, is_rotary: Bools, move: NDArray[np.uint8], chunk: Ints) -> Bools:
    """(n,) bool: moves at feed that go by inverse time: all of a chunk in which a rotary word changes.

    counts : (n + 1, 5) words before the first and after each item
    """
    turns = np.any(np.diff(counts, axis=0)[:, is_rotary] != 0, axis=1) & (move == Move.FEED)
    turning = np.zeros(int(chunk.max(initial=0)) + 1, dtype=np.bool_)
    turning[chunk[turns]] = True
    return np.asarray(turning[chunk] & (move == Move.FEED))


def write(words: Words, script: Script, length_max: int) -> tuple[str, ...]:
    """Lines of the program, line i with N(i + 1); modal words and words of axes that stay are left out.

    Raises PostError if a line is longer than the controller takes.
    """
    blob, ends = _encoded(script.commands)
    says = np.diff(script.counts, axis=0) != 0
    says |= ((script.named[:, None] >> np.arange(says.shape[1])) & 1).astype(np.bool_)
    motion = np.where(script.move == Move.FEED, _STRAIGHT, _RAPID)
    motion[script.bulge > 0.0], motion[script.bulge < 0.0] = _COUNTER, _CLOCKWISE
    feed, places = feed_counts(_feeds(script))
    centre, centre_places = _centres(words, script)
    letters = np.frombuffer("".join(words.letters).encode("ascii"), dtype=np.uint8)
    buffer = np.empty(_LINE_BYTES * len(motion) + len(blob), dtype=np.uint8)
    size = _text(
        buffer, (blob, ends, _clears(script.commands)), (script.counts, says, letters, words.decimals),
        (motion, script.by_time, feed, places, feed / 10.0**places), (centre, centre_places),
    )  # fmt: skip
    lines = tuple(buffer[:size].tobytes().decode("ascii").splitlines())
    _check_length(lines, length_max)
    return lines


def _encoded(commands: Sequence[str | None]) -> tuple[Bytes, Ints]:
    """All texts one after the other, and (n + 1,) where each ends; a move has none."""
    sizes = [0 if text is None else len(text) for text in commands]
    joined = "".join(text for text in commands if text is not None).encode("ascii")
    return np.frombuffer(joined, dtype=np.uint8), np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)


def _clears(commands: Sequence[str | None]) -> Bools:
    """(n,) bool: lines of their own text behind which no modal word is taken for granted."""
    result = np.zeros(len(commands), dtype=np.bool_)
    for i, text in enumerate(commands):
        if text is not None:
            result[i] = _LEAVES_MODES.search(_COMMENT.sub("", text)) is not None
    return result


def _feeds(script: Script) -> Floats:
    safe = np.maximum(script.times_s, 1e-9)
    return np.where(script.by_time, 60.0 / safe, 60.0 * script.way / safe)


def _centres(words: Words, script: Script) -> tuple[Ints, int]:
    """(n, 2) int and their decimals: centres of the arcs from their starts, from the rounded ends, 0 for others."""
    if not np.any(script.bulge):
        return np.zeros((len(script.bulge), 2), dtype=np.int64), 0
    columns = [words.letters.index("X"), words.letters.index("Y")]
    places = int(words.decimals[columns].max()) + ARC_EXTRA_DECIMALS
    chord = np.diff(words.values(script.counts)[:, columns], axis=0)
    safe = np.where(script.bulge == 0.0, 1.0, script.bulge)
    along = (0.25 * (1.0 / safe - safe))[:, None] * np.column_stack([-chord[:, 1], chord[:, 0]])
    centre = np.where(script.bulge[:, None] != 0.0, 0.5 * chord + along, 0.0)
    return np.asarray(np.rint(centre * 10.0**places), dtype=np.int64), places


def _check_length(lines: Sequence[str], length_max: int) -> None:
    longest = max(range(len(lines)), key=lambda i: len(lines[i]), default=0)
    if lines and len(lines[longest]) >= length_max:
        raise PostError(
            f"line {longest + 1} has {len(lines[longest])} characters, the controller takes fewer than {length_max}",
            "raise cnc.line_length_max if the firmware takes it",
        )


@njit(cache=True)
def _put_number(buffer: Bytes, at: int, count: int, places: int) -> int:
    """Write count / 10^places without needless digits; the place behind it."""
    if count < 0:
        buffer[at] = 45
        at += 1
        count = -count
    while places > 0 and count % 10 == 0:
        count //= 10
        places -= 1
    digits, rest = 1, count
    while rest >= 10:
        rest //= 10
        digits += 1
    digits = max(digits, places + 1)
    size = digits + (1 if places > 0 else 0)
    for k in range(size):
        place = at + size - 1 - k
        if places > 0 and k == places:
            buffer[place] = 46
        else:
            buffer[place] = 48 + count % 10
            count //= 10
    return at + size


@njit(cache=True)
def _put_code(buffer: Bytes, at: int, code: int) -> int:
    """Write G and a whole number."""
    buffer[at] = 71
    return _put_number(buffer, at + 1, code, 0)


@njit(cache=True)
def _text(
    buffer: Bytes,
    own: tuple[Bytes, Ints, Bools],
    axes: tuple[Ints, Bools, Bytes, Ints],
    how: tuple[Ints, Bools, Ints, Ints, Floats],
    centres: tuple[Ints, int],
) -> int:
    """Fill the buffer with all lines; bytes written."""
    blob, ends, clears = own
    counts, says, letters, decimals = axes
    motion, by_time, feeds, places, rates = how
    centre, centre_places = centres
    at = 0
    modal, mode, rate = _NONE, 0, 0.0
    for i in range(len(motion)):
        buffer[at] = 78
        at = _put_number(buffer, at + 1, i + 1, 0)
        if ends[i + 1] > ends[i]:
            buffer[at] = 32
            at += 1
            for k in range(ends[i], ends[i + 1]):
                buffer[at] = blob[k]
                at += 1
            if clears[i]:
                modal, mode, rate = _NONE, 0, 0.0
            buffer[at] = 10
            at += 1
            continue
        is_feed = motion[i] != _RAPID
        wanted = 93 if by_time[i] else 94
        if is_feed and mode != wanted:
            mode, rate = wanted, 0.0
            at = _put_code(buffer, at, wanted)
        if motion[i] != modal:
            modal = motion[i]
            at = _put_code(buffer, at, modal - 1)
        for k in range(len(letters)):
            if says[i, k]:
                buffer[at] = letters[k]
                at = _put_number(buffer, at + 1, counts[i + 1, k], decimals[k])
        if modal > _STRAIGHT:
            for k in range(2):
                if centre[i, k] != 0:
                    buffer[at] = 73 + k
                    at = _put_number(buffer, at + 1, centre[i, k], centre_places)
        if is_feed and (by_time[i] or abs(rates[i] - rate) > _SAME_FEED * rate):
            rate = rates[i]
            buffer[at] = 70
            at = _put_number(buffer, at + 1, feeds[i], places[i])
        buffer[at] = 10
        at += 1
    return at
