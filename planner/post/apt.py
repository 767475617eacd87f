"""APT cutter location data, for a machine's own post processor: tip and axis, feeds, tools, outputs.

Source: ISO 4343 (industrial automation systems, numerical control of machines, NC processor output, post processor commands): PARTNO, UNITS, MULTAX,
LOADTL, SPINDL, FEDRAT, RAPID (for the next motion only), GOTO with six numbers, DELAY, AUXFUN, INSERT, PPRINT, END, FINI.
"""

from __future__ import annotations

import numpy as np

from config.macros import DialectName, Macros
from planner.post.tcp_blocks import Blocks, Command, Say, What
from planner.post.tcp_pass import Control
from planner.post.tcp_text import Texts, changed, joined, numbers, speaks_anew, words
from planner.post.tcp_words import Vocabulary

NAME: DialectName = "apt"
CONTROL = Control("apt", decimals=5, takes_machine_moves=False)
POINT = ""
MACROS = Macros(
    start=("UNITS/MM", "MULTAX/ON"),
    home=(),
    tool_change=("LOADTL/{tool}",),
    probe=(),
    end=("END", "FINI"),
    gate_on=("AUXFUN/62",),
    gate_off=("AUXFUN/63",),
    laser_w=("INSERT/LASER {value}",),
    powder_g_min=("INSERT/POWDER {value}",),
    carrier_gas_l_min=("INSERT/CARRIER GAS {value}",),
    shield_gas_l_min=("INSERT/SHIELD GAS {value}",),
    mode=("INSERT/MODE {mode}",),
)
"""What stands at fixed places unless the cell says otherwise."""

AXIS_DECIMALS = 7


def texts(blocks: Blocks, vocabulary: Vocabulary) -> list[str | list[str]]:
    """Lines of each block."""
    rows = blocks.rows
    what = rows["what"]
    columns = [numbers(rows["tip"][:, k], CONTROL.decimals) for k in range(3)]
    columns += [numbers(rows["axis"][:, k], AXIS_DECIMALS) for k in range(3)]
    made: list[str | list[str]] = ["GOTO/" + text for text in joined(columns, ",")]
    fed = what == What.LINE
    feeds = words("FEDRAT/", rows["feed_mm_min"], 3, changed(rows["feed_mm_min"], 3, fed, speaks_anew(blocks)))
    for i in np.flatnonzero(np.array([bool(text) for text in feeds])).tolist():
        made[i] = [f"{feeds[i]},MMPM", str(made[i])]
    for i in np.flatnonzero(what == What.RAPID).tolist():
        made[i] = ["RAPID", str(made[i])]
    for i in np.flatnonzero(what == What.COMMAND).tolist():
        made[i] = _command(blocks.commands[int(rows["command"][i])], vocabulary)
    return made


def numbered(lines: Texts) -> Texts:
    """As they are: statements have no numbers."""
    return lines


def _command(command: Command, vocabulary: Vocabulary) -> str | list[str]:
    if command.say == Say.COMMENT:
        return f"PPRINT/{command.text}"
    if command.say == Say.DWELL:
        return f"DELAY/{command.value:.2f}"
    if command.say == Say.SPINDLE:
        return f"SPINDL/{command.value:.0f},RPM,CLW" if command.value > 0.0 else "SPINDL/OFF"
    if command.say == Say.BEGIN:
        return [f"PARTNO/{vocabulary.name}", *(f"PPRINT/{text}" for text in vocabulary.header), *vocabulary.opening()]
    return vocabulary.said(command)
