"""The permissives of laser emission: a pure function of levels and their ages, evaluated at every tick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cellctl.domain.reactions import INTERLOCK_CAUSE, REACTIONS
from cellctl.domain.snapshot import Permissive

NAMES = ("state", "fault", "interlocks", "laser", "feeder", "cnc", "dead_man", "depositing", "moving")


@dataclass(frozen=True)
class Signal:
    """A level and how old it is. `stale_s` is the age from which it counts as unsafe, whatever it says; `meaning` is its words."""

    value: float
    age_s: float
    stale_s: float
    meaning: str = ""

    @property
    def is_fresh(self) -> bool:
        """Whether the reading is younger than its stale limit (NaN is not)."""
        return self.age_s < self.stale_s


@dataclass(frozen=True)
class Levels:
    """Everything that emission depends on, as it stands at one tick.

    interlocks : level of the I/O coupler by name, 1 = safe; laser_words, feeder_words : flag words, 0 = safe
    heartbeats : per device, the heartbeat that it echoes (only its age counts)
    """

    is_running: bool = False
    is_faulted: bool = False
    is_depositing: bool = False
    is_moving: bool = False
    why_not_moving: str = ""
    cnc_state: str = ""
    cnc_age_s: float = 1e9
    cnc_stale_s: float = 0.5
    interlocks: Mapping[str, Signal] = field(default_factory=dict)
    laser_words: Mapping[str, Signal] = field(default_factory=dict)
    laser_enabled: bool = False
    feeder_words: Mapping[str, Signal] = field(default_factory=dict)
    heartbeats: Mapping[str, Signal] = field(default_factory=dict)


def unsafe_interlocks(interlocks: Mapping[str, Signal]) -> list[tuple[str, str]]:
    """(name, why) of every interlock that is not at its safe level, stale or missing."""
    found = []
    for name in INTERLOCK_CAUSE:
        signal = interlocks.get(name)
        if signal is None:
            found.append((name, f"{name} was never read"))
        elif not signal.is_fresh:
            found.append((name, f"{name} is {signal.age_s:.2f} s old"))
        elif not signal.value:
            found.append((name, REACTIONS[INTERLOCK_CAUSE[name]].cause))
    return found


def _words(words: Mapping[str, Signal]) -> str:
    """Why a device's flag words are not all fresh and 0; empty when they are."""
    if not words:
        return "was never read"
    for name, signal in words.items():
        if not signal.is_fresh:
            return f"{name} is {signal.age_s:.2f} s old"
        if signal.value:
            return signal.meaning or f"{name} is {int(signal.value):#x}"
    return ""


def permissives(levels: Levels) -> list[Permissive]:
    """Each condition of emission with its level now. Source: design.md, invariant 1."""
    interlocks = unsafe_interlocks(levels.interlocks)
    laser = _words(levels.laser_words) or ("" if levels.laser_enabled else "is not enabled")
    feeder = _words(levels.feeder_words)
    dead = [name for name, signal in levels.heartbeats.items() if not signal.is_fresh]
    if not levels.cnc_age_s < levels.cnc_stale_s:
        cnc = f"status is {levels.cnc_age_s:.2f} s old"
    else:
        cnc = "" if levels.cnc_state == "Run" else f"CNC is {levels.cnc_state or 'unknown'}"
    reasons = {
        "state": "" if levels.is_running else "no job is running",
        "fault": "a fault is latched" if levels.is_faulted else "",
        "interlocks": "; ".join(why for _, why in interlocks),
        "laser": laser,
        "feeder": feeder,
        "cnc": cnc,
        "dead_man": f"no heartbeat from {', '.join(dead)}" if dead or not levels.heartbeats else "",
        "depositing": "" if levels.is_depositing else "no depositing pass",
        "moving": "" if levels.is_moving else (levels.why_not_moving or "the tip stands still"),
    }
    return [Permissive(name, not reasons[name], reasons[name]) for name in NAMES]


def may_emit(conditions: list[Permissive]) -> bool:
    """Whether every condition is met; none at all is not."""
    return bool(conditions) and all(condition.ok for condition in conditions)
