"""The original's remaining lines with new numbers: each as it stands, but for the modal words that the first of them took for granted."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.errors import PostError, ResumeError
from planner.program import Program

_NUMBER = re.compile(r"N\d+")
_COMMENT = re.compile(r"\([^)]*\)")
_WORD = re.compile(r"([A-Z])\s*([-+]?(?:\d+\.?\d*|\.\d+))")
_MOTIONS = {"0": 0, "1": 1, "2": 2, "3": 3}
_FEED_MODES = {"93", "94"}


@dataclass(frozen=True)
class Modal:
    """What a control keeps from line to line, as a text says it; None: not said yet.  motion : 0 to 3   mode : "93" or "94"   feed : digits"""

    motion: int | None = None
    mode: str | None = None
    feed: str | None = None

    def after(self, line: str) -> Modal:
        """What holds behind a line."""
        state = self
        for letter, value in _WORD.findall(_COMMENT.sub("", line)):
            code = value.lstrip("0").split(".")[0] or "0" if letter == "G" and float(value).is_integer() else ""
            if letter == "G" and code in _MOTIONS:
                state = replace(state, motion=_MOTIONS[code])
            elif letter == "G" and code in _FEED_MODES:
                state = replace(state, mode=code, feed=state.feed if state.mode == code else None)
            elif letter == "F" and state.mode != "93":
                state = replace(state, feed=value)
        return state


def modal_before(lines: Sequence[str], line: int) -> Modal:
    """What holds when a line begins, looked for backwards as far as need be."""
    motion: int | None = None
    mode: str | None = None
    feed: str | None = None
    for text in (lines[k] for k in range(line - 1, -1, -1)):
        if "G" not in text and "F" not in text:
            continue
        own = Modal(mode="94").after(text)
        said = Modal().after(text).mode
        motion = own.motion if motion is None else motion
        if mode is None:
            feed = own.feed if feed is None and own.mode == "94" else feed
            mode = said
        if motion is not None and mode is not None:
            break
    return Modal(motion, mode, feed if mode == "94" else None)


def rest_of(program: Program, first: int, before: Modal, head_lines: int, length_max: int) -> tuple[str, ...]:
    """Lines of the original from index `first` on, numbered behind the head.  before : what holds behind the head

    Raises PostError if a line becomes too long for the control, ResumeError where the original's modal state is not known.
    """
    wanted = modal_before(program.lines, first)
    lines = [_NUMBER.sub(f"N{head_lines + 1 + k}", text, count=1) for k, text in enumerate(program.lines[first:])]
    for k, text in enumerate(program.lines[first:]):
        if before == wanted:
            break
        added = _completed(lines[k], before, wanted)
        before, wanted = before.after(added), wanted.after(text)
        lines[k] = added
    longest = max(range(len(lines)), key=lambda k: len(lines[k]))
    if len(lines[longest]) >= length_max:
        raise PostError(
            f"line {head_lines + longest + 1} has {len(lines[longest])} characters, the controller takes fewer than {length_max}",
            "raise cnc.line_length_max if the firmware takes it",
        )
    return tuple(lines)


def _completed(line: str, before: Modal, wanted: Modal) -> str:
    """The line with the modal words that it needs and that do not hold; lines without axis words stay as they are."""
    words = dict(_WORD.findall(_COMMENT.sub("", line)))
    own = Modal().after(line)
    if not any(letter in words for letter in "XYZABC") or "M" in words or _is_other(line):
        return line
    motion = wanted.motion if own.motion is None else own.motion
    if motion is None:
        raise ResumeError(f"{line!r}: how it moves is not said before it", "post the plan again")
    said = "" if own.motion is not None or before.motion == motion else f"G{motion}"
    mode = wanted.mode if own.mode is None else own.mode
    if motion != 0 and own.mode is None and before.mode != mode:
        said = f"G{mode}" + said
    feed = ""
    if motion != 0 and mode == "94" and "F" not in words and (before.mode != "94" or before.feed != wanted.feed):
        feed = f"F{wanted.feed}"
    number = _NUMBER.match(line)
    place = number.end() if number else 0
    return line[:place] + said + line[place:] + feed


def _is_other(line: str) -> bool:
    """Whether a line commands something else than a plain move: dwells, references, offsets."""
    codes = [value for letter, value in _WORD.findall(_COMMENT.sub("", line)) if letter == "G"]
    return any(value.lstrip("0") not in {"", "1", "2", "3", "93", "94", "90", "17", "21", "54"} for value in codes)


def rest_of_table(program: Program, first: int, head: NDArray[np.void]) -> NDArray[np.void]:
    """Table of the whole: the head's rows, then the original's with new numbers and times."""
    rest = program.table[first:].copy()
    head_s = float(head["time_end_s"][-1])
    begun_s = float(rest["time_start_s"][0])
    rest["n"] = np.arange(len(head) + 1, len(head) + len(rest) + 1)
    for name in ("time_start_s", "time_end_s"):
        rest[name] += head_s - begun_s
    return np.concatenate([head, rest])


def rest_of_schedule(program: Program, first: int, head: NDArray[np.void], head_lines: int) -> NDArray[np.void]:
    """Schedule of the whole; what the head sets for the first remaining line comes before what the original sets there."""
    rest = program.schedule[program.schedule["n"] > first].copy()
    rest["n"] += head_lines - first
    return np.concatenate([head, rest])
