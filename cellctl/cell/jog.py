"""A jog under way: a step, or continuous as long as a button is told held; what ends it, and how far it may go."""

from __future__ import annotations

import math

from cellctl.cell.refusal import Refused
from config.cell import Axis, Cell

PIECE_S = 0.08  # of motion per command of a continuous jog
AHEAD_S = 0.16  # of motion that the machine holds ahead: what it still does when nobody tells it anything any more
REPORTED_S = 0.4  # of motion that may lie between what was asked and what was last reported: a machine that cannot keep its feed is waited for
MIN_PIECE = 1e-3  # mm or deg; the firmware's resolution


class Jog:
    """start : where the axis is, mm or deg; distance : of a continuous one to the end of travel; feed : per minute; heard_at : wire time (s)"""

    def __init__(self, axis: str, start: float, distance: float, feed: float, *, is_continuous: bool, heard_at: float) -> None:
        self.axis = axis
        self._start = start
        self.distance = distance
        self.feed = feed
        self.is_continuous = is_continuous
        self.heard_at = heard_at
        self.ended = ""
        self._began_at: float | None = None
        self._asked = 0.0

    @property
    def target(self) -> float:
        """Where it leads, mm or deg."""
        return self._start + self.distance

    @property
    def text(self) -> str:
        """In words."""
        how = "kept up by hand" if self.is_continuous else f"{self.distance:+g}"
        return f"jog {self.axis} {how} at {self.feed:g}/min"

    def keep(self, now: float) -> None:
        """The button is still held."""
        self.heard_at = max(self.heard_at, now)

    def end(self, because: str) -> None:
        """No more motion of this jog."""
        self.ended = self.ended or because

    def watch(self, now: float, repeat_s: float) -> None:
        """Dead-man: a continuous jog that nobody keeps up ends."""
        if self.is_continuous and now - self.heard_at > repeat_s:
            self.end(f"the button was not told held for {repeat_s:g} s")

    @property
    def is_asked(self) -> bool:
        """Whether the machine was told all of it."""
        return abs(self.distance) - self._asked < MIN_PIECE

    def whole(self) -> float:
        """All of it at once (mm or deg, signed)."""
        self._asked = abs(self.distance)
        return self.distance

    def piece(self, now: float, reported: float) -> float:
        """What to tell the machine next (mm or deg, signed); 0 while it holds enough. reported : where the axis was last"""
        feed_s = self.feed / 60.0
        if self._asked - abs(reported - self._start) > feed_s * REPORTED_S:
            return 0.0
        if self._began_at is None or self._asked < feed_s * (now - self._began_at):
            self._began_at = now - self._asked / feed_s
        if self._asked - feed_s * (now - self._began_at) >= feed_s * AHEAD_S:
            return 0.0
        size = min(max(feed_s * PIECE_S, 10.0 * MIN_PIECE), abs(self.distance) - self._asked)
        self._asked += size
        return math.copysign(size, self.distance)


def asked_jog(cell: Cell, args: dict[str, object], machine: dict[str, float], now: float, suspect_feed: float | None) -> Jog:
    """The jog that a command asks for. machine : where the axes are; suspect_feed : limit while the position is not to be trusted.

    Raises Refused for what is no jog of this machine, or leads out of its travel.
    """
    letter, distance, feed = str(args.get("axis", "")), args.get("distance"), args.get("feed")
    is_given = _is_number(distance) and _is_number(feed) and letter in cell.letters
    if not is_given or not isinstance(distance, (int, float)) or not isinstance(feed, (int, float)) or distance == 0:
        raise Refused(f"jog: axis ({', '.join(cell.letters)}), distance and feed are needed", "distance in mm or deg, feed per minute")
    axis = cell.axis(letter)
    if letter not in machine:
        raise Refused(f"jog {letter}: the CNC has not told where the axis is", "wait for its next report")
    at, is_continuous = machine[letter], bool(args.get("continuous", False))
    fastest = axis.max_velocity * 60
    if is_continuous:
        distance = (axis.max if distance > 0 else axis.min) - at
        target = at
    else:
        target = at + float(distance)
    if not 0 < feed <= fastest or (suspect_feed is None and not axis.min <= target <= axis.max):
        line = f"jog {letter} to {target:.3f} at {feed:g}/min is outside {axis.min:g} to {axis.max:g} or above {fastest:g}/min"
        raise Refused(line, "jog less far or slower")
    if suspect_feed is not None and feed > suspect_feed:
        raise Refused(f"jog {letter} at {feed:g}/min: not above {suspect_feed:g}/min while the position is not to be trusted", "jog slower, or home")
    return Jog(letter, at, float(distance), float(feed), is_continuous=is_continuous, heard_at=now)


def way_to(cell: Cell, place: str, machine: dict[str, float], feed: object, now: float) -> list[Jog]:
    """One leg per axis to a place of the cell file: the linear ones that rise go first, those that sink last. Raises Refused."""
    goals = cell.by_hand.places.get(place)
    if goals is None:
        known = ", ".join(cell.by_hand.places) or "none"
        raise Refused(f"go_to: no place {place!r}", f"places of the cell file (by_hand.places): {known}")
    per_min = feed if isinstance(feed, (int, float)) and not isinstance(feed, bool) else cell.by_hand.suspect_feed_mm_min
    legs = []
    for letter, goal in goals.items():
        distance = goal - machine.get(letter, goal)
        if abs(distance) > MIN_PIECE:
            fastest = cell.axis(letter).max_velocity * 60.0
            asked: dict[str, object] = {"axis": letter, "distance": distance, "feed": min(float(per_min), fastest)}
            legs.append(asked_jog(cell, asked, machine, now, None))
    return sorted(legs, key=lambda leg: _order(cell, leg))


def _order(cell: Cell, leg: Jog) -> int:
    """0: away from the table; 1: sideways or turning; 2: towards it."""
    if is_retract(cell, leg):
        return 0
    back = Jog(leg.axis, leg.target, -leg.distance, leg.feed, is_continuous=False, heard_at=0.0)
    return 2 if is_retract(cell, back) else 1


def is_retract(cell: Cell, jog: Jog) -> bool:
    """Whether a jog takes the head straight away from the table, so that no head in the way can touch anything."""
    axis: Axis = cell.axis(jog.axis)
    chains = ((cell.kinematics.head, 1.0), (cell.kinematics.table, -1.0))
    lifts = [sign * joint.direction[2] for chain, sign in chains for joint in chain if joint.axis == jog.axis]
    return axis.kind == "linear" and bool(lifts) and math.isclose(math.copysign(1.0, jog.distance) * lifts[0], 1.0)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
