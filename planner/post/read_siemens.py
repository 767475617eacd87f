"""Reads programs for a Sinumerik 840D as the control would; shares no code with the writer.

Source: Siemens, SINUMERIK 840D sl Programming Manual Fundamentals and Job Planning (see the words below); B-spline: the start position is the first
pole, PL the span before each next knot.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from planner.post.read_nurbs import ReadCurve
from planner.post.reading import NAN3, How, Reading, Signals, State, read_lines, unread

_LINE = re.compile(r"N(\d+) (.*)")
_WORD = re.compile(r"([A-Z]+[0-9]?)=([-+]?[0-9.]+)|([A-Z])([-+]?[0-9.]+)|([A-Z]+)")
_MOTION = re.compile(r"[XYZF][-+0-9.]|G[01] |BSPLINE |SUPA |ORICURVE |ORIVECT |[ABC]3=")
_GROUP_1 = {"G0", "G1", "BSPLINE"}
_MODES = {"G17", "G40", "G710", "G90", "G94", "G642", "SOFT", "FFWON", "ORIWKS", "RTLION", "G54", "D0", "D1"}
_NEEDED = {"G710", "G90", "G94", "ORIWKS"}
_FEED_GROUP = "FGROUP(X,Y,Z)"


class _Reader:
    """Modal state, line by line."""

    def __init__(self, letters: Sequence[str], signals: Signals) -> None:
        self._letters = set(letters)
        self._signals = signals
        self.reading = Reading()
        self._state = State()
        self._modes: set[str] = set()
        self._code = ""
        self._transforms = False
        self._along_curve = False
        self._tip: dict[str, float] = {}
        self._axis: tuple[float, ...] = NAN3
        self._second: tuple[float, ...] = NAN3
        self._feed = 0.0
        self._spline: list[tuple[float, ...]] = []  # x y z, second point, span, weight
        self._degree = 3
        self._from = (0, 0)
        self._spline_state: tuple[float, ...] = ()

    def line(self, index: int, text: str) -> None:
        """Take one line."""
        match = _LINE.fullmatch(text)
        if not match or int(match[1]) != index + 1:
            raise unread(index, text, "its N-word")
        body = match[2]
        if body[0] == ";":
            return
        meaning = None if _MOTION.match(body) else self._signals.meaning(body)
        if meaning is not None and meaning[0]:
            self._state.take(*meaning)
        elif body == _FEED_GROUP:
            self._modes.add(body)
        else:
            self._words(index, text, body, meaning is not None)

    def _words(self, index: int, text: str, body: str, is_macro: bool) -> None:
        values: dict[str, float] = {}
        keys: list[str] = []
        for token in body.split(" "):
            match = _WORD.fullmatch(token)
            if match is None:
                if is_macro:
                    continue
                raise unread(index, text, token)
            name, number, letter, short, key = match.groups()
            if name:
                values[name] = float(number)
            elif key:
                keys.append(key)
            elif letter in "GMD":
                keys.append(letter + short)
            else:
                values[letter] = float(short)
        self._keys(index, text, keys, values, is_macro)
        if "SUPA" in keys:
            self._machine(index, text, values)
        elif self._letters & values.keys() or any(name in values for name in ("A3", "XH", "PL")):
            self._motion(index, text, values)

    def _keys(self, index: int, text: str, keys: list[str], values: dict[str, float], is_macro: bool) -> None:
        for key in keys:
            if key in _GROUP_1:
                self._end_spline(index, text)
                self._code = key
                if key == "BSPLINE":
                    self._begin_spline(index, text, values)
            elif key in ("TRAORI", "TRAFOOF"):
                self._end_spline(index, text)
                self._transforms = key == "TRAORI"
                if self._transforms and not (_NEEDED | {_FEED_GROUP}) <= self._modes:
                    raise unread(index, text, "the modes that it relies on are not set")
            elif key in ("ORICURVE", "ORIVECT"):
                self._end_spline(index, text)
                self._along_curve = key == "ORICURVE"
            elif key == "M3":
                self._state.rpm = values.get("S", 0.0)
            elif key == "M5":
                self._state.rpm = 0.0
            elif key in _MODES:
                self._modes.add(key)
            elif key not in ("SUPA", "G4") and not is_macro:
                raise unread(index, text, key)
        if "G4" in keys:
            self._end_spline(index, text)
            values.pop("F", None)

    def _machine(self, index: int, text: str, values: dict[str, float]) -> None:
        if self._transforms or self._code != "G0" or not self._letters & values.keys():
            raise unread(index, text, "machine positions need TRAFOOF, G0 and an axis")
        self.reading.joints[len(self.reading.rows)] = {
            letter: values[letter] for letter in self._letters & values.keys()
        }
        self.reading.add((index, index), How.MACHINE, NAN3, NAN3, 0.0, self._state)
        self._tip, self._axis = {}, NAN3

    def _motion(self, index: int, text: str, values: dict[str, float]) -> None:
        if not self._transforms:
            raise unread(index, text, "a position of the tip without TRAORI")
        self._feed = values.get("F", self._feed)
        self._tip.update((letter, values[letter]) for letter in "XYZ" if letter in values)
        tip = tuple(self._tip.get(letter, float("nan")) for letter in "XYZ")
        if "A3" in values:
            self._axis = _unit(values["A3"], values["B3"], values["C3"])
        if "XH" in values:
            self._second = (values["XH"], values["YH"], values["ZH"])
            self._axis = _unit(*(far - near for far, near in zip(self._second, tip, strict=True)))
            if not self._along_curve:
                raise unread(index, text, "a second point without ORICURVE")
        if self._code == "BSPLINE":
            if (self._state.gate, *self._state.levels) != self._spline_state:
                raise unread(index, text, "an output changes within a spline")
            if "PL" not in values:
                raise unread(index, text, "the control would choose the knot")
            self._spline.append((*tip, *self._second, values["PL"], values.get("PW", 1.0)))
            self._from = (self._from[0], index)
        else:
            how = How.RAPID if self._code == "G0" else How.LINE
            self.reading.add((index, index), how, tip, self._axis, self._feed, self._state)

    def _begin_spline(self, index: int, text: str, values: dict[str, float]) -> None:
        if len(self._tip) != 3 or not self._transforms:
            raise unread(index, text, "a spline without a start")
        self._degree = int(values.get("SD", 3.0))
        start = tuple(self._tip[letter] for letter in "XYZ")
        self._spline = [(*start, *self._second, 0.0, 1.0)]
        self._from = (index, index)
        self._spline_state = (self._state.gate, *self._state.levels)

    def _end_spline(self, index: int, text: str) -> None:
        if not self._spline:
            return
        rows = np.array(self._spline)
        self._spline = []
        knots = np.cumsum(np.concatenate([np.zeros(self._degree), rows[:, 6], [0.0]]))
        second = rows[:, 3:6] if self._along_curve else None
        curve = ReadCurve(self._degree, knots, rows[:, :3], rows[:, 7], second)
        if curve.fault or len(rows) < 2:
            raise unread(self._from[0], text, curve.fault or "a spline of one pole")
        self.reading.curves.append(curve)
        state = State(
            self._state.tool, self._state.rpm, self._spline_state[0], self._spline_state[1:], self._state.mode
        )
        tip = tuple(rows[-1, :3].tolist())
        axis = _unit(*(rows[-1, 3:6] - rows[-1, :3]).tolist()) if self._along_curve else self._axis
        self.reading.add(self._from, How.CURVE, tip, axis, self._feed, state, curve=len(self.reading.curves) - 1)

    def finish(self, lines: Sequence[str]) -> Reading:
        """All of it. Raises PostError if the program does not end."""
        if not self._state.ended or self._spline:
            raise unread(len(lines) - 1, lines[-1], "the program does not end")
        self.reading.ended = True
        return self.reading


def _unit(x: float, y: float, z: float) -> tuple[float, ...]:
    length = float((x * x + y * y + z * z) ** 0.5)
    return (x / length, y / length, z / length) if length > 0.0 else NAN3


def read(lines: Sequence[str], letters: Sequence[str], signals: Signals) -> Reading:
    """Motions of a program. Raises PostError with the line that cannot be read."""
    return read_lines(_Reader(letters, signals), lines)
