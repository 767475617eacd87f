"""Cutting closed meshes along planes into closed bodies whose flat caps share the section's own vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.decompose.capping import Caps, caps_of
from planner.decompose.corners import edges_between, spans
from planner.errors import PlanningError
from planner.mesh.facets import pieces_of
from planner.mesh.findings import place_text
from planner.mesh.mesh import Mesh
from planner.mesh.winding import body_of_facet, containing_bodies

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

FLAT_FRACTION = 2e-6
"""Of the mesh's diagonal: vertices this near to the plane lie on it and are laid into it. Faces of an STL with 32-bit
coordinates are flat to 1e-6 of its size."""


@dataclass(frozen=True, eq=False)
class Body:
    """A closed mesh, mm, that came from another.

    source : (m,) int   facet of the mesh before, -1 for those of caps
    """

    mesh: Mesh
    source: Ints

    @classmethod
    def whole(cls, mesh: Mesh) -> Body:
        """A mesh as its own source."""
        return cls(mesh, np.arange(len(mesh.facets)))

    def after(self, earlier: Body) -> Body:
        """The same with its sources in the mesh that the earlier body came from."""
        return Body(self.mesh, np.where(self.source >= 0, earlier.source[np.maximum(self.source, 0)], -1))


class PlaneCut:
    """Where a plane cuts a closed mesh: the bodies beyond it, each of which can be taken off.

    plane : (6,) float   point (mm) and unit normal; beyond it is the normal's side   count : bodies beyond
    label : (m,) int   body beyond that each of the mesh's facets belongs to, or crosses into; -1: none
    mesh : what is cut: the mesh given, in which edges shorter than the plane is thick are points
    Vertices are above the plane, below it or on it; a facet with corners on both sides is cut at new vertices that it
    shares with its neighbours, so no vertex lies on another's edge. A facet that lies in the plane belongs to the side on
    which its metal is. What bounds the surface above the plane is closed by a cap on just those vertices.
    """

    def __init__(self, given: Mesh, plane: Floats) -> None:
        self.plane = np.asarray(plane, dtype=np.float64)
        mesh, self._source = _contracted(given, self.plane)
        self.mesh = mesh
        self._height = (mesh.vertices - self.plane[:3]) @ self.plane[3:]
        touch = FLAT_FRACTION * mesh.diagonal
        side = (self._height > touch).astype(np.int64) - (self._height < -touch)
        self._sides: Ints = side[mesh.facets]
        self._mate: Ints = mesh.across.reshape(-1, 3).astype(np.int64)
        low, high = spans(side, mesh.facets)
        self._crossed: Flags = (low < 0) & (high > 0)
        flat = (low == 0) & (high == 0)
        self._beyond: Flags = (high > 0) | (flat & (mesh.area_vectors @ self.plane[3:] < 0.0))
        self._exit, self._entry = self._crossings()
        surface = self._surfaces()
        self._caps = self._made_caps(surface)
        self._label, self.count = self._bodies(surface)
        self._cap_label = self._label[self._caps.facets]
        self.label: Ints = np.full(len(given.facets), -1)
        self.label[self._source] = self._label

    def cap_mm2(self, number: int) -> float:
        """Area of the cap of one body."""
        return float(self._caps.areas[self._cap_label == number].sum())

    def above(self, number: int) -> Body:
        """One body beyond the plane, closed by its cap."""
        mine = self._label == number
        whole = np.flatnonzero(mine & ~self._crossed)
        upper, rows = self._cut_facets(np.flatnonzero(mine & self._crossed), upper=True)
        cap = self._caps.triangles[self._cap_label == number][:, ::-1]
        return self._assembled([self.mesh.facets[whole], upper, cap], [whole, rows, np.full(len(cap), -1)])

    def below(self, taken: Flags) -> Body:
        """What stays when bodies beyond the plane are taken off.  taken : (count,) bool; closed, may be in several pieces."""
        gone = np.append(taken, False)[self._label]
        whole = np.flatnonzero(~gone)
        lower, rows = self._cut_facets(np.flatnonzero(gone & self._crossed), upper=False)
        cap = self._caps.triangles[taken[self._cap_label]]
        return self._assembled([self.mesh.facets[whole], lower, cap], [whole, rows, np.full(len(cap), -1)])

    def _crossings(self) -> tuple[Ints, Ints]:
        """Nodes at which each crossed facet, walked counter-clockwise, leaves the upper side and comes back: (m,) each, or -1.

        A node is a vertex of the mesh, or len(vertices) + the lower half-edge of a crossed edge.
        """
        leaves, returns = np.full(len(self._sides), -1), np.full(len(self._sides), -1)
        rows = np.flatnonzero(self._crossed)
        now, facets, mate = self._sides[rows], self.mesh.facets[rows], self._mate[rows]
        after, third, ahead = np.roll(now, -1, axis=1), np.roll(now, -2, axis=1), np.roll(facets, -1, axis=1)
        own = 3 * rows[:, None] + np.arange(3)
        edge = len(self.mesh.vertices) + np.minimum(own, np.where(mate >= 0, mate, own))
        out = np.where((now > 0) & (after < 0), edge, np.where((now > 0) & (after == 0) & (third < 0), ahead, -1))
        back = np.where((now < 0) & (after > 0), edge, np.where((now == 0) & (after > 0) & (third < 0), facets, -1))
        leaves[rows], returns[rows] = out.max(axis=1), back.max(axis=1)
        return leaves, returns

    def _surfaces(self) -> Ints:
        """(m,) int   Connected surface beyond the plane that each facet belongs to; -1 for the others."""
        surface, _ = pieces_of(_joins(self._mate, self._sides, self._beyond, self._crossed))
        return np.where(self._beyond, surface, -1)

    def _made_caps(self, surface: Ints) -> Caps:
        """The caps over what bounds the surfaces beyond.  Raises PlanningError, naming the place, if one does not close."""
        crossed = np.flatnonzero(self._crossed)
        row, slot = _rim(self._mate, self._sides, self._beyond, self._crossed)
        tails = np.concatenate([self._exit[crossed], self.mesh.facets[row, slot]])
        heads = np.concatenate([self._entry[crossed], self.mesh.facets[row, (slot + 1) % 3]])
        facets = np.concatenate([crossed, row])
        nodes = np.unique(np.concatenate([tails, heads]))
        return caps_of(nodes, self._placed(nodes), tails, heads, facets, self.plane)

    def _bodies(self, surface: Ints) -> tuple[Ints, int]:
        """Surfaces that a cap joins, and voids with what is around them, are one body: (m,) label and the count."""
        if not self._beyond.any():
            return surface, 0
        label, count = _numbered(surface)
        root = np.arange(count)
        for pair in np.unique(np.sort(label[self._caps.joined], axis=1), axis=0):
            first, second = root[pair[0]], root[pair[1]]
            root[root == max(first, second)] = min(first, second)
        if len(np.unique(root)) > 1:
            root = self._with_voids(label, root)
        kept, number = np.unique(root, return_inverse=True)
        return np.where(label >= 0, number.reshape(-1)[label], -1), len(kept)

    def _with_voids(self, label: Ints, root: Ints) -> Ints:
        """Roots of surfaces with those of voids, which no cap closes and which run inside out, set to what holds them."""
        capped = np.zeros(len(root), dtype=np.bool_)
        capped[np.unique(root[label[self._caps.facets]])] = True
        moments = np.einsum("ij,ij->i", self.mesh.centroids - self.mesh.bounds.mean(axis=0), self.mesh.area_vectors)
        volume = np.bincount(root[label[label >= 0]], weights=moments[label >= 0], minlength=len(root))
        voids = [n for n in np.unique(root).tolist() if not capped[n] and volume[n] < 0.0]
        if not voids:
            return root
        rooted = np.where(label >= 0, root[label], -1)
        surfaces = np.unique(root)
        around = containing_bodies(self.mesh, np.where(label >= 0, np.searchsorted(surfaces, rooted), -1), len(surfaces))
        for void in voids:
            holders = [int(surfaces[n]) for n in around[int(np.searchsorted(surfaces, void))] if int(surfaces[n]) not in voids]
            if holders:
                root[root == void] = min(holders)
        return root

    def _cut_facets(self, rows: Ints, *, upper: bool) -> tuple[Ints, Ints]:
        """Triangles of nodes on one side of the plane that crossed facets are cut into, (k, 3), and their facets, (k,)."""
        sides, wanted = self._sides[rows], 1 if upper else -1
        alone = (sides == wanted).sum(axis=1) == 1
        tip = np.where(alone, np.argmax(sides == wanted, axis=1), np.argmax(sides == -wanted, axis=1))
        corners = self.mesh.facets[rows[:, None], (tip[:, None] + np.arange(3)) % 3]
        leave, back = (self._exit[rows], self._entry[rows]) if upper else (self._entry[rows], self._exit[rows])
        one = np.column_stack([corners[:, 0], leave, back])[alone]
        two = np.column_stack([back, corners[:, 1], corners[:, 2]])[~alone]
        three = np.column_stack([back, corners[:, 2], leave])[~alone]
        triangles = np.concatenate([one, two, three])
        source = np.concatenate([rows[alone], rows[~alone], rows[~alone]])
        kept = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
        return triangles[kept], source[kept]

    def _placed(self, nodes: Ints) -> Floats:
        """(n, 3) float, mm   Where nodes are; those on the plane lie exactly in it."""
        mesh, count = self.mesh, len(self.mesh.vertices)
        half = np.maximum(nodes - count, 0)
        start, end = mesh.facets[half // 3, half % 3], mesh.facets[half // 3, (half % 3 + 1) % 3]
        rise = self._height[start] - self._height[end]
        part = self._height[start] / np.where(rise == 0.0, 1.0, rise)
        between = mesh.vertices[start] + part[:, None] * (mesh.vertices[end] - mesh.vertices[start])
        vertex = np.minimum(nodes, count - 1)
        points = np.where((nodes < count)[:, None], mesh.vertices[vertex], between)
        touch = FLAT_FRACTION * mesh.diagonal
        lies = (nodes >= count) | (np.abs(self._height[vertex]) <= touch)
        off = (points - self.plane[:3]) @ self.plane[3:]
        return np.asarray(points - np.where(lies, off, 0.0)[:, None] * self.plane[3:])

    def _assembled(self, triangles: list[Ints], sources: list[Ints]) -> Body:
        corners = np.concatenate(triangles)
        used = np.zeros(len(self.mesh.vertices) + 3 * len(self.mesh.facets), dtype=np.bool_)
        used[corners.ravel()] = True
        nodes = np.flatnonzero(used)
        mesh = Mesh(self._placed(nodes), (np.cumsum(used) - 1)[corners])
        rows = np.concatenate(sources).astype(np.int64)
        source = np.where(rows >= 0, self._source[np.maximum(rows, 0)], -1)
        return _without_sheets(Body(mesh, source), FLAT_FRACTION * self.mesh.diagonal)


def split(mesh: Mesh, plane: Floats) -> tuple[list[Mesh], list[Mesh]]:
    """The closed connected bodies of a mesh below and above a plane, capped flat.

    mesh : closed   plane : (6,) float   point (mm) and unit normal
    Caps stand on the section's own vertices, the same below and above; bodies are in the order of their centroids.
    Raises PlanningError, naming the place, if a cap cannot be closed or a body would not be closed.
    """
    cut = PlaneCut(mesh, plane)
    above = [cut.above(number).mesh for number in range(cut.count)]
    rest = cut.below(np.ones(cut.count, dtype=np.bool_))
    below = [body.mesh for body in separate(rest)] if len(rest.mesh.facets) else []
    for body in (*above, *below):
        require_closed(body, plane)
    return _ordered(below), _ordered(above)


def separate(body: Body) -> list[Body]:
    """The connected solid bodies of a closed mesh, each with its voids, in the order of their first facets."""
    number = body_of_facet(body.mesh)
    count = int(number.max()) + 1
    if count == 1:
        return [body]
    moments = np.einsum("ij,ij->i", body.mesh.centroids - body.mesh.bounds.mean(axis=0), body.mesh.area_vectors)
    volume = np.bincount(number, weights=moments, minlength=count)
    home = np.arange(count)
    if (volume < 0.0).any():
        around = containing_bodies(body.mesh, number, count)
        for void in np.flatnonzero(volume < 0.0).tolist():
            holders = [outer for outer in around[void] if volume[outer] > 0.0]
            home[void] = min(holders, key=lambda outer: float(volume[outer])) if holders else void
    return [_taken(body, home[number] == solid) for solid in np.unique(home).tolist()]


def require_closed(mesh: Mesh, plane: Floats) -> None:
    """Raise PlanningError, naming the place, unless every edge of a cut body has a facet on both sides."""
    if mesh.is_closed:
        return
    open_facets = np.flatnonzero((mesh.adjacency < 0).any(axis=1))
    place = place_text(mesh.centroids[open_facets[0]] if len(open_facets) else plane[:3])
    raise PlanningError(f"the cut at {place} leaves an open body", "move the cutting plane a little")


def _contracted(mesh: Mesh, plane: Floats) -> tuple[Mesh, Ints]:
    """The mesh with edges that lie in the plane and are no longer than it is thick made points, and the facets that stay."""
    touch = FLAT_FRACTION * mesh.diagonal
    lies = np.abs((mesh.vertices - plane[:3]) @ plane[3:]) <= touch
    row, slot = edges_between(mesh.facets, lies)
    start, end = mesh.facets[row, slot], mesh.facets[row, (slot + 1) % 3]
    short = np.linalg.norm(mesh.vertices[start] - mesh.vertices[end], axis=1) <= 2.0 * touch
    every = np.arange(len(mesh.facets))
    if not short.any():
        return mesh, every
    goal = np.arange(len(mesh.vertices))
    for _ in range(int(short.sum())):
        before = goal.copy()
        np.minimum.at(goal, start[short], goal[end[short]])
        np.minimum.at(goal, end[short], goal[start[short]])
        if np.array_equal(before, goal):
            break
    facets = goal[mesh.facets]
    kept = (facets != np.roll(facets, 1, axis=1)).all(axis=1)
    return Mesh(mesh.vertices, facets[kept]), every[kept]


def _without_sheets(body: Body, thickness_mm: float) -> Body:
    """A body without closed surfaces that are thinner than the cutting plane."""
    if not len(body.mesh.facets):
        return body
    number = body_of_facet(body.mesh)
    count = int(number.max()) + 1
    if count == 1:
        return body
    moments = np.einsum("ij,ij->i", body.mesh.centroids - body.mesh.bounds.mean(axis=0), body.mesh.area_vectors) / 3.0
    volume = np.abs(np.bincount(number, weights=moments, minlength=count))
    area = np.bincount(number, weights=body.mesh.areas, minlength=count)
    solid = volume > thickness_mm * area
    return body if solid.all() else _taken(body, solid[number])


def _numbered(surface: Ints) -> tuple[Ints, int]:
    """(m,) int   Surfaces numbered through from 0 in the order of their numbers, -1 as it is; and how many there are."""
    there = np.zeros(int(surface.max()) + 2, dtype=np.bool_)
    there[surface] = True
    there[-1] = False
    number = np.where(there, np.cumsum(there) - 1, -1)
    return number[surface], int(there.sum())


@njit(cache=True)
def _joins(mate: Ints, sides: Ints, beyond: Flags, crossed: Flags) -> NDArray[np.int32]:  # pragma: no cover
    """(3m,) int32   Half-edge across each one at which the surface beyond the plane goes on; -1 where it does not."""
    made = np.full(3 * len(beyond), -1, np.int32)
    for f in range(len(beyond)):
        if not beyond[f]:
            continue
        for k in range(3):
            other = mate[f, k]
            if other < 0 or not beyond[other // 3]:
                continue
            if crossed[f] and sides[f, k] <= 0 and sides[f, (k + 1) % 3] <= 0:
                continue
            made[3 * f + k] = other
    return made


@njit(cache=True)
def _rim(mate: Ints, sides: Ints, beyond: Flags, crossed: Flags) -> tuple[Ints, Ints]:  # pragma: no cover
    """Facet and slot of the edges in the plane at which whole facets beyond it end: (k,) each."""
    rows, slots = [0 for _ in range(0)], [0 for _ in range(0)]
    for f in range(len(beyond)):
        if not beyond[f] or crossed[f]:
            continue
        for k in range(3):
            if sides[f, k] == 0 and sides[f, (k + 1) % 3] == 0 and (mate[f, k] < 0 or not beyond[mate[f, k] // 3]):
                rows.append(f)
                slots.append(k)
    return np.array(rows, dtype=np.int64), np.array(slots, dtype=np.int64)


def _taken(body: Body, keep: Flags) -> Body:
    used, renumbered = np.unique(body.mesh.facets[keep], return_inverse=True)
    return Body(Mesh(body.mesh.vertices[used], renumbered.reshape(-1, 3)), body.source[keep])


def _ordered(bodies: list[Mesh]) -> list[Mesh]:
    """Bodies by the middles of their boxes, x first, then y, then z, to a micrometre."""
    return sorted(bodies, key=lambda mesh: tuple(np.round(mesh.bounds.mean(axis=0), 3).tolist()))
