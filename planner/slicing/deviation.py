"""How far the walls of layers, as they are built, lie from the mesh: measured, slab by slab."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.mesh.nearest import FacetTree
from planner.slicing.cusp import LayerRule, ToleranceSide
from planner.slicing.section import Section
from planner.slicing.slicer import slice_mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

INSIDE = 2e-6
"""Of the mesh's diagonal: how far inside a slab its bottom and top sections are taken, so that faces that are level only
to the last digits of 32-bit coordinates fall on the right side."""
SAMPLES = 160  # points of a section that are measured, at most, and while searching
ROUGHLY = 48
SHARES = (0.25, 0.5, 0.75, 1.0)  # of a ruling, at which it is measured: a chord is farthest from its arc half-way
_SAME_WAY = 0.2  # cosine between the tangents of outlines that one ruling may join


@dataclass(frozen=True)
class WallDeviations:
    """What `wall_deviations` found, slab by slab.

    deviation_mm : (k,) float   greatest distance from the wall to the mesh; 0 where there is no wall
    is_swept : (k,) bool        ruled walls: the greatest lies on a part that goes straight up or down, having no partner
    share : (k,) float          the deviation over what is allowed, where that is known (see `planner.slicing.confirm`)
    """

    deviation_mm: Floats
    is_swept: NDArray[np.bool_]
    share: Floats

    @classmethod
    def none(cls) -> WallDeviations:
        """Of no slab."""
        return cls(np.zeros(0), np.zeros(0, dtype=bool), np.zeros(0))

    def taken(self, rows: Ints) -> WallDeviations:
        """Of some of the slabs.  rows : (j,) int64"""
        return WallDeviations(self.deviation_mm[rows], self.is_swept[rows], self.share[rows])

    def with_new(self, is_new: NDArray[np.bool_], other: WallDeviations) -> WallDeviations:
        """The same with those of other slabs in some places.  is_new : (k,) bool, as many True as other has slabs"""
        rows = np.arange(len(is_new))
        rows[is_new] = len(is_new) + np.arange(int(is_new.sum()))
        both = WallDeviations(
            np.concatenate([self.deviation_mm, other.deviation_mm]),
            np.concatenate([self.is_swept, other.is_swept]),
            np.concatenate([self.share, other.share]),
        )
        return both.taken(rows)


def wall_deviations(
    mesh: Mesh,
    planes: Floats,
    rule: LayerRule,
    side: ToleranceSide = "both",
    tree: FacetTree | None = None,
    samples: int = SAMPLES,
) -> WallDeviations:
    """Measure the walls of the slabs between neighbouring planes.

    planes : (k + 1, 6) float   a point (mm) and a unit normal each, from below; they may lean but not cross in the mesh
    rule   : "ruled" straight lines between bottom and top section, from each point to the nearest of the other outline that
             runs the same way and hangs together with it inside the slab; where there is none, or where that lies
             nearer to the mesh, straight along the slab.
             Else the bottom, middle and top section are extruded through the slab.
    side   : extruded walls: count those that lie "outside" the mesh, "inside", or "both"
    tree   : of the mesh, if there is one already      samples : points of each section that are measured, at most.

    Distances are exact: from points of the wall to the nearest facet of the mesh. Raises as `slice_mesh` does.
    """
    return slab_deviations(mesh, (planes[:-1], planes[1:]), rule, side, tree, samples)


def slab_deviations(
    mesh: Mesh,
    slabs: tuple[Floats, Floats],
    rule: LayerRule,
    side: ToleranceSide = "both",
    tree: FacetTree | None = None,
    samples: int = SAMPLES,
) -> WallDeviations:
    """The same for any slabs, which need not follow each other.  slabs : lower and upper planes, (k, 6) float each."""
    known = tree or FacetTree(mesh)
    if not len(slabs[0]):
        return WallDeviations.none()
    inset = INSIDE * mesh.diagonal
    lower, upper = slabs[0].copy(), slabs[1].copy()
    lower[:, :3] += inset * lower[:, 3:]
    upper[:, :3] -= inset * upper[:, 3:]
    bottoms, tops = slice_mesh(mesh, lower, "above"), slice_mesh(mesh, upper, "below")
    if rule == "ruled":
        return _measure_ruled(mesh, slabs, bottoms, tops, known, samples)
    middle = 0.5 * (lower + upper)
    middle[:, 3:] /= np.linalg.norm(middle[:, 3:], axis=1, keepdims=True)
    return _measure_extruded(
        mesh, (lower, middle, upper), (bottoms, slice_mesh(mesh, middle), tops), side, known, samples
    )


def _measure_extruded(
    mesh: Mesh,
    planes: tuple[Floats, Floats, Floats],
    sections: tuple[list[Section], list[Section], list[Section]],
    side: ToleranceSide,
    tree: FacetTree,
    samples: int,
) -> WallDeviations:
    """Each of the three sections moved along the slab to the two other planes."""
    count = len(planes[0])
    points, slabs = [], []
    for own, cut in enumerate(sections):
        sampled, slab = _stacked(_samples(section, samples)[0] for section in cut)
        along = planes[1][slab, 3:]
        for other in (0, 1, 2):
            if other != own:
                points.append(_moved(sampled, along, planes[other][slab]))
                slabs.append(slab)
    asked, slab = np.concatenate(points), np.concatenate(slabs)
    distance, facet, foot = tree.nearest(asked)
    if side != "both":
        signed = np.einsum("ij,ij->i", asked - foot, mesh.normals[facet])
        distance = np.where((signed > 0.0) == (side == "outside"), distance, 0.0)
    greatest = np.zeros(count)
    np.maximum.at(greatest, slab, distance)
    return WallDeviations(greatest, np.zeros(count, dtype=bool), np.full(count, np.nan))


def _measure_ruled(
    mesh: Mesh,
    planes: tuple[Floats, Floats],
    bottoms: list[Section],
    tops: list[Section],
    tree: FacetTree,
    samples: int,
) -> WallDeviations:
    """Rulings from the points of both sections of each slab; each joins its partner or goes straight, as lies nearer."""
    starts, ends, straights, slabs, swept = [], [], [], [], []
    for k, (bottom, top) in enumerate(zip(bottoms, tops, strict=True)):
        lower, upper = planes[0][k], planes[1][k]
        along = lower[3:] + upper[3:]
        along = np.broadcast_to(along / np.linalg.norm(along), (1, 3))
        label = _slab_pieces(mesh, lower, upper, bottom, top)
        for own, other, target in ((bottom, top, upper), (top, bottom, lower)):
            points, ways, facets = _samples(own, samples)
            if len(points):
                partner, found = _partners(points, ways, label[facets], *_segments(other, label))
                starts.append(points)
                straights.append(_moved(points, along, np.broadcast_to(target, (1, 6))))
                ends.append(np.where(found[:, None], partner, straights[-1]))
                slabs.append(np.full(len(points), k))
                swept.append(~found)
    greatest, is_swept = np.zeros(len(bottoms)), np.zeros(len(bottoms), dtype=bool)
    if not starts:
        return WallDeviations(greatest, is_swept, np.full(len(bottoms), np.nan))
    start, end, straight, slab, alone = (np.concatenate(parts) for parts in (starts, ends, straights, slabs, swept))
    away = _along_rulings(start, end, tree)
    doubtful = ~alone & (away > 0.1 * np.linalg.norm(straight - start, axis=1))
    if doubtful.any():
        otherwise = _along_rulings(start[doubtful], straight[doubtful], tree)
        alone[doubtful] = otherwise < away[doubtful]
        away[doubtful] = np.minimum(otherwise, away[doubtful])
    np.maximum.at(greatest, slab, away)
    is_swept[slab[alone & (away >= greatest[slab])]] = True
    return WallDeviations(greatest, is_swept, np.full(len(bottoms), np.nan))


def _along_rulings(start: Floats, end: Floats, tree: FacetTree) -> Floats:
    """Greatest distance, mm, of each straight line from the mesh: (n,).  start, end : (n, 3) float, mm."""
    return np.asarray(np.max([tree.nearest((1.0 - t) * start + t * end)[0] for t in SHARES], axis=0))


def _stacked(parts: Iterable[Floats]) -> tuple[Floats, Ints]:
    """Points of all parts in one array, and the number of the part that each comes from."""
    arrays = list(parts)
    number = np.repeat(np.arange(len(arrays)), [len(array) for array in arrays])
    return (np.concatenate(arrays) if arrays else np.empty((0, 3))), number


def _moved(points: Floats, along: Floats, planes: Floats) -> Floats:
    """Points moved along a direction each into a plane each; all (n, …) or (1, …)."""
    away = np.einsum("ij,ij->i", planes[:, :3] - points, np.broadcast_to(planes[:, 3:], points.shape))
    speed = np.einsum("ij,ij->i", along, planes[:, 3:])
    return np.asarray(points + (away / speed)[:, None] * along)


def _samples(section: Section, most: int) -> tuple[Floats, Floats, Ints]:
    """Points of a section's outline: corners and middles of its segments, or evenly many of them.

    Returns points (n, 3) mm, the way of the outline there (n, 3) unit, and the mesh's facet (n,).
    """
    if not section.loops:
        return np.empty((0, 3)), np.empty((0, 3)), np.empty(0, dtype=np.int64)
    points, ways, facets = [], [], []
    for loop in section.loops:
        step = np.roll(loop.points, -1, axis=0) - loop.points
        way = step / np.linalg.norm(step, axis=1, keepdims=True)
        both = way + np.roll(way, 1, axis=0)
        both /= np.maximum(np.linalg.norm(both, axis=1, keepdims=True), 1e-12)
        points.append(np.stack([loop.points, loop.points + 0.5 * step], axis=1).reshape(-1, 3))
        ways.append(np.stack([both, way], axis=1).reshape(-1, 3))
        facets.append(np.repeat(loop.facets, 2))
    stride = max(-(-sum(len(part) for part in points) // most), 1)
    stride += 1 - stride % 2  # odd: corners and middles in turn
    taken = slice(None, None, stride)
    return (
        np.concatenate([part[taken] for part in points]),
        np.concatenate([part[taken] for part in ways]),
        np.concatenate([part[taken] for part in facets]),
    )


def _segments(section: Section, label: Ints) -> tuple[Floats, Floats, Ints]:
    """All segments of a section: starts (n, 3) and ends (n, 3) in mm, and the piece (n,) that their facets belong to."""
    if not section.loops:
        return np.empty((0, 3)), np.empty((0, 3)), np.empty(0, dtype=np.int64)
    start = np.concatenate([loop.points for loop in section.loops])
    end = np.concatenate([np.roll(loop.points, -1, axis=0) for loop in section.loops])
    return start, end, label[np.concatenate([loop.facets for loop in section.loops])]


@njit(cache=True)
def _partners(
    points: Floats, ways: Floats, pieces: Ints, start: Floats, end: Floats, segment_pieces: Ints
) -> tuple[Floats, NDArray[np.bool_]]:  # pragma: no cover
    """Nearest point on the segments of the same piece that run the same way, and whether there is one."""
    partner, found = np.zeros(points.shape), np.zeros(points.shape[0], np.bool_)
    for i in range(points.shape[0]):
        best = np.inf
        for s in range(start.shape[0]):
            if segment_pieces[s] != pieces[i]:
                continue
            square, same, share = 0.0, 0.0, 0.0
            for axis in range(3):
                run = end[s, axis] - start[s, axis]
                square += run * run
                same += run * ways[i, axis]
                share += run * (points[i, axis] - start[s, axis])
            if same < _SAME_WAY * np.sqrt(square):
                continue
            share = min(max(share / square, 0.0), 1.0)
            away = 0.0
            for axis in range(3):
                away += (start[s, axis] + share * (end[s, axis] - start[s, axis]) - points[i, axis]) ** 2
            if away < best:
                best, found[i] = away, True
                for axis in range(3):
                    partner[i, axis] = start[s, axis] + share * (end[s, axis] - start[s, axis])
    return partner, found


def _slab_pieces(mesh: Mesh, lower: Floats, upper: Floats, bottom: Section, top: Section) -> Ints:
    """Number of the piece of the mesh's surface inside the slab that each facet belongs to: (m,) int64."""
    over = (mesh.vertices - lower[:3]) @ lower[3:]
    under = (upper[:3] - mesh.vertices) @ upper[3:]
    cut = [loop.facets for section in (bottom, top) for loop in section.loops]
    seeds = np.unique(np.concatenate(cut)) if cut else np.empty(0, dtype=np.int64)
    return np.asarray(_flood(mesh.facets, mesh.adjacency, over, under, seeds))


@njit(cache=True)
def _flood(facets: Ints, adjacency: Ints, over: Floats, under: Floats, seeds: Ints) -> Ints:  # pragma: no cover
    """Pieces by flooding from the facets that a section cuts, across edges with a stretch inside the slab."""
    label = np.full(facets.shape[0], -1, np.int64)
    stack = np.empty(facets.shape[0], np.int64)
    for seed in seeds:
        if label[seed] >= 0:
            continue
        label[seed], stack[0], top = seed, seed, 1
        while top > 0:
            top -= 1
            f = stack[top]
            for k in range(3):
                g = adjacency[f, k]
                if g < 0 or label[g] >= 0:
                    continue
                a, b = facets[f, k], facets[f, (k + 1) % 3]
                first, last = 0.0, 1.0
                for ends in ((over[a], over[b]), (under[a], under[b])):
                    if ends[0] <= 0.0 and ends[1] <= 0.0:
                        last = -1.0
                    elif ends[0] < 0.0:
                        first = max(first, ends[0] / (ends[0] - ends[1]))
                    elif ends[1] < 0.0:
                        last = min(last, ends[0] / (ends[0] - ends[1]))
                if last > first:
                    label[g] = label[f]
                    stack[top] = g
                    top += 1
    return label
