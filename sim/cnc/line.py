"""The serial side of the firmware: receive ring, lines out of it, and the answers' way back with its faults."""

from __future__ import annotations

import re

REAL_TIME = re.compile(rb"[\x18\x19?!~\x80-\xff]")


class ReceiveRing:
    """Bytes not yet parsed. One place stays free, as in every ring; what does not fit is lost without a word.

    A parser that is free takes the characters of an unfinished line out of the ring into its line buffer.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self._bytes = bytearray()
        self._line = bytearray()
        self.lost = 0

    @property
    def free(self) -> int:
        """Bytes that still fit (`Bf:` says this)."""
        return self.size - 1 - len(self._bytes)

    @property
    def has_line(self) -> bool:
        """Whether a whole line waits."""
        return b"\n" in self._bytes or b"\r" in self._bytes

    def put(self, data: bytes) -> None:
        """Store what fits."""
        room = self.free
        if len(data) > room:
            self.lost += len(data) - room
            data = data[:room]
        self._bytes += data

    def take_line(self, carriage_return_ends: bool) -> str | None:
        """The oldest whole line without its end, or None. With `carriage_return_ends` (grbl) `\\r\\n` makes two lines."""
        cut = self._bytes.find(b"\n")
        if carriage_return_ends:
            other = self._bytes.find(b"\r")
            cut = other if cut < 0 else cut if other < 0 else min(cut, other)
        if cut < 0:
            self._line += self._bytes
            self._bytes.clear()
            return None
        line = (self._line + self._bytes[:cut]).decode("latin-1")
        self._line.clear()
        del self._bytes[: cut + 1]
        return line if carriage_return_ends else line.rstrip("\r")

    def clear(self) -> None:
        """Forget everything."""
        self._bytes.clear()
        self._line.clear()


class Transmitter:
    """Answers on their way to the host, and what noise does to them: counts of `ok` to lose, to double and of answers to garble."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self.oks_to_lose = 0
        self.oks_to_double = 0
        self.answers_to_garble = 0
        self.is_silent = False

    def say(self, text: str) -> None:
        """One line to the host."""
        if not self.is_silent:
            self._bytes += text.encode("ascii") + b"\r\n"

    def answer(self, error: int = 0) -> None:
        """`ok`, or `error:n`."""
        text = f"error:{error}" if error else "ok"
        if self.answers_to_garble:
            self.answers_to_garble -= 1
            text = text[:1] + "*" + text[2:]
        elif not error and self.oks_to_lose:
            self.oks_to_lose -= 1
            return
        elif not error and self.oks_to_double:
            self.oks_to_double -= 1
            self.say(text)
        self.say(text)

    def take(self) -> bytes:
        """Everything said since the last call."""
        data = bytes(self._bytes)
        self._bytes.clear()
        return data
