"""Recorded exchanges with real firmware: how they are read, and what plain rules say of the bytes that came."""

from __future__ import annotations

import json
import re
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path

FOLDER = Path(__file__).resolve().parent / "recorded"
REPORT = re.compile(
    r"<\w+(:\d+)?\|MPos:[-\d.,]+(\|Bf:\d+,\d+)?(\|Ln:\d+)?\|FS:\d+,\d+(\|Pn:[A-Z]+)?(\|WCO:[-\d.,]+)?(\|Ov:\d+,\d+,\d+)?(\|A:[A-Z]*)?"
    r"(\|H:\d(,\d+)?)?(\|T:\d+)?(\|TLR:\d)?>"
)
REAL_TIME = frozenset(b"?!~\x18" + bytes(range(0x80, 0x100)))  # never part of a line


def is_damaged(report: str) -> bool:
    """Whether a byte of a status report was changed on its way (the serial port of grbl's simulator does so when it is late)."""
    return REPORT.fullmatch(report) is None


@dataclass(frozen=True)
class Exchange:
    """Bytes in both directions in the order of time. steps : seconds, whether from the firmware, bytes"""

    name: str
    firmware: str
    letters: tuple[str, ...]
    steps: tuple[tuple[float, bool, bytes], ...]


def exchanges() -> list[Exchange]:
    """All that were recorded, by name."""
    found = []
    for path in sorted(FOLDER.glob("*.txt")):
        rows = [row for row in path.read_text(encoding="utf-8").splitlines() if row]
        head = "\n".join(row for row in rows if row.startswith("#"))
        steps = []
        for row in rows:
            if not row.startswith("#"):
                at, way, text = row.split(" ", 2)
                steps.append((float(at), way == "<", json.loads(text).encode("latin-1")))
        letters = ("X", "Y", "Z", "A", "C") if "XYZAC" in head else ("X", "Y", "Z")
        found.append(Exchange(path.stem, "grblhal" if "grblHAL" in head else "grbl", letters, tuple(steps)))
    return found


@dataclass
class Reading:
    """What plain rules make of an exchange: an `ok` or `error:n` belongs to the oldest line without an answer.

    accepted, refused : the lines, in order of their answers; refused with its code   nothing : answers that no line waited for
    alarms : codes; banners, messages, reports : texts as they came    open_bytes : of lines without an answer at the end
    """

    accepted: list[str] = field(default_factory=list)
    refused: list[tuple[str, int]] = field(default_factory=list)
    nothing: int = 0
    alarms: list[int] = field(default_factory=list)
    banners: list[str] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)
    reports: list[str] = field(default_factory=list)
    forgotten: list[int] = field(default_factory=list)
    open_bytes: int = 0


def read_plainly(exchange: Exchange) -> Reading:
    """Line by line, with nothing of ours."""
    reading, waiting = Reading(), deque[str]()
    to_host = to_firmware = b""
    for _, from_firmware, data in exchange.steps:
        if not from_firmware:
            *whole, to_firmware = (to_firmware + bytes(b for b in data if b not in REAL_TIME)).split(b"\n")
            waiting.extend(line.decode("latin-1") for line in whole)
            continue
        *whole, to_host = (to_host + data).split(b"\r\n")
        for line in (each.decode("latin-1") for each in whole):
            _take(line, reading, waiting)
    reading.open_bytes = sum(len(line) + 1 for line in waiting)
    return reading


def _take(line: str, reading: Reading, waiting: deque[str]) -> None:
    if line == "ok" or line.startswith("error:"):
        if not waiting:
            reading.nothing += 1
        elif line == "ok":
            reading.accepted.append(waiting.popleft())
        else:
            reading.refused.append((waiting.popleft(), int(line[6:])))
    elif line.startswith("<"):
        reading.reports.append(line)
    elif line.startswith("ALARM:"):
        reading.alarms.append(int(line[6:]))
    elif line.startswith(("Grbl ", "GrblHAL ")):
        reading.banners.append(line)
        reading.forgotten.append(len(waiting))
        waiting.clear()
    elif line.startswith("[MSG:"):
        reading.messages.append(line[5:-1])
