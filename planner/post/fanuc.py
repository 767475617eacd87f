"""Words of a Fanuc 30i: tool centre point control with rotary positions (G43.4), NURBS as G06.2 where the tool axis stands.

Source: Fanuc, Series 15i/150i Operator's Manual (Programming), "NURBS interpolation" (G06.2 P K X Y Z R, ranks 2 to 4: P is the rank, a knot with
each pole, then as many blocks with a knot alone as the rank; the first pole is where the tool stands; numbers of nine digits in the least
increment); Series 30i Operator's Manual, "Tool center point control" (G43.4 H with rotary positions, G49), "AI contour control" (G05.1 Q1),
"Machine coordinate system" (G53). The manuals describe NURBS of controlled axes and list no combination with tool centre point control: whether a
control takes G06.2 under G43.4 is its builder's word, so curves are straight moves unless the cell file says cnc.takes_nurbs = true, and NURBS
then stand only where the rotary axes do. With rotary positions the control takes the poses that were looked through for collisions; I J K vectors
(G43.5) would leave the choice to it, and K is the knot's letter. G00 need not be straight: rapid moves of the tip go as G01.
"""

from __future__ import annotations

import numpy as np

from config.macros import DialectName, Macros
from planner.post.tcp_blocks import Blocks, Command, Say, What
from planner.post.tcp_pass import Control
from planner.post.tcp_text import (
    Bools,
    Floats,
    Rows,
    Texts,
    changed,
    joined,
    machine_edges,
    numbers,
    speaks_anew,
    words,
)
from planner.post.tcp_words import Vocabulary

NAME: DialectName = "fanuc"
CONTROL = Control(
    "fanuc",
    degrees=(2, 3),
    weight_step=1e-4,
    weight_max=1000.0,
    decimals=4,
    nurbs_unless_told=False,
    tells_rotary=True,
)
MACROS = Macros(
    start=("G17 G21 G40 G49 G80", "G90 G94 G54", "G05.1 Q1"),
    home=(),
    tool_change=("T{tool} M06",),
    probe=(),
    end=("G05.1 Q0", "M30"),
    gate_on=("M62",),
    gate_off=("M63",),
    laser_w=("G65 P9101 A{value}",),
    powder_g_min=("G65 P9102 A{value}",),
    carrier_gas_l_min=("G65 P9103 A{value}",),
    shield_gas_l_min=("G65 P9104 A{value}",),
    mode=("G65 P9105 A{mode}",),
)
"""What stands at fixed places unless the cell says otherwise; gates and levels are the machine builder's M codes and macros."""
POINT = "."
_DECIMALS = CONTROL.decimals


def texts(blocks: Blocks, vocabulary: Vocabulary) -> list[str | list[str]]:
    """Lines of each block, not numbered."""
    rows = blocks.rows
    what = rows["what"]
    moves, feeds = _moves(blocks, vocabulary)
    made: list[str | list[str]] = [*joined([moves, feeds])]
    for i in np.flatnonzero(_stays(rows, speaks_anew(blocks), vocabulary.rotary)).tolist():
        made[i] = feeds[i]
    for i in np.flatnonzero(what == What.COMMAND).tolist():
        made[i] = _command(blocks.commands[int(rows["command"][i])], vocabulary)
    _add_knots(made, rows)
    off, on = machine_edges(blocks)
    for i in np.flatnonzero(off).tolist():
        made[i] = ["G49", *_listed(made[i])]
    for i in np.flatnonzero(on).tolist():
        made[i] = [*_listed(made[i]), _pose(rows[i], vocabulary)]
    made.append("%")
    return made


def numbered(lines: Texts) -> Texts:
    """With N-words, but for the tape's marks and the program's number."""
    return [line if line[0] in "%O" else f"N{i} {line}" for i, line in enumerate(lines, 1)]


def _listed(text: str | list[str]) -> list[str]:
    return [text] if isinstance(text, str) else text


def _pose(row: np.void, vocabulary: Vocabulary) -> str:
    """Tool centre point control on, at the pose where the machine stands: nothing moves."""
    values = [*row["tip_end"].tolist(), *(row["joints"][k] for k in vocabulary.rotary)]
    letters = [*"XYZ", *(vocabulary.letters[k] for k in vocabulary.rotary)]
    told = numbers(np.array(values, dtype=np.float64), _DECIMALS, POINT)
    return " ".join(
        [
            f"G01 G43.4 H{row['tool']}",
            *(a + b for a, b in zip(letters, told, strict=True)),
            f"F{vocabulary.rapid_mm_min:.0f}.",
        ]
    )


def _stays(rows: Rows, anew: Bools, rotary: tuple[int, ...]) -> Bools:
    """(n,) bool: starts of a NURBS where the tool stands already, so that no block leads there."""
    moves = np.flatnonzero((rows["what"] != What.COMMAND) | anew)
    place = np.round(np.hstack([rows["tip"], rows["joints"][:, list(rotary)]])[moves], _DECIMALS)
    tip = (rows["what"][moves] != What.MACHINE) & ~anew[moves]
    same = np.append(False, np.all(place[1:] == place[:-1], axis=1) & tip[:-1])
    result = np.zeros(len(rows), dtype=np.bool_)
    result[moves] = same & (rows["what"][moves] == What.START)
    return result


def _moves(blocks: Blocks, vocabulary: Vocabulary) -> tuple[Texts, Texts]:
    """Words of motion, but those of NURBS' knots; and the words of feed."""
    rows = blocks.rows
    what = rows["what"]
    machine, pole, start = what == What.MACHINE, what == What.POLE, what == What.START
    tip = (what != What.COMMAND) & ~machine
    anew = machine | speaks_anew(blocks)
    codes = np.select([machine, pole], [0.0, 2.0], default=1.0)
    names = np.array(["G53 G00", "G01", ""], dtype=object)
    says = changed(codes, 0, tip | machine, anew | machine) & ~pole
    columns: list[Texts] = [np.where(says, names[codes.astype(np.int64)], "").tolist()]
    for k, letter in enumerate("XYZ"):
        column = rows["tip"][:, k]
        columns.append(
            words(letter, column, _DECIMALS, changed(column, _DECIMALS, tip, anew) & ~pole | pole | start, POINT)
        )
    for k in vocabulary.rotary:
        column = rows["joints"][:, k]
        columns.append(
            words(vocabulary.letters[k], column, _DECIMALS, changed(column, _DECIMALS, tip & ~pole, anew), POINT)
        )
    for k, letter in enumerate(vocabulary.letters):
        columns.append(
            words(letter, rows["joints"][:, k], _DECIMALS, machine & ((rows["named"] >> k) & 1).astype(np.bool_), POINT)
        )
    rational = _rational(rows, start)
    columns.append(words("R", rows["weight"], 4, pole & rational, POINT))
    feed = np.where(what == What.RAPID, vocabulary.rapid_mm_min, rows["feed_mm_min"])
    fed = (what == What.LINE) | (what == What.RAPID) | start
    return joined(columns), words("F", feed, 3, changed(feed, 3, fed, anew), POINT)


def _rational(rows: Rows, start: Bools) -> Bools:
    """(n,) bool: blocks of a NURBS whose weights differ from 1."""
    curve = np.cumsum(start)
    weighted = np.zeros(int(curve[-1]) + 1 if len(curve) else 1, dtype=np.bool_)
    curved = (rows["what"] == What.POLE) | start
    weighted[curve[curved & (rows["weight"] != 1.0)]] = True
    return np.asarray(weighted[curve])


def _add_knots(made: list[str | list[str]], rows: Rows) -> None:
    """K-words at the poles, the block with G06.2 behind each start, and the knots that stand alone."""
    what = rows["what"]
    starts = np.flatnonzero(what == What.START)
    if starts.size == 0:
        return
    reached = np.cumsum(np.where(what == What.POLE, rows["span"], 0.0))
    of_start = starts[np.searchsorted(starts, np.arange(len(what)), side="right").clip(1) - 1]
    behind = np.maximum(np.arange(len(what)) - rows["degree"], of_start)
    knots = words("K", reached[behind] - reached[of_start], _DECIMALS, what == What.POLE, POINT)
    for i in np.flatnonzero(what == What.POLE).tolist():
        made[i] = f"{knots[i]} {made[i]}"
    ends = np.append(starts[1:], len(what))
    rational = _rational(rows, what == What.START)
    for first, limit in zip(starts.tolist(), ends.tolist(), strict=True):
        poles = first + 1 + np.flatnonzero(what[first + 1 : limit] == What.POLE)
        last, rank = int(poles[-1]), int(rows["degree"][first]) + 1
        place = " ".join(a + b for a, b in zip("XYZ", numbers(rows["tip"][first], _DECIMALS, POINT), strict=True))
        weight = f" R{numbers(rows['weight'][first : first + 1], 4, POINT)[0]}" if rational[first] else ""
        begins = f"G06.2 P{rank} K0. {place}{weight}"
        before = str(made[first])
        made[first] = [before, begins] if before.startswith("G01") else f"{begins} {before}".rstrip()
        final = f"K{_knot(reached[last] - reached[first])}"
        made[last] = [*_listed(made[last]), *([final] * rank)]


def _knot(value: Floats) -> str:
    return numbers(np.array([float(value)]), _DECIMALS, POINT)[0]


def _command(command: Command, vocabulary: Vocabulary) -> str | list[str]:
    if command.say == Say.COMMENT:
        return f"({_plain(command.text)})"
    if command.say == Say.DWELL:
        return f"G04 X{command.value:.2f}"
    if command.say == Say.SPINDLE:
        return f"S{command.value:.0f} M03" if command.value > 0.0 else "M05"
    if command.say == Say.BEGIN:
        header = [f"({_plain(text)})" for text in vocabulary.header]
        return ["%", f"O0001 ({_plain(vocabulary.name)})", *header, *vocabulary.opening()]
    return vocabulary.said(command)


def _plain(text: str) -> str:
    return text.replace("(", "[").replace(")", "]").upper()
