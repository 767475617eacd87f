"""Reports of one physical cause on several wires: what a report stands for, and what is no news beside a cause that is known.

An opened door is told by the I/O coupler, by the laser's interlock word and by the CNC, in whatever order the wires are read. The
operator gets one alarm, the same for every order.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

SEPARATOR = "; "  # between the texts of several bits
ESTOP_WORDS = re.compile(r"\be-?stop\b|\bemergency\b", re.IGNORECASE)
DOOR_WORDS = re.compile(r"\b(door|guard)s?\b", re.IGNORECASE)
COOLING_WORDS = re.compile(r"\bcool|\bchill|\bwater\b", re.IGNORECASE)
WRONG_VALUE = re.compile(r"\bwrong value read back\b")  # an opened chain puts a device's set-points to their safe values
ALARM_BY_ESTOP = re.compile(r"^ALARM:(3\b|10\b|$)")  # reset in motion (E-stop on the reset pin), E-stop, or no number told
HEARTBEAT_WORDS = re.compile(r"\bheartbeat\b|\bdead-?man\b|\bwatchdog\b", re.IGNORECASE)
ANYTHING = re.compile("")

CNC_ALARM_CAUSE: dict[int, str] = {7: "door", 10: "estop"}
"""ALARM number -> cause of which it is the CNC's own word. Source: grblHAL alarms.h."""

ALL_AT_ONCE = (
    *("laser_silent", "feeder_silent", "io_silent", "cnc_silent", "cnc_lost"),
    *("cnc_reset", "answer_overdue", "laser_emitting", "dark_pass"),
)
"""What a machine whose supply or network has gone is told by, whichever wire is looked at first."""
EXPLAINS: dict[str, dict[str, re.Pattern[str]]] = {
    "estop": {
        "laser_interlock": ESTOP_WORDS,
        "laser_fault": WRONG_VALUE,
        "laser_lost": ANYTHING,
        "feeder_fault": WRONG_VALUE,
        "feeder_lost": ANYTHING,
        "io_fault": WRONG_VALUE,
        "cnc_alarm": ALARM_BY_ESTOP,
        "cnc_reset": ANYTHING,
    },
    "power": dict.fromkeys(ALL_AT_ONCE, ANYTHING),
    "door": {"laser_fault": WRONG_VALUE, "laser_lost": ANYTHING},
    "chiller": {"laser_interlock": COOLING_WORDS, "laser_fault": WRONG_VALUE, "laser_lost": ANYTHING},
    "gas_pressure": {"powder_flow": ANYTHING, "gas_flow": ANYTHING},
    "laser_interlock": {"laser_fault": WRONG_VALUE, "laser_lost": ANYTHING},
    "laser_fault": {"laser_lost": ANYTHING},
    "laser_silent": {"laser_fault": HEARTBEAT_WORDS, "laser_lost": ANYTHING},
    "feeder_fault": {"feeder_lost": ANYTHING},
    "feeder_silent": {"feeder_fault": HEARTBEAT_WORDS, "feeder_lost": ANYTHING},
    "io_fault": {"head_position": ANYTHING, "io_lost": ANYTHING},
    "io_lost": {"head_position": ANYTHING, "io_fault": WRONG_VALUE},
}
"""Cause -> code of a report that it explains, if the words of the report's detail are found."""


def causes_of_interlocks(texts: Sequence[str]) -> list[tuple[str, str]]:
    """(code, detail) of what the open interlocks of a laser stand for. texts : of the bits that are set.

    A door is a door, whichever wire tells of it. An E-stop opens what comes behind it in the chain: then nothing else is concluded.
    """
    if any(ESTOP_WORDS.search(text) for text in texts):
        return [("laser_interlock", SEPARATOR.join(texts))]
    doors = [text for text in texts if DOOR_WORDS.search(text)]
    others = [text for text in texts if text not in doors]
    found = [("door", SEPARATOR.join(doors))] if doors else []
    return [*found, ("laser_interlock", SEPARATOR.join(others))] if others else found


def cause_of_alarm(number: int | None) -> str:
    """Code of an alarm of the CNC. number : as the CNC tells it, None if it does not."""
    return CNC_ALARM_CAUSE.get(number, "cnc_alarm") if number is not None else "cnc_alarm"


def tells_of_heartbeat(detail: str) -> bool:
    """Whether all that a device reports of itself is a heartbeat that it missed."""
    return all(HEARTBEAT_WORDS.search(part) for part in detail.split(SEPARATOR))


def is_explained(code: str, detail: str, by: str) -> bool:
    """Whether a report is a consequence of the cause `by`, so that beside it it is no news. An E-stop explains the whole chain behind it."""
    words = EXPLAINS.get(by, {}).get(code)
    if words is None:
        return False
    parts = detail.split(SEPARATOR)
    is_found = [words.search(part) is not None for part in parts]
    return any(is_found) if words is ESTOP_WORDS else all(is_found)
