"""Reads programs for a Fanuc 30i as the control would; shares no code with the writer.

Source: Fanuc Series 15i/150i and 30i Operator's Manuals: numbers with decimal points are mm or deg; G06.2 takes the first pole from its own
block, the number of knots is that of the poles and the rank P together.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from planner.post.read_nurbs import ReadCurve
from planner.post.reading import NAN3, How, Reading, Signals, State, read_lines, unread

_WORD = re.compile(r"([A-Z])([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))")
_NUMBER = re.compile(r"N(\d+) (.*)")
_COMMENT = re.compile(r"\([^()]*\)")
_MOTION = re.compile(r"(?:G0[01] |G53 |G06\.2 |[XYZABCKF][-+.0-9])")
_NEEDED = {17.0, 21.0, 90.0, 94.0, 54.0}
_MODES = _NEEDED | {40.0, 80.0, 5.1}
_POSITIONS = "XYZABCKFR"


class _Reader:
    """Modal state, line by line."""

    def __init__(self, letters: Sequence[str], signals: Signals) -> None:
        self._letters = tuple(letters)
        self._rotary_letters = tuple(letter for letter in letters if letter in "ABC")
        self._signals = signals
        self.reading = Reading()
        self._state = State()
        self._modes: set[float] = set()
        self._code = -1.0
        self._follows_tip = False
        self._place: dict[str, float] = {}
        self._feed = 0.0
        self._poles: list[tuple[float, ...]] = []  # x y z weight
        self._knots: list[float] = []
        self._rank = 0
        self._first = 0
        self._outputs: tuple[float, ...] = ()
        self._marks = 0

    def line(self, index: int, text: str) -> None:
        """Take one line."""
        if text == "%":
            self._marks += 1
            return
        if text[0] == "O" and index == 1:
            return
        match = _NUMBER.fullmatch(text)
        if not match or int(match[1]) != index + 1 or self._marks != 1:
            raise unread(index, text, "its N-word, or no % before it")
        body = match[2]
        if body[0] == "(":
            if not _COMMENT.fullmatch(body):
                raise unread(index, text, "a comment in a comment")
            return
        meaning = None if _MOTION.match(body) else self._signals.meaning(body)
        if meaning is not None and meaning[0]:
            if self._poles:
                raise unread(index, text, "within a NURBS")
            self._state.take(*meaning)
            return
        words = _WORD.findall(body)
        if "".join(letter + value for letter, value in words) != body.replace(" ", ""):
            if meaning is not None:
                return
            raise unread(index, text)
        self._words(index, text, words, meaning is not None)

    def _words(self, index: int, text: str, words: list[tuple[str, str]], is_macro: bool) -> None:
        codes: list[float] = []
        values: dict[str, float] = {}
        for letter, value in words:
            if letter == "G":
                codes.append(float(value))
            elif letter == "M":
                self._spindle(index, text, int(value), words, is_macro)
            else:
                if letter in _POSITIONS and "." not in value:
                    raise unread(index, text, f"{letter}{value} has no decimal point")
                values[letter] = float(value)
        for code in codes:
            self._take_code(index, text, code, values, is_macro)
        if 53.0 in codes:
            self._machine(index, text, values)
        elif 4.0 in codes or is_macro:
            return
        elif "K" in values:
            self._nurbs(index, text, values, 6.2 in codes)
        elif any(letter in values for letter in (*"XYZ", *self._rotary_letters)):
            self._motion(index, text, values, 43.4 in codes)
        elif "F" in values:
            self._feed = values["F"]

    def _spindle(self, index: int, text: str, code: int, words: list[tuple[str, str]], is_macro: bool) -> None:
        if code == 3:
            self._state.rpm = next(float(value) for letter, value in words if letter == "S")
        elif code == 5:
            self._state.rpm = 0.0
        elif not is_macro:
            raise unread(index, text, f"M{code}")

    def _take_code(self, index: int, text: str, code: float, values: dict[str, float], is_macro: bool) -> None:
        if code in (0.0, 1.0, 6.2):
            if self._poles and code != 6.2:
                raise unread(index, text, "a NURBS is not complete")
            self._code = code
        elif code == 43.4:
            if not self._modes >= _NEEDED:
                raise unread(index, text, "the modes that it relies on are not set")
            if values.get("H") != float(self._state.tool):
                raise unread(index, text, "the length of another tool")
            self._follows_tip = True
        elif code == 49.0:
            self._follows_tip = False
        elif code in _MODES:
            self._modes.add(code)
        elif code not in (4.0, 53.0) and not is_macro:
            raise unread(index, text, f"G{code:g}")

    def _machine(self, index: int, text: str, values: dict[str, float]) -> None:
        if self._follows_tip or self._code != 0.0 or not set(self._letters) & values.keys():
            raise unread(index, text, "machine positions need G49, G00 and an axis")
        told = {letter: values[letter] for letter in self._letters if letter in values}
        self.reading.joints[len(self.reading.rows)] = told
        self._place = {letter: self._place[letter] for letter in self._rotary_letters if letter in self._place}
        self._place.update((letter, value) for letter, value in told.items() if letter in self._rotary_letters)
        self.reading.add((index, index), How.MACHINE, NAN3, NAN3, 0.0, self._state, self._rotary())

    def _motion(self, index: int, text: str, values: dict[str, float], is_switch: bool) -> None:
        if not self._follows_tip or self._code not in (0.0, 1.0):
            raise unread(index, text, "a position of the tip without G43.4")
        self._feed = values.get("F", self._feed)
        self._place.update((letter, values[letter]) for letter in (*"XYZ", *self._rotary_letters) if letter in values)
        how = How.RAPID if self._code == 0.0 else How.LINE
        if not is_switch:
            self.reading.add((index, index), how, self._tip(index, text), NAN3, self._feed, self._state, self._rotary())

    def _nurbs(self, index: int, text: str, values: dict[str, float], begins: bool) -> None:
        if not self._follows_tip or self._code != 6.2 or begins == bool(self._poles):
            raise unread(index, text, "a knot outside a NURBS")
        outputs = (self._state.gate, *self._state.levels)
        if begins:
            self._rank, self._first, self._knots, self._outputs = int(values.get("P", 4.0)), index, [], outputs
        self._knots.append(values["K"])
        if "X" in values or "Y" in values or "Z" in values:
            if len(self._knots) != len(self._poles) + 1 or any(letter in values for letter in self._rotary_letters):
                raise unread(index, text, "a pole behind the last knots, or a rotary axis")
            self._place.update((letter, values[letter]) for letter in "XYZ" if letter in values)
            self._poles.append((*self._tip(index, text), values.get("R", 1.0)))
        self._feed = values.get("F", self._feed)
        if len(self._knots) == len(self._poles) + self._rank:
            self._complete(index, text)

    def _complete(self, index: int, text: str) -> None:
        rows = np.array(self._poles)
        self._poles = []
        curve = ReadCurve(self._rank - 1, np.array(self._knots), rows[:, :3], rows[:, 3])
        if curve.fault:
            raise unread(index, text, curve.fault)
        self.reading.curves.append(curve)
        number = len(self.reading.curves) - 1
        tip = tuple(rows[-1, :3].tolist())
        self.reading.add((self._first, index), How.CURVE, tip, NAN3, self._feed, self._state, self._rotary(), number)

    def _tip(self, index: int, text: str) -> tuple[float, ...]:
        if not all(letter in self._place for letter in "XYZ"):
            raise unread(index, text, "nobody knows where the tip is")
        return (self._place["X"], self._place["Y"], self._place["Z"])

    def _rotary(self) -> tuple[float, ...]:
        return tuple(self._place.get(letter, float("nan")) for letter in self._rotary_letters)

    def finish(self, lines: Sequence[str]) -> Reading:
        """All of it. Raises PostError if the program does not end."""
        if not self._state.ended or self._poles or self._marks != 2 or lines[-1] != "%":
            raise unread(len(lines) - 1, lines[-1], "the program does not end")
        self.reading.ended = True
        return self.reading


def read(lines: Sequence[str], letters: Sequence[str], signals: Signals) -> Reading:
    """Motions of a program. Raises PostError with the line that cannot be read."""
    return read_lines(_Reader(letters, signals), lines)
