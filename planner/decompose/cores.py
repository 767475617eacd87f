"""What is left of a part when its limbs are taken away: a joint, a long body (with holes, perhaps) or a block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from planner.decompose.centroidal import lengths_along
from planner.decompose.fronts import Fronts, fronts, ways_inside
from planner.decompose.limbs import Limb, limbs
from planner.decompose.occupancy import Occupancy, occupancy
from planner.decompose.reeb import Arc, arcs
from planner.decompose.tracing import End, Trace, traced, traced_level
from planner.mesh.mesh import Mesh
from planner.slicing.section import plane_frame

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_JOINT = 14.0  # volume over cubed radius of the limbs that meet: what is smaller is a joint, not a body (a cube: 5.6)
_LONG = 3.0  # length over width of a body whose axis runs along it, whatever the build direction
_LONG_ON_BASE = 1.2  # the same for one that stands on the base: its axis begins there
_ROOT = 1.5  # radii of a limb over which its direction at the root is taken
_CLOSED = 0.3  # of an end's cubes that touch something else: the axis does not end there


@dataclass(eq=False)
class Stretch:
    """One axis of the graph to be.

    owner : number of the limb or body that it belongs to   host : of the one that it sticks out of at its first point, -1: none
    closed : whether something else follows at its first and its last end
    prunes : whether a free end goes that hardly reaches beyond the limbs that join there
    branchings : number of the branching at its first and its last end, -1 for none   joins : places where limbs join
    """

    trace: Trace
    owner: int
    host: int = -1
    closed: tuple[bool, bool] = (False, False)
    prunes: bool = False
    branchings: tuple[int, int] = (-1, -1)
    joins: list[float] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Anatomy:
    """A part's cubes and who owns them.

    owner : (n,) int64, limbs first   standing : (n,) bool, cubes of the base   axis : (3,) float, build direction
    """

    mesh: Mesh
    body: Occupancy
    owner: Ints
    standing: Flags
    axis: Floats
    limbs: list[Limb]

    @classmethod
    def of(cls, mesh: Mesh, axis: Floats) -> Anatomy:
        """Limbs found, and the connected bodies that are left numbered after them."""
        body = occupancy(mesh, axis)
        found, left = limbs(body, plane_frame(np.concatenate([np.zeros(3), axis]))[:0:-1])
        owner = np.full(len(body.centres), -1, dtype=np.int64)
        for k, limb in enumerate(found):
            owner[limb.cubes] = k
        owner[left] = fronts(body, np.zeros(len(body.centres)), left).part[left] + len(found)
        height = body.centres @ axis
        return cls(mesh, body, owner, height < height.min() + body.cube_mm, axis, found)

    def host(self, root: Ints, own: int) -> int:
        """Owner of most of the cubes that the root's touch, besides their own; -1 for none."""
        across = self.body.links[root]
        touched = self.owner[across[across >= 0]]
        touched = touched[touched != own]
        return int(np.bincount(touched).argmax()) if len(touched) else -1

    def limb(self, cubes: Ints, root: Ints, own: int) -> Stretch:
        """A limb's axis from its root to its end."""
        inside, sources = np.zeros((2, len(self.owner)), dtype=np.bool_)
        inside[cubes], sources[root] = True, True
        part = self.body.only(inside)
        graph = fronts(part, ways_inside(part, sources[inside]))
        area = np.bincount(graph.band, graph.area_mm2).astype(np.float64)
        sums = [np.bincount(graph.band, graph.area_mm2 * graph.centre[:, k]) for k in range(3)]
        trace = traced(self.mesh, np.column_stack(sums) / area[:, None], area, ("root", "free"))
        return Stretch(trace, own, self.host(root, own), (True, False))

    def core(self, number: int, guests: Sequence[Stretch]) -> list[Stretch]:
        """The axes of a body that is left; guests are the limbs that stick out of it. Joints are axes of one point."""
        inside = self.owner == number
        part = self.body.only(inside)
        volume = len(part.centres) * self.body.cube_mm**3
        is_base = bool((inside & self.standing).any())
        touching = inside & ((self.body.links >= 0) & (self.owner[self.body.links] != number)).any(axis=1)
        if not is_base and guests:
            thick = max(float(guest.trace.radii[0]) for guest in guests)
            if volume < _JOINT * thick**3 and len(guests) > 1:
                return [Stretch(Trace(meeting(guests, part.centres.mean(axis=0))[None, :], np.array([thick])), number)]
        if not is_base and not guests and touching.any():
            return self._left_over(inside, touching, number, volume)
        graph = fronts(part, ways_inside(part, self.standing[inside] if is_base else _farthest(part)))
        taken = np.bincount(graph.part, touching[inside]) > _CLOSED * np.bincount(graph.part)
        found = arcs(graph, set(np.flatnonzero(taken).tolist()))
        if _length(found) > (_LONG_ON_BASE if is_base else _LONG) * _width(graph, found):
            return self._long(found, number)
        return [self._block(part, number, touching[inside])]

    def _left_over(self, inside: Flags, touching: Flags, number: int, volume: float) -> list[Stretch]:
        """What is left beside a limb: a limb of it, or a chip between limbs, which has no axis."""
        roots = np.flatnonzero(touching)
        host = self.host(roots, number)
        if 0 <= host < len(self.limbs) and volume < _JOINT * (self.limbs[host].area_mm2 / np.pi) ** 1.5:
            return []
        return [self.limb(np.flatnonzero(inside), roots, number)]

    def _long(self, found: list[Arc], number: int) -> list[Stretch]:
        """Axes along the arcs of a long body."""
        made = []
        for arc in found:
            kinds: list[End] = ["joined" if is_closed else "free" for is_closed in arc.closed]
            kinds = ["branching" if arc.ends[k] >= 0 else kind for k, kind in enumerate(kinds)]
            trace = traced(self.mesh, arc.centre, arc.area_mm2, (kinds[0], kinds[1]))
            made.append(Stretch(trace, number, -1, arc.closed, True, arc.ends))
        return made

    def _block(self, part: Occupancy, number: int, touching: Flags) -> Stretch:
        """The axis of a block along the build direction, through the centroids of level sections."""
        graph = fronts(part, part.centres @ self.axis, cubes=1.0)
        area = np.bincount(graph.band, graph.area_mm2).astype(np.float64)
        sums = [np.bincount(graph.band, graph.area_mm2 * graph.centre[:, k]) for k in range(3)]
        size, taken = np.bincount(graph.band[graph.part]), np.bincount(graph.band[graph.part], touching)
        closed = (bool(taken[0] > _CLOSED * size[0]), bool(taken[-1] > _CLOSED * size[-1]))
        trace = traced_level(self.mesh, np.column_stack(sums) / area[:, None], area, self.axis, (not closed[0], not closed[1]))
        return Stretch(trace, number, -1, closed)


def _length(found: list[Arc]) -> float:
    """Length of the arcs together, mm."""
    return float(sum(lengths_along(arc.centre)[-1] for arc in found))


def _width(graph: Fronts, found: list[Arc]) -> float:
    """Width of the middle front of the longest arc, mm."""
    longest = max(found, key=lambda arc: len(arc.pieces))
    return graph.width_mm(longest.pieces[len(longest.pieces) // 2])


def _farthest(part: Occupancy) -> Flags:
    """(n,) bool   The cubes at one end of a body: farthest from what is farthest from its first cube."""
    source = np.zeros(len(part.centres), dtype=np.bool_)
    source[0] = True
    for _ in range(2):
        ways = ways_inside(part, source)
        ways[~np.isfinite(ways)] = -1.0
        source = ways > ways.max() - 1.5 * part.cube_mm
    return source


def meeting(guests: Sequence[Stretch], centre: Floats) -> Floats:
    """(3,) float, mm   The point nearest to the axes of limbs that meet, carried on; the joint's centre counts a little."""
    matrix, right = 0.05 * np.eye(3), 0.05 * centre
    for guest in guests:
        point, direction = root_line(guest.trace)
        across = np.eye(3) - np.outer(direction, direction)
        matrix, right = matrix + across, right + across @ point
    return np.asarray(np.linalg.solve(matrix, right))


def root_line(trace: Trace) -> tuple[Floats, Floats]:
    """First point (3,), mm, of a limb's axis and the unit direction (3,) from there into the limb."""
    away = trace.points - trace.points[0]
    apart = np.linalg.norm(away, axis=1)
    near = int(np.searchsorted(apart > _ROOT * trace.radii[0], True)) if len(apart) > 2 else 1
    reach = min(max(near, 2), len(apart) - 1)
    return trace.points[0], np.asarray(away[reach] / max(float(apart[reach]), 1e-12))
