"""Words of a Heidenhain TNC in Klartext: FUNCTION TCPM, LN with axis vectors, L where the axis stands.

Source: Heidenhain, TNC 640 User's Manual Klartext Programming, "FUNCTION TCPM" (F TCP, AXIS SPAT, PATHCTRL VECTOR), "Three-dimensional tool
compensation" (tool orientation by LN with X Y Z TX TY TZ and no NX NY NZ, as the path is that of the tip and not to be compensated; all
coordinates in each LN block), "M91" (machine coordinates; the tool's length does not count, TCPM has to be reset before), "Tolerance" (Cycle 32:
T, HSC-MODE, TA), "FN 19: PLC" (two numbers to the PLC), "Dwell time" (Cycle 9), "Datum setting" (Cycle 247).
"""

from __future__ import annotations

import numpy as np

from config.macros import DialectName, Macros
from planner.post.tcp_blocks import Blocks, Command, Say, What
from planner.post.tcp_pass import Control
from planner.post.tcp_text import Texts, changed, joined, machine_edges, speaks_anew, words
from planner.post.tcp_words import Vocabulary

NAME: DialectName = "heidenhain"
CONTROL = Control("heidenhain", decimals=4)
POINT = ""
MACROS = Macros(
    start=(
        "CYCL DEF 247 DATUM SETTING Q339=+1",
        "CYCL DEF 32.0 TOLERANCE",
        "CYCL DEF 32.1 T{path_mm}",
        "CYCL DEF 32.2 HSC-MODE:0 TA{axis_deg}",
    ),
    home=(),
    tool_change=("TOOL CALL {tool} Z",),
    probe=(),
    end=("M30",),
    gate_on=("M62",),
    gate_off=("M63",),
    laser_w=("FN 19: PLC=+1/+{value}",),
    powder_g_min=("FN 19: PLC=+2/+{value}",),
    carrier_gas_l_min=("FN 19: PLC=+3/+{value}",),
    shield_gas_l_min=("FN 19: PLC=+4/+{value}",),
    mode=("FN 19: PLC=+5/+{mode}",),
)
"""What stands at fixed places unless the cell says otherwise; gates are the machine builder's M functions."""

AXIS_DECIMALS = 7
_ON = "FUNCTION TCPM F TCP AXIS SPAT PATHCTRL VECTOR"
_OFF = "FUNCTION RESET TCPM"


def texts(blocks: Blocks, vocabulary: Vocabulary) -> list[str | list[str]]:
    """Lines of each block, not numbered."""
    rows = blocks.rows
    what = rows["what"]
    made: list[str | list[str]] = [*_moves(blocks, vocabulary)]
    for i in np.flatnonzero(what == What.COMMAND).tolist():
        made[i] = _command(blocks.commands[int(rows["command"][i])], vocabulary)
    off, on = machine_edges(blocks)
    for i in np.flatnonzero(off | on).tolist():
        text = made[i]
        made[i] = [*([_OFF] if off[i] else []), *([text] if isinstance(text, str) else text), *([_ON] if on[i] else [])]
    return [*made, f"END PGM {vocabulary.name} MM"]


def numbered(lines: Texts) -> Texts:
    """With running block numbers from 0."""
    return [f"{i} {line}" for i, line in enumerate(lines)]


def _moves(blocks: Blocks, vocabulary: Vocabulary) -> Texts:
    rows = blocks.rows
    what = rows["what"]
    machine, rapid = what == What.MACHINE, what == What.RAPID
    tip = (what != What.COMMAND) & ~machine
    anew = machine | speaks_anew(blocks)
    turns = changed(rows["axis"], AXIS_DECIMALS, tip, anew)
    names = np.where(machine, "L", np.where(turns, "LN", np.where(tip, "L", "")))
    columns: list[Texts] = [names.tolist()]
    moved = np.zeros(len(rows), dtype=np.bool_)
    says = [changed(rows["tip"][:, k], CONTROL.decimals, tip, anew) for k in range(3)]
    for column in says:
        moved |= column
    for k, letter in enumerate("XYZ"):
        column = (says[k] | turns | (~moved & (k == 0))) & tip
        columns.append(words(letter, rows["tip"][:, k], CONTROL.decimals, column, plus=True))
    columns += [
        words(f"T{letter}", rows["axis"][:, k], AXIS_DECIMALS, turns, plus=True) for k, letter in enumerate("XYZ")
    ]
    for k, letter in enumerate(vocabulary.letters):
        columns.append(
            words(
                letter,
                rows["joints"][:, k],
                CONTROL.decimals,
                machine & ((rows["named"] >> k) & 1).astype(np.bool_),
                plus=True,
            )
        )
    columns.append(np.where(machine, "R0 FMAX M91", np.where(rapid, "FMAX", "")).tolist())
    fed = what == What.LINE
    columns.append(words("F", rows["feed_mm_min"], 3, changed(rows["feed_mm_min"], 3, fed, anew)))
    return joined(columns)


def _command(command: Command, vocabulary: Vocabulary) -> str | list[str]:
    if command.say == Say.COMMENT:
        return f"; {command.text}"
    if command.say == Say.DWELL:
        return ["CYCL DEF 9.0 DWELL TIME", f"CYCL DEF 9.1 DWELL {command.value:.2f}"]
    if command.say == Say.SPINDLE:
        return [f"TOOL CALL S{command.value:.0f}", "M3"] if command.value > 0.0 else "M5"
    if command.say == Say.BEGIN:
        low, high = (
            " ".join(f"{letter}{value:+.3f}" for letter, value in zip("XYZ", corner, strict=True))
            for corner in vocabulary.box_mm
        )
        form = [f"BLK FORM 0.1 Z {low}", f"BLK FORM 0.2 {high}"]
        header = [f"; {text}" for text in vocabulary.header]
        return [f"BEGIN PGM {vocabulary.name} MM", *header, *form, *vocabulary.opening()]
    return vocabulary.said(command)
