"""Scripted faults: a text such as `at=12.5s door_open` or `line=120 estop`, and what it does to the simulated cell."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim.fault_kinds import DEVICES, INTERLOCKS, KINDS, WORDS, Kind

if TYPE_CHECKING:
    from sim.world import World

SIGNED = ("registers", "value")  # numbers that may be below zero
PORT_NAME = re.compile(r"[A-Za-z0-9._-]{1,64}")


class FaultScriptError(Exception):
    """A fault text that cannot be understood. `message` is one line, `hint` says how it is written."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint or "write '[at=SECONDSs|line=N] KIND [ARGUMENTS]'; kinds: " + ", ".join(sorted(KINDS))


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong: when (process time, or when a line begins to execute; neither: at once), what, and with which arguments."""

    kind: str
    arguments: tuple[str | float, ...] = ()
    at_s: float | None = None
    line: int | None = None

    def __str__(self) -> str:
        when = f"at={self.at_s:g}s " if self.at_s is not None else f"line={self.line} " if self.line is not None else ""
        return when + " ".join([self.kind, *(f"{a:g}" if isinstance(a, float) else a for a in self.arguments)]).rstrip()


def parse_fault(text: str) -> Fault:
    """Fault of one text.

    Raises FaultScriptError with one line that names the word at fault.
    """
    words = text.split()
    at_s: float | None = None
    line: int | None = None
    if words and "=" in words[0]:
        name, _, value = words.pop(0).partition("=")
        if name == "at":
            at_s = _number(text, value.removesuffix("s"), "a time in seconds")
        elif name == "line":
            line = int(_number(text, value, "a line number"))
        else:
            raise FaultScriptError(f"fault '{text}': '{name}=' is unknown, at= and line= are known")
    if not words:
        raise FaultScriptError(f"fault '{text}': says nothing that goes wrong")
    kind = KINDS.get(words[0])
    if kind is None:
        raise FaultScriptError(f"fault '{text}': '{words[0]}' is unknown")
    return Fault(words[0], _arguments(text, kind, words[1:]), at_s, line)


def _arguments(text: str, kind: Kind, words: Sequence[str]) -> tuple[str | float, ...]:
    least, most = len(kind.parameters) - len(kind.defaults), len(kind.parameters)
    if not least <= len(words) <= most:
        needs = " ".join(kind.parameters) or "no argument"
        raise FaultScriptError(f"fault '{text}': needs {needs}, has {len(words)} argument(s)")
    found: list[str | float] = []
    for name, word in zip(kind.parameters, words, strict=False):
        found.append(_word(text, name, word) if name in WORDS else _number(text, word, name))
    return (*found, *kind.defaults[len(words) - least :])


def _word(text: str, name: str, word: str) -> str:
    known = {"device": DEVICES, "interlock": INTERLOCKS}.get(name)
    if known is not None and word not in known:
        raise FaultScriptError(f"fault '{text}': no {name} '{word}'; {name}s: {', '.join(known)}")
    if name == "port" and not PORT_NAME.fullmatch(word):
        raise FaultScriptError(f"fault '{text}': '{word}' is no port's name", "letters, digits, dots and dashes")
    return word


def _number(text: str, word: str, what: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = float("nan")
    if not math.isfinite(value) or (value < 0.0 and what not in SIGNED):
        raise FaultScriptError(f"fault '{text}': '{word}' is not {what}")
    return value


class Faults:
    """Faults to come, in no particular order, and those that have been. registers : names by device, for faults that name one."""

    def __init__(self, registers: Mapping[str, frozenset[str]] | None = None) -> None:
        self.pending: list[Fault] = []
        self.past: list[Fault] = []
        self._registers = registers

    def add(self, fault: Fault | str) -> Fault:
        """Schedule a fault. Raises FaultScriptError."""
        parsed = parse_fault(fault) if isinstance(fault, str) else fault
        parameters = KINDS[parsed.kind].parameters
        if self._registers is not None and "register" in parameters:
            given = dict(zip(parameters, parsed.arguments, strict=True))
            device, register = str(given["device"]), str(given["register"])
            if register not in self._registers[device]:
                known = ", ".join(sorted(self._registers[device]))
                raise FaultScriptError(f"fault '{parsed}': {device} has no register '{register}'", f"its registers: {known}")
        self.pending.append(parsed)
        return parsed

    @property
    def waits_for_line(self) -> bool:
        """Whether one of them hangs on a line."""
        return any(fault.line is not None for fault in self.pending)

    def until_next(self, now_s: float) -> float:
        """Seconds to the next timed one; infinite without."""
        return min(
            (max(fault.at_s - now_s, 0.0) for fault in self.pending if fault.at_s is not None), default=float("inf")
        )

    def strike(self, world: World) -> None:
        """Let everything happen that is due."""
        executing = world.cnc.machine.motion.line
        for fault in list(self.pending):
            is_due = fault.line is None if fault.at_s is None else fault.at_s <= world.time_s + 1e-9
            if fault.line is not None:
                is_due = executing >= fault.line
            if is_due:
                self.pending.remove(fault)
                self.past.append(fault)
                KINDS[fault.kind].act(world, *fault.arguments)
