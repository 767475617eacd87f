"""What one accepted line asks the machine to do, in the order of execution."""

from __future__ import annotations

from dataclasses import dataclass

RAPID, FEED, INVERSE_TIME = 0, 1, 2


@dataclass(slots=True, frozen=True)
class Move:
    """A straight joint move. `value` is mm/min (or deg/min) for FEED, seconds for INVERSE_TIME, unused for RAPID."""

    target: tuple[float, ...]
    kind: int
    value: float
    line: int


@dataclass(slots=True, frozen=True)
class Dwell:
    """G4."""

    seconds: float


@dataclass(slots=True, frozen=True)
class Spindle:
    """M3, M4, M5 or a new S while turning; direction is 1, -1 or 0."""

    direction: int
    rpm: float


@dataclass(slots=True, frozen=True)
class Coolant:
    """M7, M8, M9: flood and mist."""

    flood: bool
    mist: bool


@dataclass(slots=True, frozen=True)
class ToolChange:
    """M6."""

    tool: int


@dataclass(slots=True, frozen=True)
class Output:
    """M62 to M65: digital output `port`; synchronised ones wait for the start of the next motion."""

    port: int
    on: bool
    synchronised: bool


@dataclass(slots=True, frozen=True)
class Pause:
    """M0."""


@dataclass(slots=True, frozen=True)
class ProgramEnd:
    """M2, M30."""


Action = Move | Dwell | Spindle | Coolant | ToolChange | Output | Pause | ProgramEnd
