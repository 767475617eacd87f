"""Cutting a mesh with many planes of any orientation at once."""

from __future__ import annotations

from typing import Literal

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from planner.errors import InputError, MeshError
from planner.mesh.mesh import Mesh, mesh_of
from planner.slicing.crossing import cross_facets, drop_degenerate, link_loops, number_pairs, place_points
from planner.slicing.nesting import nest_loops, signed_areas
from planner.slicing.section import Loop, Section, checked_planes, plane_frame

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Side = Literal["above", "below"]

SNAP_FRACTION = 1e-9
"""A vertex this near to a plane, as a fraction of the mesh's extent, lies on it: far above the rounding of doubles
(so planes that were computed meet the vertices they mean), far below that of an STL's 32-bit coordinates (6e-8)."""

MAX_PAIRS = 4_000_000
"""Pairs of facet and plane that are worked on at once; about 200 bytes each, so 0.8 GB. More planes go in halves."""


def slice_mesh(mesh: Mesh | trimesh.Trimesh, planes: ArrayLike, side: Side = "above") -> list[Section]:
    """All contours of a closed mesh in all planes at once, one Section per plane, in the order of the planes.

    mesh   : Mesh, or `trimesh.Trimesh` in mm
    planes : (k, 6) float   a point (mm) and a unit normal each, any orientation
    side   : what a plane cuts that lies exactly on a vertex, an edge or a flat face: the material immediately "above"
             it (along the normal; a plane on a top face gives nothing, on a bottom face the whole face) or "below" it
             (the other way round). Elsewhere both give the same.

    Each vertex is above a plane or not (half-open), a facet with both kinds is entered over one edge and left over
    another, and the facet across that edge continues the contour: linking follows a permutation and compares no
    coordinates, so every loop of a closed mesh closes. Points come from the plane given, never from a shifted one.
    Raises MeshError where a plane crosses an open edge or the mesh is inside out; InputError for planes that are none.
    """
    body = mesh_of(mesh)
    values = checked_planes(planes)
    if side not in ("above", "below"):
        raise InputError(f"side is {side!r}", 'choose "above" or "below"')
    sections: list[Section | None] = [None] * len(values)
    if not len(body.facets):
        raise MeshError("the mesh holds no facets", "export the model again")
    normals, group = np.unique(values[:, 3:] + 0.0, axis=0, return_inverse=True)
    group = group.reshape(-1)
    for number in range(len(normals)):
        members = np.flatnonzero(group == number)
        for member, section in zip(members, _slice_parallel(body, values, members, side), strict=True):
            sections[int(member)] = section
    return [section for section in sections if section is not None]


def _heights(points: Floats, normal: Floats) -> Floats:
    """Height along the normal, summed in one fixed order so that equal coordinates give equal heights."""
    return np.asarray(points[:, 0] * normal[0] + points[:, 1] * normal[1] + points[:, 2] * normal[2])


def _slice_parallel(body: Mesh, values: Floats, members: Ints, side: Side) -> list[Section]:
    """Sections of the planes `members`, which share one normal."""
    normal = values[members[0], 3:]
    height = _heights(body.vertices, normal)
    level = _heights(values[members, :3], normal)
    order = np.argsort(level, kind="stable")
    level, members_sorted = level[order], members[order]
    snap_mm = SNAP_FRACTION * float(np.abs(body.bounds).max() + body.diagonal)
    least_above = level + snap_mm if side == "above" else np.nextafter(level - snap_mm, -np.inf)
    rank = np.searchsorted(least_above, height).astype(np.int64)
    lowest, offset = number_pairs(body.facets, rank)
    if offset[-1] > MAX_PAIRS and len(members) > 1:
        half = len(members) // 2
        parts = [_slice_parallel(body, values, part, side) for part in (members_sorted[:half], members_sorted[half:])]
        return _unsorted(order, [section for part in parts for section in part])
    facet, plane, tail, head, following = cross_facets(body.facets, body.adjacency, rank, lowest, offset)
    chain, start, open_pair = link_loops(following)
    if open_pair >= 0:
        _refuse_open(body, values, int(members_sorted[plane[open_pair]]), int(facet[open_pair]), following[open_pair])
    low, high = np.minimum(tail, head), np.maximum(tail, head)
    weight, points = place_points(body.vertices, height, level, snap_mm, plane, low, high)
    chain, start, _ = drop_degenerate(chain, start, points)
    found = _Loops(
        start, plane[chain[start[:-1]]], points[chain], facet[chain], np.column_stack([low, high])[chain], weight[chain]
    )
    sections = found.by_plane(values[members_sorted], snap_mm)
    return _unsorted(order, sections)


def _unsorted(order: Ints, sections: list[Section]) -> list[Section]:
    """Sections of sorted planes in the order in which the planes were given."""
    back = np.empty(len(order), dtype=np.int64)
    back[order] = np.arange(len(order))
    return [sections[i] for i in back]


class _Loops:
    """All loops of a group of parallel planes, as flat arrays."""

    def __init__(self, start: Ints, plane: Ints, points: Floats, facets: Ints, edges: Ints, weights: Floats) -> None:
        by_plane = np.argsort(plane, kind="stable")
        counts = np.diff(start)[by_plane]
        self.start = np.concatenate([[0], np.cumsum(counts)])
        gather = np.repeat(start[:-1][by_plane] - self.start[:-1], counts) + np.arange(self.start[-1])
        self.plane = plane[by_plane]
        self.points, self.facets, self.edges, self.weights = (
            points[gather],
            facets[gather],
            edges[gather],
            weights[gather],
        )

    def by_plane(self, planes: Floats, snap_mm: float) -> list[Section]:
        """One Section per plane of planes : (k, 6); loops without area (thinner than snap_mm) are left out."""
        frames = np.repeat(plane_frame(planes[0])[None], len(planes), axis=0)
        frames[:, 0] = planes[:, :3]
        point_plane = np.repeat(self.plane, np.diff(self.start))
        relative = self.points - frames[point_plane, 0]
        xy = np.ascontiguousarray(relative @ frames[0, 1:3].T)
        area, perimeter = signed_areas(xy, self.start)
        parent = nest_loops(xy, self.start, self.plane, area, snap_mm)
        solid = np.abs(area) > snap_mm * perimeter
        first = np.searchsorted(self.plane, np.arange(len(planes) + 1))
        sections = []
        for k, plane in enumerate(planes):
            numbers = np.arange(first[k], first[k + 1])[solid[first[k] : first[k + 1]]]
            place = {int(number): i for i, number in enumerate(numbers)}
            loops = [self._loop(int(n), xy, float(area[n]), place.get(int(parent[n]), -1)) for n in numbers]
            section = Section(plane.copy(), frames[k], loops)
            if section.area_mm2 < 0.0:
                _refuse_inverted(section)
            sections.append(section)
        return sections

    def _loop(self, number: int, xy: Floats, area: float, parent: int) -> Loop:
        part = slice(int(self.start[number]), int(self.start[number + 1]))
        return Loop(self.points[part], self.facets[part], self.edges[part], self.weights[part], xy[part], area, parent)


def _plane_text(plane: Floats) -> str:
    point = ", ".join(f"{value:.4g}" for value in plane[:3])
    normal = ", ".join(f"{value:.4g}" for value in plane[3:])
    return f"the plane through ({point}) mm with normal ({normal})"


def _refuse_open(body: Mesh, values: Floats, plane: int, facet: int, following: int) -> None:
    """Raise MeshError: the contour in this plane runs over the open edge -1 - following of this facet."""
    edge = -1 - int(following)
    ends = body.vertices[body.facets[facet, [edge, (edge + 1) % 3]]]
    place = ", ".join(f"{value:.4g}" for value in ends.mean(axis=0))
    raise MeshError(
        f"the mesh is not closed: {_plane_text(values[plane])} (number {plane}) crosses an open edge of facet {facet} "
        f"at ({place}) mm",
        "load the mesh with planner.mesh.load, which closes small holes, or repair it in the CAD system",
    )


def _refuse_inverted(section: Section) -> None:
    """Raise MeshError: the loops of this section enclose less than nothing."""
    place = ", ".join(f"{value:.4g}" for value in section.loops[0].points[0])
    raise MeshError(
        f"the mesh is inside out: {_plane_text(section.plane)} cuts {section.area_mm2:.4g} mm² near ({place}) mm",
        "load the mesh with planner.mesh.load, which turns inverted facets round",
    )
