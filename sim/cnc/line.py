"""The serial side of the firmware: receive ring, lines out of it, and the answers' way back with its faults."""

from __future__ import annotations

import re

REAL_TIME = re.compile(rb"[\x18\x19?!~\x80-\xff]")
NOISE = b"*"  # what noise makes of a character: no firmware takes it
NOISE_AT = 3  # which character of a line it hits
HALF_AT = 8  # characters of a line that come through before it breaks off


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


class LineNoise:
    """What noise does to lines on their way from the host: counts of lines to garble and to halve. A half line has no end either."""

    def __init__(self) -> None:
        self.lines_to_garble = 0
        self.lines_to_halve = 0
        self._at = 0  # characters of the line under way that have come
        self._is_garbled = self._is_halved = False

    def pass_on(self, data: bytes) -> bytes:
        """The bytes (none of them real-time) that are left of `data`."""
        if not (self.lines_to_garble or self.lines_to_halve or self._is_garbled or self._is_halved):
            self._at = 0 if data.endswith(b"\n") else self._at + len(data)
            return data
        left = bytearray()
        for k in range(len(data)):
            left += self._pass(data[k : k + 1])
        return bytes(left)

    def _pass(self, byte: bytes) -> bytes:
        if self._at == 0 and byte != b"\n":
            self._is_garbled, self._is_halved = self.lines_to_garble > 0, self.lines_to_halve > 0
            self.lines_to_garble -= self._is_garbled
            self.lines_to_halve -= self._is_halved
        at, self._at = self._at, self._at + 1
        if byte == b"\n":
            is_lost = self._is_halved
            self._at, self._is_garbled, self._is_halved = 0, False, False
            return b"" if is_lost else byte
        if self._is_halved and at >= HALF_AT:
            return b""
        return NOISE if self._is_garbled and at == NOISE_AT else byte


class Transmitter:
    """Answers on their way to the host, and what noise does to them: counts of `ok` to lose, to double and of answers to garble.

    `reports_to_garble` are status reports; `lines_to_halve` are lines of any kind whose second half is lost, end and all.
    """

    def __init__(self) -> None:
        self._bytes = bytearray()
        self.oks_to_lose = 0
        self.oks_to_double = 0
        self.answers_to_garble = 0
        self.reports_to_garble = 0
        self.lines_to_halve = 0
        self.is_silent = False

    def say(self, text: str) -> None:
        """One line to the host."""
        if self.is_silent:
            return
        if self.reports_to_garble and text.startswith("<"):
            self.reports_to_garble -= 1
            text = text[: len(text) // 2] + "*" + text[len(text) // 2 + 1 :]
        end = "\r\n"
        if self.lines_to_halve and text:
            self.lines_to_halve -= 1
            text, end = text[: len(text) // 2], ""
        self._bytes += (text + end).encode("ascii")

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
