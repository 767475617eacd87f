"""A part's centroidal axis as a graph with radii (paper V): where limbs leave, where they join, how thick they are."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from planner.decompose.centroidal import lengths_along
from planner.decompose.fronts import Fronts, fronts, ways_inside
from planner.decompose.limbs import Limb, limbs
from planner.decompose.occupancy import Occupancy, occupancy
from planner.decompose.tracing import Trace, traced
from planner.mesh.mesh import Mesh
from planner.plan import Skeleton
from planner.slicing.section import plane_frame

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_JOINT = 14.0  # volume over cubed radius of the limbs that meet: what is smaller is a joint, not a body (a cube: 5.6)
_LONG = 3.0  # length over width of a body whose axis runs along it, whatever the build direction
_TOGETHER = 1.0  # of a limb's radius: limbs that join an axis nearer to each other join it at one point
_STUB = 1.0  # of the radius: what an axis reaches beyond the limbs that join it, to count as a free end


@dataclass(eq=False)
class _Stretch:
    """One axis of the graph to be.  is_limb : sticks out of another at its first point   host : number of that one

    joins : points (index) at which others join   keeps_end : whether its last point is an end even if it is short
    """

    trace: Trace
    host: int = -1
    keeps_end: bool = True
    joins: list[int] = field(default_factory=list)


def skeleton(mesh: Mesh, direction: Floats) -> Skeleton:
    """The centroidal axis of a closed part as a graph with radii, from its base along a direction.

    mesh : mm, any frame   direction : (3,) float, any length, same frame
    Limbs that stick out anywhere have branches of their own, measured by sections square on them; a tube's axis runs in its
    bore. What is left when they are taken away is a joint (one node), a long body (axis along it) or a block (axis along the
    direction). Nodes without edges do not occur; bodies that do not touch are graphs of their own.
    """
    axis = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    body = occupancy(mesh, axis)
    found, left = limbs(body, plane_frame(np.concatenate([np.zeros(3), axis]))[:0:-1])
    owner = _owners(body, found, left)
    height = body.centres @ axis
    standing = height < height.min() + body.cube_mm
    stretches = [_limb(mesh, body, limb.cubes, limb.root, _host(body, owner, limb.root, k)) for k, limb in enumerate(found)]
    for number in range(len(found), int(owner.max()) + 1):
        stretches.append(_core(mesh, body, owner, number, stretches, standing, axis))
    return _graph(stretches)


def _owners(body: Occupancy, found: list[Limb], left: NDArray[np.bool_]) -> Ints:
    """(n,) int64   Number of the limb of each cube, then of the connected bodies that are left."""
    owner = np.full(len(body.centres), -1, dtype=np.int64)
    for k, limb in enumerate(found):
        owner[limb.cubes] = k
    whole = fronts(body, np.zeros(len(body.centres)), left)
    owner[left] = whole.part[left] + len(found)
    return owner


def _host(body: Occupancy, owner: Ints, root: Ints, own: int) -> int:
    """What most of the root's cubes touch, besides their own; -1 for nothing."""
    across = body.links[root]
    touched = owner[across[across >= 0]]
    touched = touched[touched != own]
    return int(np.bincount(touched).argmax()) if len(touched) else -1


def _chain(graph: Fronts) -> tuple[Floats, Floats]:
    """Centres and areas of the fronts from the lowest to the farthest, by the largest below each."""
    below, _ = graph.neighbours()
    ends = np.flatnonzero(graph.band == graph.band.max())
    chain = [int(ends[np.argmax(graph.area_mm2[ends])])]
    while below[chain[-1]]:
        chain.append(max(below[chain[-1]], key=lambda piece: (graph.area_mm2[piece], -piece)))
    chain.reverse()
    return graph.centre[chain], graph.area_mm2[chain]


def _limb(mesh: Mesh, body: Occupancy, cubes: Ints, root: Ints, host: int) -> _Stretch:
    """A limb's axis from its root to its end."""
    inside, sources = np.zeros((2, len(body.centres)), dtype=np.bool_)
    inside[cubes], sources[root] = True, True
    part = body.only(inside)
    graph = fronts(part, ways_inside(part, sources[inside]))
    area = np.bincount(graph.band, graph.area_mm2)
    chain = np.column_stack([np.bincount(graph.band, graph.area_mm2 * graph.centre[:, k]) for k in range(3)]) / area[:, None]
    return _Stretch(traced(mesh, chain, area, (False, True)), host)


def _core(
    mesh: Mesh, body: Occupancy, owner: Ints, number: int, limbs_made: list[_Stretch], standing: NDArray[np.bool_], axis: Floats
) -> _Stretch:
    """The axis of a body that is left when the limbs are taken away."""
    inside = owner == number
    part = body.only(inside)
    volume = len(part.centres) * body.cube_mm**3
    guests = [limb for limb in limbs_made if limb.host == number]
    thick = max((float(limb.trace.radii[0]) for limb in guests), default=0.0)
    if len(guests) > 1 and volume < _JOINT * thick**3 and not (inside & standing).any():
        return _Stretch(Trace(_meeting(guests, part.centres.mean(axis=0))[None, :], np.array([thick])))
    if not guests and (owner != number).any():
        across = body.links
        touching = inside & ((across >= 0) & (owner[across] != number)).any(axis=1)
        if touching.any():
            roots = np.flatnonzero(touching)
            return _limb(mesh, body, np.flatnonzero(inside), roots, _host(body, owner, roots, number))
    if (inside & standing).any():
        chain, area = _chain(fronts(part, ways_inside(part, standing[inside])))
        return _Stretch(traced(mesh, chain, area, (True, True)), keeps_end=False)
    far = _farthest(part)
    graph = fronts(part, ways_inside(part, far))
    chain, area = _chain(graph)
    middle = int(np.argmin(np.linalg.norm(graph.centre - chain[len(chain) // 2], axis=1)))
    if lengths_along(chain)[-1] > _LONG * graph.width_mm(middle):
        return _Stretch(traced(mesh, chain, area, (True, True)), keeps_end=False)
    chain, area = _chain(fronts(part, part.centres @ axis, cubes=1.0))
    return _Stretch(traced(mesh, chain, area, (False, True)))


def _farthest(part: Occupancy) -> NDArray[np.bool_]:
    """(n,) bool   The cubes at one end of a body: farthest from what is farthest from its first cube."""
    source = np.zeros(len(part.centres), dtype=np.bool_)
    source[0] = True
    for _ in range(2):
        ways = ways_inside(part, source)
        ways[~np.isfinite(ways)] = -1.0
        source = ways > ways.max() - 1.5 * part.cube_mm
    return source


def _meeting(guests: list[_Stretch], centre: Floats) -> Floats:
    """The point nearest to the axes of the limbs that meet, carried on; the joint's centre counts a little."""
    matrix, right = 0.05 * np.eye(3), 0.05 * centre
    for guest in guests:
        point, direction = _root_line(guest.trace)
        across = np.eye(3) - np.outer(direction, direction)
        matrix, right = matrix + across, right + across @ point
    return np.asarray(np.linalg.solve(matrix, right))


def _root_line(trace: Trace) -> tuple[Floats, Floats]:
    """First point of a limb's axis and the unit direction from there into the limb."""
    reach = min(len(trace.points) - 1, max(int(0.25 * len(trace.points)), 2))
    away = trace.points[reach] - trace.points[0]
    return trace.points[0], np.asarray(away / max(float(np.linalg.norm(away)), 1e-12))


def _graph(stretches: list[_Stretch]) -> Skeleton:
    """Nodes, radii and edges: every axis a chain, limbs tied to the point of their host that lies nearest to their axis."""
    ties = _ties(stretches)
    nodes: list[Floats] = []
    radii: list[Floats] = []
    edges: list[tuple[int, int]] = []
    first: list[int] = []
    count = 0
    for stretch in stretches:
        size = len(stretch.trace.points)
        first.append(count)
        nodes.append(stretch.trace.points)
        radii.append(stretch.trace.radii)
        edges += [(count + i, count + i + 1) for i in range(size - 1)]
        count += size
    for limb, host, index in ties:
        edges.append((first[host] + index, first[limb]))
    return _used(np.vstack(nodes), np.concatenate(radii), np.array(edges, dtype=np.int64).reshape(-1, 2), _stubs(stretches, first))


def _ties(stretches: list[_Stretch]) -> list[tuple[int, int, int]]:
    """(limb, host, index of the host's point) for each limb; limbs that join close together share the point."""
    found: list[tuple[int, int, float]] = []
    for k, limb in enumerate(stretches):
        if limb.host < 0:
            continue
        points = stretches[limb.host].trace.points
        start, direction = _root_line(limb.trace)
        away = points - start
        aside = np.linalg.norm(away - np.minimum(away @ direction, 0.0)[:, None] * direction, axis=1)
        found.append((limb.host, k, float(np.argmin(aside + 0.15 * np.linalg.norm(away, axis=1)))))
    found.sort(key=lambda tie: (tie[0], tie[2], tie[1]))
    ties, group = [], []
    for tie in [*found, (-1, -1, 0.0)]:
        if group and (tie[0] != group[-1][0] or not _are_close(stretches, group[-1], tie)):
            index = round(sum(member[2] for member in group) / len(group))
            for host, limb, _ in group:
                stretches[host].joins += [index, _beside(stretches[host], stretches[limb])]
                ties.append((limb, host, index))
            group = []
        group.append(tie)
    return ties


def _are_close(stretches: list[_Stretch], first: tuple[int, int, float], second: tuple[int, int, float]) -> bool:
    points = stretches[first[0]].trace.points
    apart = float(np.linalg.norm(points[int(first[2])] - points[int(second[2])]))
    return apart < _TOGETHER * float(stretches[second[1]].trace.radii[0])


def _beside(host: _Stretch, limb: _Stretch) -> int:
    """The host's point nearest to the limb's root."""
    return int(np.argmin(np.linalg.norm(host.trace.points - limb.trace.points[0], axis=1)))


def _stubs(stretches: list[_Stretch], first: list[int]) -> set[int]:
    """Nodes of ends that hardly reach beyond the limbs that join there."""
    taken: set[int] = set()
    for stretch, start in zip(stretches, first, strict=True):
        if stretch.keeps_end or not stretch.joins or len(stretch.trace.points) < 2:
            continue
        along = lengths_along(stretch.trace.points)
        low, high = min(stretch.joins), max(stretch.joins)
        if along[-1] - along[high] < _STUB * stretch.trace.radii[high]:
            taken.update(range(start + max(stretch.joins[::2]) + 1, start + len(along)))
        if along[low] < _STUB * stretch.trace.radii[low]:
            taken.update(range(start, start + min(stretch.joins[::2])))
    return taken


def _used(nodes: Floats, radii: Floats, edges: Ints, taken: set[int]) -> Skeleton:
    """The graph without the nodes taken away."""
    keep = np.array([k not in taken for k in range(len(nodes))], dtype=np.bool_)
    number = np.cumsum(keep) - 1
    kept = edges[keep[edges].all(axis=1)]
    return Skeleton(nodes[keep], radii[keep], number[kept])
