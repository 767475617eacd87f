"""From the characters of one line to its words: comments and blanks out, letters up, numbers read as grbl reads them."""

from __future__ import annotations

import re

from sim.cnc.codes import BAD_NUMBER, EXPECTED_LETTER, GcodeError

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)"
_WORD = re.compile(rf"([A-Z])({_NUMBER})")
_LINE = re.compile(rf"(?:[A-Z]{_NUMBER})*")
_COMMENT = re.compile(r"\([^)]*\)?|;.*")
_BLANK = re.compile(r"\s+")


def strip_line(text: str) -> str:
    """The line without comments and blanks, in capitals (system commands keep their blanks' absence too, as grbl does)."""
    if "(" in text or ";" in text:
        text = _COMMENT.sub("", text)
    return _BLANK.sub("", text).upper()


def words_of(stripped: str) -> list[tuple[str, float]]:
    """Letter and value of each word of a stripped line, in order.

    Raises GcodeError 1 where a letter is expected, 2 where a number is.
    """
    match = _LINE.match(stripped)
    if match is None or match.end() != len(stripped):
        rest = stripped[match.end() if match else 0 :]
        raise GcodeError(BAD_NUMBER if rest[:1].isalpha() else EXPECTED_LETTER)
    return [(letter, float(number)) for letter, number in _WORD.findall(stripped)]
