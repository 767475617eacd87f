"""Moves between places that no pass connects: lifted along the retracting axis only as far as everything stays clear, proved before they are run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from config.cell import Cell, Tool
from planner.collide.clearance import Clearance
from planner.collide.guard import Guard
from planner.errors import ReachError
from planner.kinematics.chain import Chain, Floats
from planner.kinematics.timing import axis_limited_times
from planner.post.retract import Retract
from planner.post.tape import Move, Origin, Tape

_SAME = 1e-6  # mm or deg
_LIFTS = (1.0, 3.0, 8.0, 20.0)  # of the cell's rapid clearance: tried in order, the full retract after them
_ROOM_MM = 3.0  # that a way across keeps from everything; up from a pass and down to one it is as near as those are
_ROUNDING_MM = 0.05


@dataclass(frozen=True)
class _Route:
    """rows : (n, 5) joints, from where the machine stands to the target   across : first and last row of what is run lifted"""

    rows: Floats
    across: tuple[int, int]


class Positioner:
    """Adds positioning to a tape.  low, retracted : how many ways were run lifted a little, and fully retracted."""

    def __init__(self, chain: Chain, cell: Cell, guard: Guard) -> None:
        retract = Retract.of(chain, cell)
        self._column, self._way, self._retracted = retract.column, retract.way, retract.end
        self._clearance = cell.rapid_clearance_mm
        self._max_velocity = np.array([axis.max_velocity for axis in cell.axes])
        self._all = (1 << len(cell.axes)) - 1
        self._has_retracted = False
        self._has_named_all = False
        self._guard = guard
        self.low = self.retracted = 0

    def retract(self, tape: Tape, origin: Origin) -> None:
        """Rapid to the end of the retracting axis' travel that is away from the table; nothing if it stands there."""
        target = tape.joints.copy()
        target[self._column] = self._retracted
        if not self._has_retracted or abs(tape.joints[self._column] - self._retracted) > _SAME:
            self._rapid(tape, target, origin, named=1 << self._column if not self._has_retracted else 0)
            self._has_retracted = True

    def stand_clear(self, tape: Tape, tool: Tool | None, origin: Origin, passes_done: int = 0) -> None:
        """Rapid up by the cell's rapid clearance, farther where something is near; to the end of travel without a tool to look at."""
        if tool is not None and self._has_named_all:
            for lift in self._lifts():
                up = self._lifted(tape.joints, lift)
                route = _Route(np.vstack([tape.joints, up]), (1, 1))
                if self._keeps(self._seen(tool, route, passes_done - 1), route):
                    self._rapid(tape, up, origin)
                    return
        self.retract(tape, origin)

    def travel(self, tape: Tape, tool: Tool, target: Floats, feed_mm_s: float | None, origin: Origin, passes_done: int) -> int:
        """To the target (5,): up, across, down; rapid, the last rapid clearance at the feed if one is given.

        passes_done : of the operation that the guard has begun: what they cut is gone
        The lowest way that keeps clear of everything is taken. Returns the item at whose start the tool stands clear.
        Raises ReachError if something is hit even when fully retracted: what, where.
        """
        if not self._has_named_all or not self._guard.is_watching:
            return self._run(tape, self._full(tape.joints, target), target, feed_mm_s, origin)
        for route in self._routes(tape.joints, target):
            found = self._seen(tool, route, passes_done - 1)
            if self._keeps(found, route):
                self.low += 1
                return self._run(tape, route, target, feed_mm_s, origin)
        self.retracted += 1
        is_hit = self._guard.hits(found)
        if is_hit[2:].any() and not is_hit[:2].any():
            row = int(np.argmin(np.where(is_hit, found.mm, np.inf)))
            raise ReachError(
                f"no way leads there: even fully retracted {found.why(row)}",
                "turn or move the part on the table, or take a shorter tool",
            )
        return self._run(tape, route, target, feed_mm_s, origin)

    def _seen(self, tool: Tool, route: _Route, last_pass: int) -> Clearance:
        """Clearance at both ends of a way, then along it."""
        rows = np.vstack([route.rows[-1:], route.rows])
        joined = np.arange(len(rows)) > 1
        done = np.full(len(rows), last_pass)
        return self._guard.clearance(tool, rows, cuts=False, limit_mm=_ROOM_MM, joined=joined, passes=done)

    def _keeps(self, found: Clearance, route: _Route) -> bool:
        """Whether a way keeps its room while it is lifted, and comes no nearer to anything on its ways up and down than its ends are."""
        need = np.full(len(found.mm), min(_ROOM_MM, float(found.mm[:2].min())) - _ROUNDING_MM)
        need[2 + route.across[0] : 2 + route.across[1]] = _ROOM_MM - _ROUNDING_MM
        return bool((found.mm >= need).all())

    def _routes(self, start: Floats, target: Floats) -> Iterator[_Route]:
        """Ways from low to high: both ends lifted by as much, then both to the height of the upper one, at last fully retracted."""
        if abs(start[self._column] - self._retracted) > _SAME:
            for lift in self._lifts():
                begin, end = self._lifted(start, lift), self._lifted(target, lift)
                yield _Route(np.vstack([start, begin, end, target]), (1, 2))
                level = max(begin[self._column] * self._way, end[self._column] * self._way) * self._way
                begin[self._column] = end[self._column] = level
                yield _Route(np.vstack([start, begin, end, target]), (1, 2))
        else:
            for lift in self._lifts():
                yield _Route(np.vstack([start, self._lifted(target, lift), target]), (0, 1))
        yield self._full(start, target)

    def _full(self, start: Floats, target: Floats) -> _Route:
        begin, end = start.copy(), target.copy()
        begin[self._column] = end[self._column] = self._retracted
        return _Route(np.vstack([start, begin, end, target]), (1, 2))

    def _lifts(self) -> list[float]:
        return [share * self._clearance for share in _LIFTS]

    def _lifted(self, joints: Floats, lift_mm: float) -> Floats:
        """The joints (5,) lifted, at most to the end of travel."""
        result = np.array(joints)
        room = abs(self._retracted - float(joints[self._column]))
        result[self._column] += self._way * min(lift_mm, room)
        return result

    def _run(self, tape: Tape, route: _Route, target: Floats, feed_mm_s: float | None, origin: Origin) -> int:
        """The moves of a way; those that do not move are left out, the last stretch goes at the feed."""
        clear = tape.count
        for k in range(1, len(route.rows) - 1):
            if np.abs(route.rows[k] - tape.joints).max() > _SAME or not self._has_named_all:
                is_first = k == len(route.rows) - 2 and not self._has_named_all
                self._rapid(tape, route.rows[k], origin, named=self._all if is_first else 0)
                self._has_named_all |= is_first
                self._has_retracted = True
            clear = tape.count if k == route.across[0] else clear
        if feed_mm_s is None:
            self._rapid(tape, target, origin)
            return clear
        above = self._lifted(target, self._clearance)
        if np.abs(above - tape.joints).max() > _SAME:
            self._rapid(tape, above, origin)
        time_s = abs(float(above[self._column] - target[self._column])) / feed_mm_s
        self._add(tape, target, max(time_s, 1e-3), Move.FEED, origin, 0)
        return clear

    def _rapid(self, tape: Tape, target: Floats, origin: Origin, named: int = 0) -> None:
        self._add(tape, target, 0.0, Move.RAPID, origin, named)

    def _add(self, tape: Tape, target: Floats, time_s: float, move: Move, origin: Origin, named: int) -> None:
        rows = target[None, :]
        times = axis_limited_times(rows - tape.joints, np.array([time_s]), self._max_velocity)
        tape.moves(rows, np.zeros(2), times, move, origin, named)
