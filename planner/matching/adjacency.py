"""Which contours of two neighbouring sections belong together: by shared facets, then by climbing over facets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.errors import PlanningError
from planner.matching.slab import Slab, edge_is_inside, slab_of
from planner.mesh.findings import place_text
from planner.mesh.mesh import Mesh
from planner.slicing.section import Loop, Section

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
How = Literal["direct", "indirect"]
Kind = Literal["one_to_one", "begin", "end", "merge", "diverge", "many_to_many", "hole_opens", "hole_closes"]


@dataclass(frozen=True)
class Pair:
    """A contour of the bottom and one of the top that facets connect.

    how : "direct" where a facet, or two facets side by side, lie in both contours; "indirect" where the climb over
    facets inside the layer leads from one to the other
    """

    bottom: int
    top: int
    how: How


@dataclass(frozen=True)
class Group:
    """The contours at the rims of one connected piece of surface: bottom and top loop numbers, ascending."""

    bottom: tuple[int, ...]
    top: tuple[int, ...]
    kind: Kind


@dataclass(frozen=True)
class Matching:
    """Which loops of two sections belong together.

    groups : one per connected piece of surface that reaches a plane; every loop is in exactly one
    pairs : the connections that were found, direct ones first
    enclosed : closed pieces of surface wholly inside the layer (a void or a speck that neither section shows)
    """

    groups: tuple[Group, ...]
    pairs: tuple[Pair, ...]
    enclosed: int

    @property
    def direct_count(self) -> int:
        """Pairs found by the direct adjacency test."""
        return sum(pair.how == "direct" for pair in self.pairs)

    @property
    def indirect_count(self) -> int:
        """Pairs found by the climb over facets."""
        return sum(pair.how == "indirect" for pair in self.pairs)

    @property
    def branching_count(self) -> int:
        """Groups in which contours split or join."""
        return sum(group.kind in ("merge", "diverge", "many_to_many") for group in self.groups)

    def how(self, bottom: int, top: int) -> How | None:
        """How a pair was found, or None if it was not."""
        for pair in self.pairs:
            if pair.bottom == bottom and pair.top == top:
                return pair.how
        return None


def match_sections(mesh: Mesh, bottom: Section, top: Section) -> Matching:
    """Which contours of two sections belong together, for any number on either side.

    bottom : cut with side "above"; top : with side "below", of the same mesh; the planes need not be parallel.
    Loops of one connected piece of surface between the planes form a group. Within it the direct adjacency test pairs
    loops that share a facet or hold neighbouring facets; loops left over climb (or descend) the steepest way over facets.
    Raises PlanningError where the planes meet inside the part.
    Source: paper §V.A and B.
    """
    return match_in_slab(mesh, bottom, top, slab_of(mesh, bottom.plane, top.plane))


def match_in_slab(mesh: Mesh, bottom: Section, top: Section, slab: Slab) -> Matching:
    """As `match_sections`, in a slab that is known."""
    _refuse_planes_that_meet(bottom, top)
    piece_low = [int(slab.component[loop.facets].max()) for loop in bottom.loops]
    piece_high = [int(slab.component[loop.facets].max()) for loop in top.loops]
    groups = []
    for piece in sorted({*piece_low, *piece_high} - {-1}):
        low = tuple(k for k, found in enumerate(piece_low) if found == piece)
        high = tuple(k for k, found in enumerate(piece_high) if found == piece)
        groups.append(Group(low, high, _kind(bottom, top, low, high)))
    pairs = _direct_pairs(mesh, bottom, top, slab)
    pairs += _indirect_pairs(mesh, bottom, top, slab, groups, pairs)
    reached = len({*piece_low, *piece_high} - {-1})
    return Matching(tuple(groups), tuple(pairs), slab.count - reached)


def _kind(bottom: Section, top: Section, low: tuple[int, ...], high: tuple[int, ...]) -> Kind:
    """What happens in a group, seen from below."""
    if not low:
        return "hole_opens" if all(top.loops[k].is_hole for k in high) else "begin"
    if not high:
        return "hole_closes" if all(bottom.loops[k].is_hole for k in low) else "end"
    if len(low) == 1:
        return "one_to_one" if len(high) == 1 else "diverge"
    return "merge" if len(high) == 1 else "many_to_many"


def loop_of_facet(loops: list[Loop], count: int) -> Ints:
    """(m,) int64: the loop that crosses each facet, -1 for none.  A plane crosses a facet once: there is only one."""
    owner = np.full(count, -1, dtype=np.int64)
    for number, loop in enumerate(loops):
        owner[loop.facets] = number
    return owner


def _direct_pairs(mesh: Mesh, bottom: Section, top: Section, slab: Slab) -> list[Pair]:
    """Pairs of loops that share a facet, or hold facets side by side across an edge inside the slab."""
    high = loop_of_facet(top.loops, len(mesh.facets))
    found: set[tuple[int, int]] = set()
    for number, loop in enumerate(bottom.loops):
        facets = np.unique(loop.facets)
        reached = high[facets]
        found.update((number, int(other)) for other in np.unique(reached[reached >= 0]))
        nearby = mesh.adjacency[facets]
        corners = mesh.facets[facets]
        for j in range(3):
            beside = nearby[:, j]
            tops = np.where(beside >= 0, high[beside], -1)
            for k in np.flatnonzero(tops >= 0):
                a, b = corners[k, j], corners[k, (j + 1) % 3]
                if (number, int(tops[k])) not in found and edge_is_inside(
                    slab.above[a], slab.below[a], slab.above[b], slab.below[b]
                ):
                    found.add((number, int(tops[k])))
    return [Pair(low, high_number, "direct") for low, high_number in sorted(found)]


def _indirect_pairs(
    mesh: Mesh, bottom: Section, top: Section, slab: Slab, groups: list[Group], direct: list[Pair]
) -> list[Pair]:
    """For loops without a direct partner the one that the climb (from below) or descent (from above) reaches."""
    has_partner = {("low", pair.bottom) for pair in direct} | {("high", pair.top) for pair in direct}
    found: set[tuple[int, int]] = set()
    owner_low = owner_high = np.empty(0, dtype=np.int64)
    for group in groups:
        if not group.bottom or not group.top:
            continue
        if not len(owner_low):
            owner_low = loop_of_facet(bottom.loops, len(mesh.facets))
            owner_high = loop_of_facet(top.loops, len(mesh.facets))
        for low in group.bottom:
            if ("low", low) not in has_partner:
                seeds = bottom.loops[low].facets
                reached = climb(mesh.facets, mesh.adjacency, slab.above, slab.below, slab.above, seeds, owner_high)
                found.add((low, int(reached)))
        for high in group.top:
            if ("high", high) not in has_partner and all(pair[1] != high for pair in found):
                seeds = top.loops[high].facets
                reached = climb(mesh.facets, mesh.adjacency, slab.above, slab.below, slab.below, seeds, owner_low)
                found.add((int(reached), high))
    return [Pair(low, high, "indirect") for low, high in sorted(found) if low >= 0 and high >= 0]


@njit(cache=True)
def climb(
    facets: Ints, adjacency: Ints, above: Floats, below: Floats, height: Floats, seeds: Ints, goal: Ints
) -> int:
    """The first loop that a climb over facets meets: always on from the highest facet reached, so that a local summit
    sends it back to the next highest.

    seeds : (k,) int64, facets to start from;  height : (n,) float, mm, what the climb gains
    goal : (m,) int64, loop of each facet, -1 none.  Returns the loop's number, -1 if none is reached.
    Source: paper §V.B, made complete by going back where the steepest way ends.
    """
    seen = np.zeros(facets.shape[0], np.bool_)
    heap_key = np.empty(facets.shape[0] + 1, np.float64)
    heap = np.empty(facets.shape[0] + 1, np.int64)
    size = 0
    for f in seeds:
        if not seen[f]:
            seen[f] = True
            size = _push(heap_key, heap, size, -_top_of(facets, height, f), f)
    while size > 0:
        f = heap[0]
        size = _pop(heap_key, heap, size)
        if goal[f] >= 0:
            return int(goal[f])
        for j in range(3):
            g = adjacency[f, j]
            a, b = facets[f, j], facets[f, (j + 1) % 3]
            if g >= 0 and not seen[g] and edge_is_inside(above[a], below[a], above[b], below[b]):
                seen[g] = True
                size = _push(heap_key, heap, size, -_top_of(facets, height, g), g)
    return -1


@njit(cache=True)
def _top_of(facets: Ints, height: Floats, f: int) -> float:
    return float(max(height[facets[f, 0]], max(height[facets[f, 1]], height[facets[f, 2]])))


@njit(cache=True)
def _push(keys: Floats, items: Ints, size: int, key: float, item: int) -> int:
    """Put an item on a binary heap (least key first); returns the new size."""
    k = size
    while k > 0 and keys[(k - 1) // 2] > key:
        keys[k], items[k] = keys[(k - 1) // 2], items[(k - 1) // 2]
        k = (k - 1) // 2
    keys[k], items[k] = key, item
    return size + 1


@njit(cache=True)
def _pop(keys: Floats, items: Ints, size: int) -> int:
    """Take the first item off a binary heap; returns the new size."""
    size -= 1
    key, item = keys[size], items[size]
    k = 0
    while 2 * k + 1 < size:
        child = 2 * k + 1
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[k], items[k] = keys[child], items[child]
        k = child
    keys[k], items[k] = key, item
    return size


def _refuse_planes_that_meet(bottom: Section, top: Section) -> None:
    """Raise PlanningError where a contour of one plane lies on the wrong side of the other plane."""
    for loops, plane, sign in ((bottom.loops, top.plane, -1.0), (top.loops, bottom.plane, 1.0)):
        for loop in loops:
            height = sign * ((loop.points - plane[:3]) @ plane[3:])
            if (height <= 0.0).any():
                place = loop.points[int(np.argmin(height))]
                raise PlanningError(
                    f"the two planes of a layer meet inside the part, near {place_text(place)}",
                    "choose planes that turn less between layers, or cut the part before it is sliced",
                )
