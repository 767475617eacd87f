"""What is in the way of an operation's moves: rows that hit something or leave the travel, and the one line that says so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.cell import Tool
from planner.collide.clearance import Clearance
from planner.collide.guard import Guard
from planner.kinematics.chain import Floats
from planner.post.linearise import LinearOperation
from planner.post.pass_curve import PassCurve
from planner.post.watching import spread

Bools = NDArray[np.bool_]

_ROOM_MM = 1.0  # beyond the overlap: what a longer tool or a tilt should bring


@dataclass(frozen=True)
class Blocked:
    """rows : (n,) bool, of the moves   passes : their indices   only_rapid : all of them in rapid links

    clearance_mm : least, less than 0: two things are in each other   outside : most beyond a travel, mm or deg
    why : what meets what, where; "" where nothing does   place : the pass
    """

    rows: Bools
    passes: frozenset[int]
    only_rapid: bool
    clearance_mm: float
    outside: float
    why: str
    place: str
    meets: tuple[str, str]

    @property
    def is_clear(self) -> bool:
        """Whether nothing is in the way."""
        return not bool(self.rows.any())

    @property
    def depth(self) -> float:
        """mm (or deg) of what is wrong: the lesser of two ways is the better one."""
        return max(-self.clearance_mm, 0.0) + self.outside

    @property
    def line(self) -> str:
        """What meets what by how much, where, in which pass."""
        return f"{self.why}, {self.place}"

    def hint(self, tool: Tool, is_deposit: bool) -> str:
        """What would help."""
        deep = -self.clearance_mm + _ROOM_MM
        first, second = self.meets
        names = f"{first} {second}"
        told = []
        if not is_deposit and ("holder" in names or "spindle" in names or "shank" in names):
            told.append(
                f"another {tool.kind.replace('_', ' ')} of {tool.diameter_mm:g} mm that sticks out {tool.stickout + deep:.0f} mm or more in [[tools]]"
            )
        if "clamp" in names:
            told.append("turn_deg of the recipe, to turn the part past the clamp")
        told.append("shift_mm" if "plate" in names or "clamp" in names else "another order of the pieces (cuts)")
        told.append("another build_direction")
        return "what would help: " + ", or ".join(told)


def looked_at(guard: Guard, tool: Tool, curves: Sequence[PassCurve], moves: LinearOperation, outside: Floats) -> Blocked:
    """What is in the way of the moves, between their rows too; outside : (n,) float, how far each row leaves a travel."""
    found, source = _seen(guard, tool, curves, moves)
    blocked = np.asarray(outside > 0.0)
    is_hit = guard.hits(found) if found is not None else np.zeros(0, dtype=np.bool_)
    blocked[source[is_hit]] = True
    if not blocked.any():
        return Blocked(blocked, frozenset(), False, 0.0, 0.0, "", "", ("", ""))
    passes = frozenset(int(k) for k in np.unique(moves.rows.pass_[blocked]))
    only_rapid = all(curves[k].source.rapid for k in passes)
    most = float(outside.max())
    if found is None or not is_hit.any():
        place = curves[int(moves.rows.pass_[int(np.argmax(outside))])].place
        return Blocked(blocked, passes, only_rapid, 0.0, most, "an axis leaves its travel", place, ("", ""))
    worst = int(np.argmin(np.where(is_hit, found.mm, np.inf)))
    place = curves[int(moves.rows.pass_[source[worst]])].place
    return Blocked(blocked, passes, only_rapid, float(found.mm[worst]), most, found.why(worst), place, found.pair(worst))


def _seen(
    guard: Guard, tool: Tool, curves: Sequence[PassCurve], moves: LinearOperation
) -> tuple[Clearance | None, NDArray[np.int64]]:
    """Clearance along the moves, arcs as chords, and the row (k,) of the moves that each is of; None where nothing is watched."""
    if not guard.is_watching:
        return None, np.zeros(0, dtype=np.int64)
    rows = moves.rows
    bulge = np.zeros(len(rows.arc_mm)) if moves.bulge is None else moves.bulge
    joints, source = spread(moves.poses.joints, bulge[1:])
    row = np.append(0, source + 1)
    starts = rows.is_first & moves.poses.needs_positioning
    starts[0] = True
    joined = ~starts[row] | np.append(False, np.diff(row) == 0)
    rapid = np.array([curve.source.rapid for curve in curves])[rows.pass_[row]]
    found: Clearance | None = None
    for cuts in (True, False):
        chosen = np.flatnonzero(rapid != cuts)
        if chosen.size == 0:
            continue
        with_begin = np.union1d(chosen, chosen[joined[chosen]] - 1)
        follows = joined[with_begin] & np.append(False, np.diff(with_begin) == 1) & (rapid[with_begin] != cuts)
        seen = guard.clearance(
            tool, joints[with_begin], cuts=cuts, limit_mm=0.0, joined=follows, passes=rows.pass_[row[with_begin]]
        )
        whole = _over(seen, with_begin[rapid[with_begin] != cuts], rapid[with_begin] != cuts, len(row))
        found = whole if found is None else found.nearer(whole)
    return found, row


def _over(seen: Clearance, at: NDArray[np.int64], kept: Bools, count: int) -> Clearance:
    """The clearances of rows kept, laid over all `count` rows; infinite elsewhere."""
    gap, pairs, places = np.full(count, np.inf), np.full(count, -1, dtype=np.int64), np.zeros((count, 3))
    gap[at], pairs[at], places[at] = seen.mm[kept], seen.pairs[kept], seen.places[kept]
    return Clearance(gap, pairs, places, seen.names)
