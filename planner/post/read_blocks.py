"""The written blocks read back: a parser of its own for numbered RS274/NGC text, modal state followed over the whole text at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.errors import PostError
from planner.kinematics.chain import Floats
from planner.post.read_curves import Arcs, Splines, read_arcs, read_splines
from planner.program import LineKind, Program

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

_NEW_LINE, _BLANK, _OPEN, _CLOSE, _POINT, _PLUS, _MINUS = 10, 32, 40, 41, 46, 43, 45
_N = ord("N")
_STATES = frozenset(
    {170, 210, 400, 490, 540, 900, 930, 940}
)  # tenths: what is said once at the start, and the feed's mode
_MOVES = (0, 10, 20, 30)
_DWELL = 40
_LEAVES = frozenset(
    {280, 300, 382, 383, 384, 385, 430, 431, 530}
)  # references, probing, tool length: behind them nothing is known
_FREE_KINDS = (LineKind.SETUP, LineKind.TOOL)  # macros may say what this parser does not know there


@dataclass(frozen=True)
class Grammar:
    """What a dialect may say beyond the common words, in tenths of the G-word, and which M-words."""

    g: frozenset[int]
    m: frozenset[int]


GRBLHAL = Grammar(frozenset(), frozenset({2, 3, 4, 5, 6, 30, 62, 63, 67, 68}))
LINUXCNC = Grammar(frozenset({52, 53, 610, 640}), GRBLHAL.m)


@dataclass(frozen=True)
class Reading:
    """What the text says, one row per line.

    joints : (n + 1, 5) float, machine coordinates before the first line and after each (NaN until an axis is named)
    is_motion, is_rapid, gate : (n,) bool   time_s : (n,) float, at the programmed feed, 0 for rapids and lines without motion
    tool : (n,) int   spindle_rpm : (n,) float   power_w : (n,) float, by the stream, NaN where it says none
    """

    joints: Floats
    is_motion: Bools
    is_rapid: Bools
    gate: Bools
    time_s: Floats
    tool: Ints
    spindle_rpm: Floats
    power_w: Floats
    arcs: Arcs
    splines: Splines

    def at(self, lines: Ints, share: float) -> Floats:
        """(k, 5) joints at a share of each of the moving lines (k,)."""
        before, after = self.joints[lines], self.joints[lines + 1]
        result = before + share * (after - before)
        for bent in (self.arcs, self.splines):
            rows, points = bent.at(lines, share)
            result[rows[:, None], np.array(bent.columns)] = points
        return result


@dataclass(frozen=True)
class Tokens:
    """All words of a text in order: line : (k,) int   letter : (k,) uint8, its character   value : (k,) float"""

    line: Ints
    letter: Bytes
    value: Floats

    def of(self, letter: str) -> tuple[Ints, Floats]:
        """Lines and values of all words with a letter."""
        here = np.flatnonzero(self.letter == ord(letter))
        return self.line[here], self.value[here]

    def codes(self, letter: str) -> tuple[Ints, Ints]:
        """Lines and values of all words with a letter, in tenths."""
        line, value = self.of(letter)
        return line, np.rint(10.0 * value).astype(np.int64)


def read(program: Program, grammar: Grammar) -> Reading:
    """Parse the text. Raises PostError with the line where it is not what the dialect writes."""
    n = len(program.lines)
    tokens, known = _tokens(program, grammar)
    g_line, g = tokens.codes("G")
    m_line, m = tokens.codes("M")
    modal = np.isin(g, (*_MOVES, 52, 53))
    motion = _held(n, g_line[modal], g[modal], -1)
    dwells = _marked(n, g_line[g == _DWELL])
    leaves = _marked(n, g_line[np.isin(g, list(_LEAVES))]) | ~known
    axes, names = _axes(program, tokens, n, dwells)
    axes[1:][leaves] = np.nan
    named = names.any(axis=1) & ~leaves
    joints = _followed(axes, leaves, program.work_offset)
    is_motion = named & (motion >= 0)
    xy = (program.axis_letters.index("X"), program.axis_letters.index("Y"))
    offsets = [_values(n, tokens, "I"), _values(n, tokens, "J")]
    arcs = read_arcs(joints, is_motion & ((motion == 20) | (motion == 30)), motion == 20, offsets, xy)
    in_spline = ((motion == 52) & named) | _marked(n, g_line[g == 53])
    order = _values(n, tokens, "L")
    splines = read_splines(
        joints, in_spline, motion == 53, np.where(np.isnan(order), 3.0, order), _values(n, tokens, "P"), xy
    )
    is_motion |= in_spline
    modes = (g == 930) | (g == 940)
    by_time = _held(n, g_line[modes], g[modes], 940) == 930
    time_s = _times(program, tokens, (joints, arcs, splines), is_motion & (motion != 0), by_time)
    gates = (m == 620) | (m == 630)
    return Reading(
        joints, is_motion, is_motion & (motion == 0), _held(n, m_line[gates], m[gates], 630) == 620, time_s,
        _held(n, *_whole(tokens.of("T")), 0), _spindle(n, tokens, m_line[m == 50]), _power(n, tokens, m_line[(m == 670) | (m == 680)]),
        arcs, splines,
    )  # fmt: skip


def _tokens(program: Program, grammar: Grammar) -> tuple[Tokens, Bools]:
    """All words, and (n,) bool: lines that this parser knows; others may only be macros' lines. Raises PostError."""
    n = len(program.lines)
    text = np.frombuffer(("\n".join(program.lines) + "\n").encode("ascii", "replace"), dtype=np.uint8)
    room = len(text) // 2 + 1
    line, letter, value = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.uint8), np.empty(room)
    known = np.ones(n, dtype=np.bool_)
    count = _split(text, line, letter, value, known)
    line, letter, value = line[:count], letter[:count], value[:count]
    sizes = np.bincount(line, minlength=n)
    first = np.cumsum(sizes) - sizes
    numbered = np.zeros(n, dtype=np.bool_)
    inside = sizes > 0
    numbered[inside] = (line[first[inside]] == np.flatnonzero(inside)) & (letter[first[inside]] == _N)
    numbered[inside] &= value[first[inside]] == np.flatnonzero(inside) + 1
    tokens = Tokens(line, letter, value)
    for word, fit in (("G", [*_STATES, *_LEAVES, *grammar.g, *_MOVES, _DWELL]), ("M", [10 * m for m in grammar.m])):
        said, codes = tokens.codes(word)
        known[said[~np.isin(codes, fit)]] = False
    numbers = np.flatnonzero(letter == _N)
    known[line[numbers[numbers != first[line[numbers]]]]] = False
    wrong = ~numbered | (~known & ~np.isin(program.table["kind"], _FREE_KINDS))
    if wrong.any():
        at = int(np.argmax(wrong))
        raise PostError(f"line {at + 1} cannot be read back: {program.lines[at]!r}", "report this program")
    return tokens, known


@njit(cache=True)
def _split(text: Bytes, line: Ints, letter: Bytes, value: Floats, known: Bools) -> int:
    """Fill in the words of all lines; how many. `known` becomes False for lines that are not made of words and comments."""
    at, row, count, size = 0, 0, 0, len(text)
    while at < size:
        c = text[at]
        if c == _NEW_LINE:
            row += 1
            at += 1
        elif c == _BLANK:
            at += 1
        elif c == _OPEN:
            while at < size and text[at] != _CLOSE and text[at] != _NEW_LINE:
                at += 1
            if at < size and text[at] == _CLOSE:
                at += 1
            else:
                known[row] = False
        elif 65 <= c <= 90:
            at += 1
            negative = text[at] == _MINUS
            if negative or text[at] == _PLUS:
                at += 1
            whole, scale, digits, points = 0, 1.0, 0, 0
            while at < size and (48 <= text[at] <= 57 or text[at] == _POINT):
                if text[at] == _POINT:
                    points += 1
                else:
                    whole = 10 * whole + (text[at] - 48)
                    digits += 1
                    if points > 0:
                        scale *= 10.0
                at += 1
            if digits == 0 or digits > 17 or points > 1:
                known[row] = False
            line[count], letter[count] = row, c
            value[count] = -whole / scale if negative else whole / scale
            count += 1
        else:
            known[row] = False
            at += 1
    return count


def _whole(words: tuple[Ints, Floats]) -> tuple[Ints, Ints]:
    return words[0], np.rint(words[1]).astype(np.int64)


def _marked(n: int, lines: Ints) -> Bools:
    result = np.zeros(n, dtype=np.bool_)
    result[lines] = True
    return result


def _held(n: int, lines: Ints, values: Ints, before: int) -> Ints:
    """(n,) int: the value that was said last at each line, `before` until one is said."""
    place = np.searchsorted(lines, np.arange(n), side="right")
    return np.concatenate([[before], values])[place]


def _values(n: int, tokens: Tokens, letter: str) -> Floats:
    """(n,) float: value of a letter's word on each line, NaN where it has none."""
    result = np.full(n, np.nan)
    lines, values = tokens.of(letter)
    result[lines] = values
    return result


def _axes(program: Program, tokens: Tokens, n: int, dwells: Bools) -> tuple[Floats, Bools]:
    """(n + 1, 5) words of the axes, NaN where none is said; (n, 5) bool where one is."""
    axes = np.full((n + 1, len(program.axis_letters)), np.nan)
    for k, letter in enumerate(program.axis_letters):
        axes[1:, k] = _values(n, tokens, letter)
    axes[1:][dwells] = np.nan
    return axes, ~np.isnan(axes[1:])


def _followed(axes: Floats, leaves: Bools, offset: Floats) -> Floats:
    """(n + 1, 5) machine coordinates: the last word of each axis, NaN behind lines that leave them unknown."""
    rows = np.arange(len(axes))
    lost = np.maximum.accumulate(np.where(np.append(True, leaves), rows, -1))
    joints = np.empty_like(axes)
    for k in range(axes.shape[1]):
        said = np.maximum.accumulate(np.where(np.isnan(axes[:, k]), -1, rows))
        joints[:, k] = np.where(said > lost, axes[said, k], np.nan) + offset[k]
    return joints


def _times(program: Program, tokens: Tokens, way: tuple[Floats, Arcs, Splines], feeds: Bools, by_time: Bools) -> Floats:
    """(n,) s of the moves at feed. Raises PostError where one has no feed."""
    n = len(feeds)
    lines, values = tokens.of("F")
    place = np.searchsorted(lines, np.arange(n), side="right") - 1
    feed = np.append(0.0, values)[place + 1]
    changed = np.maximum.accumulate(np.where(np.diff(by_time, prepend=False), np.arange(n), -1))
    said = np.append(-2, lines)[place + 1]
    stale = (said < changed) | (by_time & (said != np.arange(n)))
    wrong = feeds & (stale | (feed <= 0.0)) & ~way[2].follows
    if wrong.any():
        at = int(np.argmax(wrong))
        raise PostError(f"line {at + 1} has no feed: {program.lines[at]!r}", "report this program")
    joints, arcs, splines = way
    length = np.linalg.norm(np.diff(joints, axis=0), axis=1)
    length[arcs.lines] = arcs.length
    length[splines.lines] = splines.length
    minutes = np.divide(np.where(by_time, 1.0, length), feed, out=np.zeros(n), where=feeds & (feed > 0.0))
    return np.asarray(60.0 * minutes)


def _spindle(n: int, tokens: Tokens, stops: Ints) -> Floats:
    lines, speeds = tokens.of("S")
    every = np.concatenate([lines, stops])
    order = np.argsort(every, kind="stable")
    values = np.concatenate([speeds, np.zeros(len(stops))])[order]
    return np.append(0.0, values)[np.searchsorted(every[order], np.arange(n), side="right")]


def _power(n: int, tokens: Tokens, lines: Ints) -> Floats:
    """(n,) W: what M67 or M68 has said last, for the motion behind it; NaN before the first."""
    values = _values(n, tokens, "Q")[lines]
    return np.append(np.nan, values)[np.searchsorted(lines, np.arange(n), side="right")]
