"""The permissives of laser emission: a pure function of levels and their ages, each with its level, its age and why it is not met."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from cellctl.domain.reactions import INTERLOCK_CAUSE, REACTIONS
from cellctl.domain.snapshot import Permissive

LEVEL_WORDS: dict[str, tuple[str, str]] = {
    "estop": ("open", "closed"),
    "door": ("open", "closed"),
    "chiller": ("not ready", "ready"),
    "gas_pressure": ("low", "there"),
    "fume_extraction": ("off", "runs"),
}
"""Permissive of a level of the I/O coupler -> its words at 0 (unsafe) and at 1 (safe)."""

NAMES = ("state", "fault", *LEVEL_WORDS, "laser", "feeder", "head", "motion", "dead_man", "depositing", "moving")
"""Every permissive, in the order in which they are shown."""


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


NEVER_S = 1e9  # age of what was never read; JSON has no infinity
NEVER = Signal(0.0, float("inf"), 0.5)


@dataclass(frozen=True)
class Levels:
    """Everything that emission depends on, as it stands at one tick.

    interlocks : level of the I/O coupler by name, 1 = safe; laser_words, feeder_words : flag words, 0 = safe
    head : 1 where the deposition head is confirmed at its working position
    heartbeats : per device, the heartbeat that it echoes (only its age counts)
    """

    is_running: bool = False
    is_faulted: bool = False
    is_depositing: bool = False
    is_moving: bool = False
    why_not_moving: str = ""
    state: str = ""
    cnc_state: str = ""
    cnc_age_s: float = 1e9
    cnc_stale_s: float = 0.5
    interlocks: Mapping[str, Signal] = field(default_factory=dict)
    laser_words: Mapping[str, Signal] = field(default_factory=dict)
    laser_enabled: bool = False
    feeder_words: Mapping[str, Signal] = field(default_factory=dict)
    head: Signal = NEVER
    heartbeats: Mapping[str, Signal] = field(default_factory=dict)


def _why_unsafe(name: str, signal: Signal | None) -> str:
    """Why a level of the I/O coupler is unsafe: missing, stale or open; empty when it is safe."""
    if signal is None:
        return f"{name} was never read"
    if not signal.is_fresh:
        return _old(name, signal)
    return "" if signal.value else REACTIONS[INTERLOCK_CAUSE[name]].cause


def unsafe_interlocks(interlocks: Mapping[str, Signal]) -> list[tuple[str, str]]:
    """(name, why) of every interlock that is not at its safe level, stale or missing."""
    found = [(name, _why_unsafe(name, interlocks.get(name))) for name in INTERLOCK_CAUSE]
    return [(name, why) for name, why in found if why]


def _old(name: str, signal: Signal) -> str:
    return f"{name} is {signal.age_s:.2f} s old" if signal.age_s < NEVER_S else f"{name} was never read"


def _oldest(signals: Mapping[str, Signal]) -> Signal:
    """The signal that is nearest to its stale limit, or beyond it farthest."""
    return max(signals.values(), key=lambda signal: signal.age_s / signal.stale_s, default=NEVER)


def _words(words: Mapping[str, Signal]) -> str:
    """Why a device's flag words are not all fresh and 0; empty when they are."""
    if not words:
        return "was never read"
    for name, signal in words.items():
        if not signal.is_fresh:
            return _old(name, signal)
        if signal.value:
            return signal.meaning or f"{name} is {int(signal.value):#x}"
    return ""


def _read(name: str, why: str, level: str, signal: Signal) -> Permissive:
    """A permissive that rests on a reading."""
    return Permissive(name, not why, why, level, signal.age_s if signal.age_s < NEVER_S else NEVER_S, signal.stale_s)


def _of_coupler(levels: Levels) -> list[Permissive]:
    found = []
    for name, cause in INTERLOCK_CAUSE.items():
        signal = levels.interlocks.get(name)
        level = LEVEL_WORDS[cause][bool(signal.value)] if signal is not None and signal.age_s < NEVER_S else "unknown"
        found.append(_read(cause, _why_unsafe(name, signal), level, signal or NEVER))
    return found


def _of_devices(levels: Levels) -> list[Permissive]:
    laser = _words(levels.laser_words) or ("" if levels.laser_enabled else "is not enabled")
    feeder = _words(levels.feeder_words)
    head = levels.head
    why_head = _old("head_deployed", head) if not head.is_fresh else "" if head.value else "the head is not deployed"
    motion = Signal(0.0, levels.cnc_age_s, levels.cnc_stale_s)
    why_state = "" if levels.cnc_state == "Run" else f"CNC is {levels.cnc_state or 'unknown'}"
    why_motion = why_state if motion.is_fresh else _old("status", motion)
    dead = [name for name, signal in levels.heartbeats.items() if not signal.is_fresh]
    why_dead = f"no heartbeat from {', '.join(dead)}" if dead or not levels.heartbeats else ""
    return [
        _read("laser", laser, "enabled" if levels.laser_enabled else "disabled", _oldest(levels.laser_words)),
        _read("feeder", feeder, "no faults" if not feeder else "not ready", _oldest(levels.feeder_words)),
        _read("head", why_head, "deployed" if head.value == 1.0 else "not deployed", head),
        _read("motion", why_motion, levels.cnc_state or "unknown", motion),
        _read("dead_man", why_dead, "beats" if not why_dead else "silent", _oldest(levels.heartbeats)),
    ]


def permissives(levels: Levels) -> list[Permissive]:
    """Each condition of emission with its level and age now, in the order of NAMES. Source: design.md, invariant 1."""
    why_still = "" if levels.is_moving else (levels.why_not_moving or "the tip stands still")
    running, faulted, depositing = levels.is_running, levels.is_faulted, levels.is_depositing
    return [
        Permissive("state", running, "" if running else "no job is running", levels.state or ("running" if running else "not running")),
        Permissive("fault", not faulted, "a fault is latched" if faulted else "", "latched" if faulted else "none"),
        *_of_coupler(levels),
        *_of_devices(levels),
        Permissive("depositing", depositing, "" if depositing else "no depositing pass", "yes" if depositing else "no"),
        Permissive("moving", not why_still, why_still, "stands" if why_still else "moves"),
    ]


def may_emit(conditions: list[Permissive]) -> bool:
    """Whether every condition is met; none at all is not."""
    return bool(conditions) and all(condition.ok for condition in conditions)


def why_not(conditions: list[Permissive]) -> str:
    """Why emission is not allowed, in one line; empty when it is."""
    return "; ".join(condition.why for condition in conditions if not condition.ok)
