"""Reads APT cutter location data as a post processor would; shares no code with the writer.

Source: ISO 4343; RAPID holds for the next motion, FEDRAT until the next one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from planner.post.reading import How, Reading, Signals, State, read_lines, unread

_STATEMENT = re.compile(r"([A-Z]+)(?:/(.*))?")
_FEED = re.compile(r"(\d*\.?\d+),MMPM")
_SPEED = re.compile(r"(\d*\.?\d+),RPM,CLW")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)")
_NEEDED = {("UNITS", "MM"), ("MULTAX", "ON")}


class _Reader:
    """Modal state, statement by statement."""

    def __init__(self, signals: Signals) -> None:
        self._signals = signals
        self.reading = Reading()
        self._state = State()
        self._modes: set[tuple[str, str]] = set()
        self._is_rapid = False
        self._feed = 0.0

    def line(self, index: int, text: str) -> None:
        """Take one statement."""
        if text.startswith("GOTO/"):
            self._goto(index, text, text[5:].split(","))
            return
        match = _STATEMENT.fullmatch(text)
        if not match or (index == 0) != (match[1] == "PARTNO") or self._state.ended:
            raise unread(index, text)
        word, rest = match[1], match[2] or ""
        meaning = None if word in ("PPRINT", "PARTNO", "FEDRAT", "RAPID") else self._signals.meaning(text)
        if (word, rest) in _NEEDED:
            self._modes.add((word, rest))
        if meaning is not None:
            if meaning[0]:
                self._state.take(*meaning)
        elif word == "RAPID" and not rest:
            self._is_rapid = True
        elif word == "FEDRAT" and (feed := _FEED.fullmatch(rest)):
            self._feed = float(feed[1])
        elif word == "SPINDL":
            speed = _SPEED.fullmatch(rest)
            if speed is None and rest != "OFF":
                raise unread(index, text)
            self._state.rpm = float(speed[1]) if speed else 0.0
        elif word not in ("PPRINT", "PARTNO", "DELAY"):
            raise unread(index, text)

    def _goto(self, index: int, text: str, numbers: list[str]) -> None:
        if len(numbers) != 6 or not self._modes >= _NEEDED or not all(_NUMBER.fullmatch(number) for number in numbers):
            raise unread(index, text, "GOTO has six numbers, behind UNITS/MM and MULTAX/ON")
        x, y, z, i, j, k = (float(number) for number in numbers)
        length = (i * i + j * j + k * k) ** 0.5
        if abs(length - 1.0) > 1e-4:
            raise unread(index, text, "the axis is no unit vector")
        how = How.RAPID if self._is_rapid else How.LINE
        axis = (i / length, j / length, k / length)
        self.reading.add((index, index), how, (x, y, z), axis, self._feed, self._state)
        self._is_rapid = False

    def finish(self, lines: Sequence[str]) -> Reading:
        """All of it. Raises PostError if the program does not end."""
        if not self._state.ended:
            raise unread(len(lines) - 1, lines[-1], "the program does not end")
        self.reading.ended = True
        return self.reading


def read(lines: Sequence[str], letters: Sequence[str], signals: Signals) -> Reading:
    """Motions of a program; letters do not matter. Raises PostError with the statement that cannot be read."""
    return read_lines(_Reader(signals), lines)
