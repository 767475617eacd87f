"""The graph of fronts without its trifles: arcs between ends and branchings, short spurs and small holes taken out."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.decompose.fronts import Fronts

Floats = NDArray[np.float64]

_SPUR = 1.0  # of the front's width at the branching: a shorter free arc is a corner of it, not a limb
_ONWARD = 3.0  # times the volume of the next: such an arc goes on, the others are spurs
_HOLE = 1.2  # of the front's width at the branching: shorter ways round a hole are one way


@dataclass(frozen=True, eq=False)
class Arc:
    """Fronts in a row.  pieces : numbers in the graph   centre : (k, 3) float, mm   area_mm2 : (k,) float

    ends : pieces of branchings at its first and its last end, -1 where the end is free; these are among `pieces` too
    closed : whether something else follows at its first and its last end
    """

    pieces: list[int]
    centre: Floats
    area_mm2: Floats
    ends: tuple[int, int]
    closed: tuple[bool, bool]


def arcs(graph: Fronts, closed: Set[int]) -> list[Arc]:
    """The arcs of a graph of fronts, in the order of their lowest pieces.  closed : pieces at which something else follows"""
    links = _Links(graph, closed)
    while links.close_hole() or links.drop_spur():
        pass
    return [links.arc(row) for row in links.rows()]


class _Links:
    """Pieces that are left and who touches whom; centres and areas take in what was closed."""

    def __init__(self, graph: Fronts, closed: Set[int]) -> None:
        self.graph = graph
        self.closed = set(closed)
        self.centre, self.area = graph.centre.copy(), graph.area_mm2.copy()
        self.touching: dict[int, set[int]] = {piece: set() for piece in range(len(graph.band))}
        for low, high in graph.edges.tolist():
            self.touching[low].add(high)
            self.touching[high].add(low)

    def rows(self) -> list[list[int]]:
        """Rows of pieces between pieces that do not have two neighbours; of a closed ring from its lowest piece round to it."""
        stops = {piece for piece, near in self.touching.items() if len(near) != 2}
        made: list[list[int]] = []
        done: set[tuple[int, int]] = set()
        seen: set[int] = set()
        for start in [*sorted(stops, key=self._level), *sorted(self.touching, key=self._level)]:
            if start not in stops and start in seen:
                continue
            if not self.touching[start]:
                made.append([start])
            for first in sorted(self.touching[start]):
                if (start, first) in done:
                    continue
                row = [start, first]
                while row[-1] not in stops and row[-1] != start:
                    row.append(next(piece for piece in sorted(self.touching[row[-1]]) if piece != row[-2]))
                done.update({(row[0], row[1]), (row[-1], row[-2])})
                made.append(row)
            seen.update(piece for row in made for piece in row)
        return made

    def _level(self, piece: int) -> tuple[int, int]:
        return int(self.graph.band[piece]), piece

    def _remove(self, pieces: list[int]) -> None:
        for piece in pieces:
            for other in self.touching.pop(piece):
                if other in self.touching:
                    self.touching[other].discard(piece)

    def drop_spur(self) -> bool:
        """Take out the free arcs that are shorter than their branching is wide, all at once; not the longest of all.

        Nor one that goes on where all but one of the arcs at its branching are such, if it is far larger than the others.
        """
        rows = self.rows()
        longest = max(rows, key=len)
        spurs: dict[int, list[list[int]]] = {}
        for row in rows:
            free = [len(self.touching[row[k]]) == 1 for k in (0, -1)]
            if sum(free) != 1 or row is longest:
                continue
            spur, stop = (row[:-1], row[-1]) if free[0] else (row[1:], row[0])
            if len(spur) * self.graph.step_mm < _SPUR * self.graph.width_mm(stop):
                spurs.setdefault(stop, []).append(spur)
        for stop, found in spurs.items():
            found.sort(key=lambda spur: float(self.area[spur].sum()))
            if len(found) == len(self.touching[stop]) - 1 and len(found) > 1:
                last, other = (float(self.area[spur].sum()) for spur in (found[-1], found[-2]))
                if last >= _ONWARD * other:
                    found.pop()
            for spur in found:
                if not self.closed.isdisjoint(spur):
                    self.closed.add(stop)
                self._remove(spur)
        return bool(spurs)

    def close_hole(self) -> bool:
        """Take two arcs with the same ends for one, if they are shorter than their branching is wide."""
        rows = [row for row in self.rows() if len(row) > 2]
        for i, first in enumerate(rows):
            for second in rows[i + 1 :]:
                if {first[0], first[-1]} != {second[0], second[-1]} or first[0] == first[-1]:
                    continue
                limit = _HOLE * max(self.graph.width_mm(first[0]), self.graph.width_mm(first[-1]))
                if max(len(first), len(second)) * self.graph.step_mm < limit:
                    self._merge(first[1:-1], second[1:-1])
                    return True
        return False

    def _merge(self, kept: list[int], dropped: list[int]) -> None:
        band = {int(self.graph.band[piece]): piece for piece in kept}
        for piece in dropped:
            into = band.get(int(self.graph.band[piece]))
            if into is not None:
                total = self.area[into] + self.area[piece]
                self.centre[into] = (self.centre[into] * self.area[into] + self.centre[piece] * self.area[piece]) / total
                self.area[into] = total
        self._remove(dropped)

    def arc(self, row: list[int]) -> Arc:
        """A row as an arc."""
        ends = [row[k] if len(self.touching[row[k]]) > 2 or (row[0] == row[-1] and len(row) > 1) else -1 for k in (0, -1)]
        closed = [end >= 0 or row[k] in self.closed for k, end in zip((0, -1), ends, strict=True)]
        return Arc(row, self.centre[row], self.area[row], (ends[0], ends[1]), (closed[0], closed[1]))
