"""Which members to build by themselves so that nothing hangs: a greedy cover of what hangs, cheapest members first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.decompose.members import MOST_TURNED_COS, Member, Ways, may_bend, path_on
from planner.decompose.path import AxisPath

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_MOST_TAKEN = 24  # members that one body is freed of
_BULK = 0.1  # per volume of the part in a member: of two that hold the same the smaller one is taken
_OVERLAP = 0.02  # of the smaller one's area: members that share more are not taken both
_SAME_COS = 0.9999  # a member that grows straight on in the body's own direction holds nothing up
_WORTH_MM2 = 0.5  # less hanging is rounding

COSTS = {"hangs": 20.0, "tilted": 0.5, "joint": 0.15, "setup": 0.1, "piece": 0.01}
"""Relative to the part's mean shadow (a quarter of its surface) for areas, absolute for set-ups and pieces. What hangs
falls away and costs most; a set-up takes minutes; a joint is milled and welded; tilting is slower and less sharp."""


@dataclass(frozen=True, eq=False)
class Taken:
    """A member that is built by itself, those that are taken off it first, and planes along its axis where it bends."""

    member: Member
    off: tuple[Taken, ...] = ()
    path: AxisPath | None = None
    hangs_mm2: float = 0.0


class Search:
    """Covers what hangs of bodies by members; what was found for a member is kept."""

    def __init__(self, ways: Ways, members: Sequence[Member], first: Floats) -> None:
        self.ways = ways
        self.members = [member for member in members if float(member.direction @ first) > MOST_TURNED_COS]
        self.first = first
        self.shadow_mm2 = 0.25 * float(ways.mesh.areas.sum())
        self._freed: dict[int, Taken] = {}

    def cover(self, weights: Floats, within: Floats | None, stands: Flags, direction: Floats, depth: int) -> tuple[list[Taken], float]:
        """Members to take off a body so that little hangs of it, in the order found, and what hangs then, mm².

        weights : (m,) float, what hangs of each facet of the part   within : (m,) float, share of each facet in the body; None: all
        stands : (m,) bool, facets that must stay: it stands on them
        Each time the member whose taking is worth most; one that would have to bend is worth that only if a path is found.
        """
        taken: list[Taken] = []
        left = weights.copy()
        used = [direction]
        while left.sum() > _WORTH_MM2 and len(taken) < _MOST_TAKEN:
            best = self._best(left, within, stands, direction, taken, used, depth)
            if best is None:
                break
            taken.append(best)
            left = left * (1.0 - best.member.share)
            used.append(best.member.direction)
        return taken, float(left.sum())

    def _best(
        self, left: Floats, within: Floats | None, stands: Flags, direction: Floats, taken: list[Taken], used: list[Floats], depth: int
    ) -> Taken | None:
        """The member that is worth most now; None if none is worth its cost."""
        offers: list[tuple[float, int, bool]] = []
        for number in self._fitting(left, within, stands, taken):
            member = self.members[number]
            if float(member.direction @ direction) <= _SAME_COS:
                offers.append((self._gain(self._free(number, depth), left, used), number, False))
            if may_bend(member.body.mesh, member.joint_mm2, float(member.hangs.sum()), member.tilted_mm2):
                offers.append((self._gain(Taken(member), left, used, bends=True), number, True))
        offers.sort(key=lambda offer: (-round(offer[0], 9), offer[2], offer[1]))
        for gain, number, bends in offers:
            if gain <= 1e-9:
                return None
            if not bends:
                return self._free(number, depth)
            path = path_on(self.members[number].body, self.members[number].plane, self.ways)
            if path is not None:
                return Taken(self.members[number], (), path)
        return None

    def _fitting(self, left: Floats, within: Floats | None, stands: Flags, taken: list[Taken]) -> list[int]:
        """Members that hold some of what hangs, lie in the body, leave its base and overlap none that is taken."""
        areas = self.ways.mesh.areas
        gone = np.zeros(len(areas))
        for other in taken:
            gone += other.member.share
        kept = []
        for number, member in enumerate(self.members):
            own = float((member.share * areas).sum())
            if float((left * member.share).sum()) <= _WORTH_MM2 or (stands & (member.share > 0.02)).any():
                continue
            if within is not None and float((member.share * (1.0 - within) * areas).sum()) > _OVERLAP * own:
                continue
            smaller = min([own, *(float((other.member.share * areas).sum()) for other in taken)])
            if taken and float((np.maximum(gone + member.share - 1.0, 0.0) * areas).sum()) > _OVERLAP * smaller:
                continue
            kept.append(number)
        return kept

    def _gain(self, found: Taken, left: Floats, used: list[Floats], bends: bool = False) -> float:
        """What taking a member is worth, relative to the part's shadow.  bends : as if its layers turned with its axis."""
        member = found.member
        held = float((left * member.share).sum()) - found.hangs_mm2
        if held <= _WORTH_MM2:
            return 0.0
        turned = all(float(member.direction @ other) < _SAME_COS for other in used)
        cost = COSTS["joint"] * member.joint_mm2 + COSTS["tilted"] * (0.0 if bends else member.tilted_mm2)
        cost += sum(COSTS["joint"] * inner.member.joint_mm2 for inner in found.off)
        fixed = COSTS["setup"] * (turned + len(found.off)) + COSTS["piece"]
        bulk = member.volume_mm3 / self.ways.mesh.volume
        return COSTS["hangs"] * held / self.shadow_mm2 - cost / self.shadow_mm2 - fixed - _BULK * bulk

    def _free(self, number: int, depth: int) -> Taken:
        """A member that grows straight, with what must be taken off it so that it holds."""
        if number in self._freed:
            return self._freed[number]
        member = self.members[number]
        hangs = float(member.hangs.sum())
        found = Taken(member, hangs_mm2=hangs)
        if hangs > _WORTH_MM2 and depth > 0:
            nothing = np.zeros(len(member.share), dtype=np.bool_)
            off, left = self.cover(member.hangs, member.share, nothing, member.direction, depth - 1)
            if left < hangs:
                found = Taken(member, tuple(off), None, left)
        self._freed[number] = found
        return found


def removal_order(taken: Sequence[Taken]) -> list[Taken]:
    """Members in the order in which they can be cut off: those of a member before itself."""
    order: list[Taken] = []
    for one in taken:
        order += [*removal_order(one.off), one]
    return order
