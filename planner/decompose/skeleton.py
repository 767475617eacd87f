"""A part's centroidal axis as a graph with radii (paper V): where limbs leave, where they join, how thick they are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.decompose.centroidal import lengths_along
from planner.decompose.cores import Anatomy, Stretch, meeting, root_line
from planner.decompose.tracing import Trace
from planner.mesh.mesh import Mesh
from planner.plan import Skeleton

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_TOGETHER = 1.2  # of a limb's radius: limbs that join an axis nearer to each other join it at one point
_STUB = 1.0  # of the radius: what an axis reaches beyond the limbs that join it, to count as a free end
_FINE = 16  # places tried on each radius of an axis
_MOST_PLACES = 4000  # on one axis
_NEARNESS = 0.15  # how much the way to the place counts beside its distance from the limb's line


def skeleton(mesh: Mesh, direction: Floats) -> Skeleton:
    """The centroidal axis of a closed part as a graph with radii, from its base along a direction.

    mesh : mm, any frame   direction : (3,) float, any length, same frame
    Limbs that stick out anywhere have branches of their own, measured by sections square on them; a tube's axis runs in its
    bore. What is left when they are taken away is a joint (one node), a long body (axis along it, round holes on both sides
    where they are large) or a block (axis along the direction). Bodies that do not touch are graphs of their own.
    """
    axis = np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)
    part = Anatomy.of(mesh, axis)
    stretches = [part.limb(limb.cubes, limb.root, k) for k, limb in enumerate(part.limbs)]
    for number in range(len(part.limbs), int(part.owner.max()) + 1):
        guests = [limb for limb in stretches if limb.host == number]
        stretches += part.core(number, guests)
    return _graph(stretches)


@dataclass(frozen=True, eq=False)
class _Tie:
    """Where a limb joins its host.  stretch : of the host   at : place on its points, a fraction between two

    weight : how well the limb's line tells the place: little where it runs along the host
    """

    limb: int
    stretch: int
    at: float
    weight: float


def _graph(stretches: list[Stretch]) -> Skeleton:
    """Nodes, radii and edges: every axis a chain, limbs tied to the place of their host that lies nearest to their line."""
    ties = _shared(stretches, _ties(stretches))
    for tie in ties:
        host, limb = stretches[tie.stretch], stretches[tie.limb]
        fine = _places(host)
        beside = np.linalg.norm(_at(host.trace.points, fine.tolist()) - limb.trace.points[0], axis=1)
        host.joins += [tie.at, float(fine[int(np.argmin(beside))])]
    nodes: list[Floats] = []
    radii: list[Floats] = []
    edges: list[list[int]] = []
    numbers: list[dict[float, int]] = []
    count = 0
    for k, stretch in enumerate(stretches):
        places = sorted({float(i) for i in range(len(stretch.trace.points))} | {tie.at for tie in ties if tie.stretch == k})
        low, high = _kept(stretch)
        places = [place for place in places if low <= place <= high]
        nodes.append(_at(stretch.trace.points, places))
        radii.append(_at(stretch.trace.radii[:, None], places)[:, 0])
        edges += [[count + i, count + i + 1] for i in range(len(places) - 1)]
        numbers.append({place: count + i for i, place in enumerate(places)})
        count += len(places)
    for tie in ties:
        edges.append([numbers[tie.stretch][tie.at], min(numbers[tie.limb].values())])
    joined, more = _branchings(stretches, numbers)
    edges += [[a, count + k] for k, b in enumerate(more) for a in joined[k]]
    nodes += [point[None, :] for point in more]
    radii += [np.array([np.mean([np.concatenate(radii)[a] for a in group])]) for group in joined]
    return Skeleton(np.vstack(nodes), np.concatenate(radii), np.array(edges, dtype=np.int64).reshape(-1, 2))


def _at(values: Floats, places: list[float]) -> Floats:
    """(p, d) float   Rows of values (k, d) at fractions between them."""
    rows = np.arange(len(values))
    return np.column_stack([np.interp(places, rows, values[:, k]) for k in range(values.shape[1])])


def _places(host: Stretch) -> Floats:
    """Places along an axis, fractions between its points, near enough to each other to look for the nearest."""
    along = lengths_along(host.trace.points)
    count = int(np.ceil(along[-1] / max(float(host.trace.radii.min()), 1e-9))) * _FINE + (len(along) - 1) * 2
    fine = np.linspace(0.0, along[-1], min(count, _MOST_PLACES) + 1)
    rows = np.arange(float(len(along)))
    return np.unique(np.concatenate([np.interp(fine, along, rows), rows])) if along[-1] > 0.0 else np.zeros(1)


def _ties(stretches: list[Stretch]) -> list[_Tie]:
    """The place of its host that lies nearest to each limb's line, carried on backwards."""
    made = []
    for k, limb in enumerate(stretches):
        start, direction = root_line(limb.trace)
        best: tuple[float, _Tie] | None = None
        for number, host in enumerate(stretches):
            if limb.host < 0 or host.owner != limb.host or number == k:
                continue
            places = _places(host)
            away = _at(host.trace.points, places.tolist()) - start
            aside = np.linalg.norm(away - np.minimum(away @ direction, 0.0)[:, None] * direction, axis=1)
            cost = aside + _NEARNESS * np.linalg.norm(away, axis=1)
            row = int(np.argmin(cost))
            if best is None or cost[row] < best[0]:
                best = (float(cost[row]), _Tie(k, number, float(places[row]), _weight(host, float(places[row]), direction)))
        if best is not None:
            made.append(best[1])
    return made


def _weight(host: Stretch, place: float, direction: Floats) -> float:
    """Squared sine of the angle between a limb's line and its host's axis, and a little."""
    low = int(np.clip(np.floor(place), 0, max(len(host.trace.points) - 2, 0)))
    along = host.trace.points[min(low + 1, len(host.trace.points) - 1)] - host.trace.points[low]
    length = float(np.linalg.norm(along))
    return 1.0 if length <= 0.0 else 1.01 - float(direction @ along / length) ** 2


def _shared(stretches: list[Stretch], ties: list[_Tie]) -> list[_Tie]:
    """Ties nearer to each other than a limb is thick, brought to one place."""
    made: list[_Tie] = []
    group: list[_Tie] = []
    for tie in [*sorted(ties, key=lambda tie: (tie.stretch, tie.at, tie.limb)), None]:
        if group and (tie is None or not _are_close(stretches, group[-1], tie)):
            place = sum(one.weight * one.at for one in group) / sum(one.weight for one in group)
            made += [replace(member, at=place) for member in group]
            group = []
        if tie is not None:
            group.append(tie)
    return made


def _are_close(stretches: list[Stretch], first: _Tie, second: _Tie) -> bool:
    if first.stretch != second.stretch or not stretches[first.stretch].prunes:
        return first.stretch == second.stretch and first.at == second.at
    pair = _at(stretches[first.stretch].trace.points, [first.at, second.at])
    return bool(np.linalg.norm(pair[1] - pair[0]) < _TOGETHER * stretches[second.limb].trace.radii[0])


def _kept(stretch: Stretch) -> tuple[float, float]:
    """First and last place of an axis that stay: where something follows, or next to nothing, it ends at the outermost tie."""
    last = len(stretch.trace.points) - 1.0
    if stretch.host >= 0 or not stretch.joins or last == 0.0:
        return 0.0, last
    along, rows = lengths_along(stretch.trace.points), np.arange(last + 1.0)
    low, high = min(stretch.joins), max(stretch.joins)
    reach = np.interp([low, high], rows, stretch.trace.radii) * _STUB
    before, after = float(np.interp(low, rows, along)), float(along[-1] - np.interp(high, rows, along))
    cuts_low = stretch.branchings[0] < 0 and (stretch.closed[0] or (stretch.prunes and before < reach[0]))
    cuts_high = stretch.branchings[1] < 0 and (stretch.closed[1] or (stretch.prunes and after < reach[1]))
    ties = stretch.joins[::2]
    return min(ties) if cuts_low else 0.0, max(ties) if cuts_high else last


def _branchings(stretches: list[Stretch], numbers: list[dict[float, int]]) -> tuple[list[list[int]], list[Floats]]:
    """Nodes that meet at each branching of a long body, and its place."""
    groups: dict[tuple[int, int], list[tuple[int, Stretch, bool]]] = {}
    for stretch, places in zip(stretches, numbers, strict=True):
        for side, piece in enumerate(stretch.branchings):
            if piece >= 0:
                node = places[max(places) if side else min(places)]
                groups.setdefault((stretch.owner, piece), []).append((node, stretch, bool(side)))
    nodes, points = [], []
    for key in sorted(groups):
        members = groups[key]
        ends = np.array([stretch.trace.points[-1 if side else 0] for _, stretch, side in members])
        turned = [Stretch(_reversed(stretch.trace) if side else stretch.trace, stretch.owner) for _, stretch, side in members]
        nodes.append([node for node, _, _ in members])
        points.append(meeting(turned, ends.mean(axis=0)) if len(members) > 2 else _bridged(turned))
    return nodes, points


def _bridged(pair: list[Stretch]) -> Floats:
    """The middle of the cubic that goes on from one axis into the other."""
    (first, into_first), (second, into_second) = (root_line(stretch.trace) for stretch in pair)
    gap = float(np.linalg.norm(second - first))
    return np.asarray(0.5 * (first + second) - gap / 8.0 * (into_first + into_second))


def _reversed(trace: Trace) -> Trace:
    return Trace(trace.points[::-1], trace.radii[::-1])
