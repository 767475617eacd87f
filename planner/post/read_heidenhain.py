"""Reads Klartext programs for a Heidenhain TNC as the control would; shares no code with the writer.

Source: Heidenhain, TNC 640 User's Manual Klartext Programming: L and LN blocks, FMAX holds for its block only, F and positions stay, the axis of LN
stays for L blocks under TCPM.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from planner.post.reading import NAN3, How, Reading, Signals, State, read_lines, unread

_BLOCK = re.compile(r"(\d+) (.*)")
_PROGRAM = re.compile(r"(BEGIN|END) PGM ([A-Z][A-Z0-9_]*) MM")
_WORD = re.compile(r"(T?[XYZ]|[ABC])([-+]\d*\.?\d+)|(F)(\d*\.?\d+)|(FMAX|R0|M91)")
_TCPM = "FUNCTION TCPM F TCP AXIS SPAT PATHCTRL VECTOR"
_RESET = "FUNCTION RESET TCPM"
_FORM = re.compile(r"BLK FORM 0\.(?:1 Z|2)((?: [XYZ][-+]\d*\.?\d+){3})")
_SPEED = re.compile(r"TOOL CALL S(\d+)")
_DWELL = re.compile(r"CYCL DEF 9\.(?:0 DWELL TIME|1 DWELL \d*\.?\d+)")


class _Reader:
    """Modal state, block by block."""

    def __init__(self, letters: Sequence[str], signals: Signals) -> None:
        self._letters = set(letters)
        self._signals = signals
        self.reading = Reading()
        self._state = State()
        self._name = ""
        self._is_closed = False
        self._follows_tip = False
        self._tip: dict[str, float] = {}
        self._axis: tuple[float, ...] = NAN3
        self._feed = 0.0
        self._speed = 0.0

    def line(self, index: int, text: str) -> None:
        """Take one block."""
        match = _BLOCK.fullmatch(text)
        if not match or int(match[1]) != index or self._is_closed:
            raise unread(index, text, "its block number, or behind the end")
        body = match[2]
        if body.startswith(("L ", "LN ")):
            self._straight(index, text, body.split(" "))
        elif body[0] != ";":
            self._other(index, text, body)

    def _straight(self, index: int, text: str, tokens: list[str]) -> None:
        values: dict[str, float] = {}
        keys = set()
        for token in tokens[1:]:
            match = _WORD.fullmatch(token)
            if match is None:
                raise unread(index, text, token)
            name, number, feed, rate, key = match.groups()
            if name:
                values[name] = float(number)
            elif feed:
                values["F"] = float(rate)
            else:
                keys.add(key)
        if "M91" in keys:
            self._machine(index, text, values)
            return
        if not self._follows_tip:
            raise unread(index, text, "a position of the tip without FUNCTION TCPM")
        is_rapid = "FMAX" in keys
        if not is_rapid:
            self._feed = values.get("F", self._feed)
        self._tip.update((letter, values[letter]) for letter in "XYZ" if letter in values)
        vector = tuple(values[name] for name in ("TX", "TY", "TZ") if name in values)
        if (tokens[0] == "LN") != (len(vector) == 3) or len(self._tip) != 3:
            raise unread(index, text, "LN goes with TX TY TZ, L without")
        if vector:
            length = sum(value * value for value in vector) ** 0.5
            if abs(length - 1.0) > 1e-4:
                raise unread(index, text, "the axis is no unit vector")
            self._axis = tuple(value / length for value in vector)
        tip = (self._tip["X"], self._tip["Y"], self._tip["Z"])
        self.reading.add((index, index), How.RAPID if is_rapid else How.LINE, tip, self._axis, self._feed, self._state)

    def _machine(self, index: int, text: str, values: dict[str, float]) -> None:
        if self._follows_tip or not values.keys() <= self._letters or not values:
            raise unread(index, text, "machine positions need TCPM reset and axes")
        self.reading.joints[len(self.reading.rows)] = values
        self.reading.add((index, index), How.MACHINE, NAN3, NAN3, 0.0, self._state)
        self._tip, self._axis = {}, NAN3

    def _other(self, index: int, text: str, body: str) -> None:
        program = _PROGRAM.fullmatch(body)
        meaning = self._signals.meaning(body)
        if program:
            self._program(index, text, program[1], program[2])
        elif meaning is not None:
            if meaning[0]:
                self._state.take(*meaning)
        elif body in (_TCPM, _RESET):
            self._follows_tip = body == _TCPM
        elif speed := _SPEED.fullmatch(body):
            self._speed = float(speed[1])
        elif body in ("M3", "M5"):
            self._state.rpm = self._speed if body == "M3" else 0.0
        elif not (_FORM.fullmatch(body) or _DWELL.fullmatch(body)):
            raise unread(index, text)

    def _program(self, index: int, text: str, word: str, name: str) -> None:
        if (word == "BEGIN") != (index == 0) or (word == "END" and name != self._name):
            raise unread(index, text, "the program's frame")
        self._name = name
        self._is_closed = word == "END"

    def finish(self, lines: Sequence[str]) -> Reading:
        """All of it. Raises PostError if the program does not end."""
        if not self._state.ended or not self._is_closed:
            raise unread(len(lines) - 1, lines[-1], "the program does not end")
        self.reading.ended = True
        return self.reading


def read(lines: Sequence[str], letters: Sequence[str], signals: Signals) -> Reading:
    """Motions of a program. Raises PostError with the block that cannot be read."""
    return read_lines(_Reader(letters, signals), lines)
