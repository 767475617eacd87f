"""What a program in workpiece coordinates says, before any control's words: motions in order, with what is on during each. Filled by the readers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from string import Formatter
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from planner.errors import PostError
from planner.post.read_nurbs import ReadCurve

Floats = NDArray[np.float64]

_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+))"


class How(IntEnum):
    """How a motion goes."""

    RAPID = 0
    LINE = 1
    CURVE = 2
    MACHINE = 3


MOTION_DTYPE = np.dtype(
    [
        ("line", "<i8"),  # index of the line that it ends with
        ("first_line", "<i8"),
        ("how", "<i8"),
        ("tip", "<f8", (3,)),  # mm, workpiece, at the end; NaN for machine moves
        ("axis", "<f8", (3,)),  # unit vector there; NaN: as the rotary axes stand
        ("rotary", "<f8", (2,)),  # deg, where the control is told them
        ("feed_mm_min", "<f8"),
        ("curve", "<i8"),  # index, -1: none
        ("tool", "<i8"),
        ("rpm", "<f8"),
        ("gate", "<f8"),
        ("levels", "<f8", (4,)),  # W, g/min, L/min, L/min: laser, powder, carrier gas, shield gas
        ("mode", "<f8"),
    ]
)
LEVELS = ("laser_w", "powder_g_min", "carrier_gas_l_min", "shield_gas_l_min")
NAN3 = (float("nan"),) * 3
NAN2 = (float("nan"),) * 2


@dataclass
class State:
    """What is on while lines are read."""

    tool: int = 0
    rpm: float = 0.0
    gate: float = 0.0
    levels: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    mode: float = 0.0
    ended: bool = False

    def take(self, name: str, value: float) -> None:
        """An output, a mode, a tool or the end, by the name of its macro."""
        if name in LEVELS:
            at = LEVELS.index(name)
            self.levels = (*self.levels[:at], value, *self.levels[at + 1 :])
        elif name == "mode":
            self.mode, self.levels = value, (0.0, 0.0, 0.0, 0.0)
        elif name in ("gate_on", "gate_off"):
            self.gate = float(name == "gate_on")
        elif name == "tool_change":
            self.tool = int(value)
        elif name == "end":
            self.ended = True


@dataclass
class Reading:
    """motions : in order   joints : index of a machine move -> its words by axis letter, as written   dwells_s : sum   curves : NURBS."""

    rows: list[tuple[object, ...]] = field(default_factory=list)
    curves: list[ReadCurve] = field(default_factory=list)
    joints: dict[int, dict[str, float]] = field(default_factory=dict)
    ended: bool = False

    def add(
        self,
        lines: tuple[int, int],
        how: How,
        tip: tuple[float, ...],
        axis: tuple[float, ...],
        feed: float,
        state: State,
        rotary: tuple[float, ...] = NAN2,
        curve: int = -1,
    ) -> None:
        """One motion; lines : first and last."""
        self.rows.append(
            (
                lines[1],
                lines[0],
                how,
                tip,
                axis,
                rotary,
                feed,
                curve,
                state.tool,
                state.rpm,
                state.gate,
                state.levels,
                state.mode,
            )
        )

    def motions(self) -> NDArray[np.void]:
        """(k,) MOTION_DTYPE."""
        return np.array(self.rows, dtype=MOTION_DTYPE)


class Signals:
    """Tells what the lines of macros stand for; lines of start, home and probe stand for nothing that counts here.

    macros : lines by name, with {values}   output : number of the gate's output
    Raises PostError if the lines of two outputs are the same.
    """

    def __init__(self, macros: Mapping[str, Sequence[str]], output: int) -> None:
        self._known: dict[str, tuple[str, float]] = {}
        self._patterns: list[tuple[re.Pattern[str], str, bool]] = []
        firsts: dict[str, str] = {}
        for name, lines in macros.items():
            for k, line in enumerate(lines):
                text = line.replace("{output}", str(output))
                is_telling = self._tells(name, lines, k)
                if is_telling and name not in ("start", "home", "probe") and firsts.setdefault(text, name) != name:
                    raise PostError(
                        f"macros {firsts[text]} and {name} both say {text!r}", "nobody could tell them apart"
                    )
                self._patterns.append((_pattern(text), name, is_telling))

    def meaning(self, text: str) -> tuple[str, float] | None:
        """Name of the macro and its number; an empty name for a line that only goes with one; None: no macro says so."""
        found = self._known.get(text)
        if found is not None:
            return found
        for pattern, name, is_telling in self._patterns:
            match = pattern.fullmatch(text)
            if match:
                value = float(match[1]) if pattern.groups else 0.0
                found = self._known[text] = (name if is_telling else "", value)
                return found
        return None

    @staticmethod
    def _tells(name: str, lines: Sequence[str], k: int) -> bool:
        if name in ("start", "home", "probe"):
            return False
        telling = next(
            (i for i, line in enumerate(lines) if "{tool}" in line or "{value}" in line or "{mode}" in line), 0
        )
        return k == (len(lines) - 1 if name == "end" else telling)


def _pattern(text: str) -> re.Pattern[str]:
    """A macro's line as an expression whose one group is its number."""
    parts, has_group = [], False
    for literal, name, _, _ in Formatter().parse(text):
        parts.append(re.escape(literal))
        if name in ("tool", "value", "mode"):
            parts.append(_NUMBER.replace("(", "(?:", 1) if has_group else _NUMBER)
            has_group = True
        elif name is not None:
            parts.append(".*")
    return re.compile("".join(parts))


class LineReader(Protocol):
    """Modal state of one dialect: takes line after line, then says what they were."""

    def line(self, index: int, text: str) -> None:
        """Take a line in. Raises PostError if it cannot be read."""
        ...

    def finish(self, lines: Sequence[str]) -> Reading:
        """All of it. Raises PostError if the program does not end."""
        ...


def read_lines(reader: LineReader, lines: Sequence[str]) -> Reading:
    """Motions of a program, line by line. Raises PostError with the line that cannot be read."""
    for index, text in enumerate(lines):
        reader.line(index, text)
    return reader.finish(lines)


def unread(line: int, text: str, because: str = "") -> PostError:
    """The error for a line that is not what this dialect writes."""
    return PostError(
        f"line {line + 1} cannot be read back{because and ': ' + because}: {text!r}", "report this program"
    )
