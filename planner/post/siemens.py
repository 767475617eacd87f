"""Words of a Sinumerik 840D: TRAORI with axis vectors, NURBS as BSPLINE, machine moves with SUPA.

Source: Siemens, SINUMERIK 840D sl Programming Manual Job Planning, "Spline interpolation" (BSPLINE, SD, PL, PW: weights 0 to 3 in steps of
0.0001, degree 2 or 3, the start position is the first pole), "Orientation transformation" (TRAORI, ORIWKS, ORIVECT, A3 B3 C3), "Synchronized
actions" ($A_OUT); Manual 5-axis machining, ch. 3.5 and 7.1 (ORICURVE: the path of a second point on the tool by XH YH ZH, in conjunction with
BSPLINE as a control polygon; PL: interval length, node vector; FGROUP, CTOL, OTOL, FFWON, SOFT). The manuals do not say at which pole each span
stands: spans PL stand at the poles in order; the last SD - 1 poles have none, as in the public geometry library geo
(PolySplineCurve::writeGCode). Whether weights apply to the second curve as to the first the manual leaves open: rational curves with a turning
axis go as straight moves.
"""

from __future__ import annotations

import numpy as np

from config.macros import DialectName, Macros
from planner.post.tcp_blocks import Blocks, Command, Say, What
from planner.post.tcp_pass import Control
from planner.post.tcp_text import Bools, Rows, Texts, changed, joined, machine_edges, speaks_anew, words
from planner.post.tcp_words import Vocabulary

CONTROL = Control(
    "siemens",
    degrees=(2, 3),
    takes_axis_splines=True,
    weight_step=1e-4,
    weight_max=3.0,
    has_unit_start=True,
    decimals=4,
)
POINT = ""
NAME: DialectName = "siemens"
COMMENT = "; {text}"
MACROS = Macros(
    start=(
        "G17 G40 G710 G90 G94",
        "G642 CTOL={path_mm} OTOL={axis_deg}",
        "SOFT FFWON",
        "ORIWKS ORIVECT RTLION",
        "FGROUP(X,Y,Z)",
        "TRAFOOF",
    ),
    home=(),
    tool_change=("T{tool} M6", "D1"),
    probe=(),
    end=("M30",),
    gate_on=("WHEN TRUE DO $A_OUT[{output}]=1",),
    gate_off=("WHEN TRUE DO $A_OUT[{output}]=0",),
    laser_w=("H1={value}",),
    powder_g_min=("H2={value}",),
    carrier_gas_l_min=("H3={value}",),
    shield_gas_l_min=("H4={value}",),
    mode=("H5={mode}",),
)
"""What stands at fixed places unless the cell says otherwise. The gate is a synchronised action: it acts with the next motion. G642 rounds
corners by a share of the tolerances that the moves leave."""

POLE_DECIMALS = 6
AXIS_DECIMALS = 6
SECOND_POINT_MM = 100.0
"""How far from the tip the second point of ORICURVE runs."""


def texts(blocks: Blocks, vocabulary: Vocabulary) -> list[str | list[str]]:
    """Lines of each block, not numbered."""
    rows = blocks.rows
    what = rows["what"]
    made: list[str | list[str]] = list(_moves(blocks, vocabulary))
    for i in np.flatnonzero(what == What.COMMAND).tolist():
        made[i] = _command(blocks.commands[int(rows["command"][i])], vocabulary)
    off, on = machine_edges(blocks)
    for i in np.flatnonzero(off | on).tolist():
        before = ["TRAFOOF"] if off[i] else []
        after = ["TRAORI", "G54 D1"] if on[i] else []
        made[i] = [*before, *_listed(made[i]), *after]
    return made


def numbered(lines: Texts) -> Texts:
    """With N-words; comments too."""
    return [f"N{i} {line}" for i, line in enumerate(lines, 1)]


def _listed(text: str | list[str]) -> list[str]:
    return [text] if isinstance(text, str) else text


def _moves(blocks: Blocks, vocabulary: Vocabulary) -> Texts:
    rows = blocks.rows
    what = rows["what"]
    machine, pole, start = what == What.MACHINE, what == What.POLE, what == What.START
    moves = what != What.COMMAND
    anew = machine | speaks_anew(blocks)
    columns = [_modes(rows["turns"], what, moves, anew)]
    codes = np.select([machine, what == What.RAPID, pole], [0, 0, 2], default=1)
    code_says = changed(codes.astype(np.float64), 0, moves, np.zeros(len(what), dtype=np.bool_)) | start | machine
    names = np.array(["G0", "G1", "BSPLINE"], dtype=object)
    code_texts = np.where(code_says & moves, names[codes], "").astype(object)
    code_texts[machine] = "SUPA G0 D0"
    columns.append(code_texts.tolist())
    first_pole = pole & np.append(False, start[:-1])
    columns.append(words("SD=", rows["degree"].astype(np.float64), 0, first_pole))
    columns += _position_words(rows, what, anew)
    columns += _axis_words(rows, what, anew)
    columns += _machine_words(rows, machine, vocabulary)
    columns.append(words("PL=", rows["span"], POLE_DECIMALS, pole))
    columns.append(words("PW=", rows["weight"], 4, pole & _rational(rows, start)))
    fed = (what == What.LINE) | start
    columns.append(words("F", rows["feed_mm_min"], 3, changed(rows["feed_mm_min"], 3, fed, machine)))
    return joined(columns)


def _rational(rows: Rows, start: Bools) -> Bools:
    """(n,) bool: poles of a NURBS in which a weight is not 1."""
    curve = np.cumsum(start)
    weighted = np.zeros(int(curve[-1]) + 1 if len(curve) else 1, dtype=np.bool_)
    weighted[curve[(rows["what"] == What.POLE) & (rows["weight"] != 1.0)]] = True
    return np.asarray(weighted[curve])


def _modes(turns: Bools, what: np.ndarray[tuple[int], np.dtype[np.uint8]], moves: Bools, anew: Bools) -> Texts:
    """ORICURVE where the axis follows a NURBS, ORIVECT where it goes straight again."""
    curves = turns & ((what == What.START) | (what == What.POLE))
    says = changed(curves.astype(np.float64), 0, moves & (what != What.MACHINE), np.zeros(len(turns), dtype=np.bool_))
    names: Texts = np.where(says, np.where(curves, "ORICURVE", "ORIVECT"), "").tolist()
    return names


def _position_words(rows: Rows, what: np.ndarray[tuple[int], np.dtype[np.uint8]], anew: Bools) -> list[Texts]:
    """X Y Z: of poles all, with more decimals; of others those that change."""
    straight = (what == What.LINE) | (what == What.RAPID)
    curved = (what == What.START) | (what == What.POLE)
    columns = []
    for k, letter in enumerate("XYZ"):
        says = changed(rows["tip"][:, k], CONTROL.decimals, straight | curved, anew) | _after_curve(curved)
        lines = words(letter, rows["tip"][:, k], CONTROL.decimals, says & straight)
        poles = words(letter, rows["tip"][:, k], POLE_DECIMALS, curved)
        columns.append([line or pole for line, pole in zip(lines, poles, strict=True)])
    return columns


def _after_curve(curved: Bools) -> Bools:
    """(n,) bool: first blocks after poles, whose position has more decimals than a straight move's."""
    return np.append(False, curved[:-1])


def _axis_words(rows: Rows, what: np.ndarray[tuple[int], np.dtype[np.uint8]], anew: Bools) -> list[Texts]:
    """A3 B3 C3, unit vector, where it changes; XH YH ZH, the second point, at the poles of a turning axis."""
    tip_moves = (what != What.COMMAND) & (what != What.MACHINE)
    turns = rows["turns"] & tip_moves
    vectors = tip_moves & ~turns & (what != What.POLE)
    says = changed(rows["axis"], AXIS_DECIMALS, vectors, anew | turns) & vectors
    columns = [words(f"{letter}3=", rows["axis"][:, k], AXIS_DECIMALS, says) for k, letter in enumerate("ABC")]
    second = rows["tip"] + SECOND_POINT_MM * rows["axis"]
    columns += [words(f"{letter}H=", second[:, k], POLE_DECIMALS, turns) for k, letter in enumerate("XYZ")]
    return columns


def _machine_words(rows: Rows, machine: Bools, vocabulary: Vocabulary) -> list[Texts]:
    """Those axes that are told where to go, in machine coordinates."""
    return [
        words(letter, rows["joints"][:, k], CONTROL.decimals, machine & ((rows["named"] >> k) & 1).astype(np.bool_))
        for k, letter in enumerate(vocabulary.letters)
    ]


def _command(command: Command, vocabulary: Vocabulary) -> str | list[str]:
    if command.say == Say.COMMENT:
        return COMMENT.format(text=command.text)
    if command.say == Say.DWELL:
        return f"G4 F{command.value:.2f}"
    if command.say == Say.SPINDLE:
        return f"S{command.value:.0f} M3" if command.value > 0.0 else "M5"
    if command.say == Say.BEGIN:
        return [*(COMMENT.format(text=text) for text in vocabulary.header), *vocabulary.opening()]
    return vocabulary.said(command)
