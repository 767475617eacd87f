"""Cutting a mesh with many planes of any orientation at once."""

from __future__ import annotations

from typing import Literal

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from planner.errors import InputError, MeshError
from planner.mesh.findings import place_text
from planner.mesh.mesh import Mesh, mesh_of
from planner.slicing.cancel import cancel_empty_regions
from planner.slicing.crossing import number_pairs, rank_vertices, trace_loops
from planner.slicing.nesting import measure_loops, nest_loops
from planner.slicing.section import LoopStack, Section, checked_planes, plane_frame

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Side = Literal["above", "below"]

SNAP_FRACTION = 1e-9
"""A vertex this near to a plane, as a fraction of the mesh's diagonal, lies on it: far above the rounding of doubles
(so planes that were computed meet the vertices they mean), far below that of an STL's 32-bit coordinates (6e-8)."""
ROUNDING = 16 * float(np.finfo(np.float64).eps)
"""What is added to that, as a fraction of the largest coordinate: the rounding of a computed plane far from the origin
(4e-9 mm at 1,000 m)."""

MAX_PAIRS = 2**30
"""Pairs of facet and plane that are numbered at once, in 32 bits; more planes go in halves. A pair takes 38 bytes."""


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
    for members in _parallel_groups(values[:, 3:]):
        for member, section in zip(members, _slice_parallel(body, values, members, side), strict=True):
            sections[int(member)] = section
    return [section for section in sections if section is not None]


def _parallel_groups(normals: Floats) -> list[Ints]:
    """Numbers of the planes with equal normals, group by group.  normals : (k, 3) float."""
    if len(normals) and (normals == normals[0]).all():
        return [np.arange(len(normals))]
    _, group = np.unique(normals + 0.0, axis=0, return_inverse=True)
    order = np.argsort(group.reshape(-1), kind="stable")
    return np.split(order, np.flatnonzero(np.diff(group.reshape(-1)[order])) + 1) if len(order) else []


def _slice_parallel(body: Mesh, values: Floats, members: Ints, side: Side) -> list[Section]:
    """Sections of the planes `members`, which share one normal, in their order."""
    axes = plane_frame(values[members[0]])[1:]
    middle = body.bounds.mean(axis=0)
    away = values[members, :3] - middle
    level = away[:, 0] * axes[2, 0] + away[:, 1] * axes[2, 1] + away[:, 2] * axes[2, 2]  # in the order of the kernels
    reach_mm = np.maximum(np.abs(values[members, :3]).max(axis=1), np.abs(body.bounds).max())
    snap_mm = SNAP_FRACTION * body.diagonal + ROUNDING * reach_mm
    least_above = level + snap_mm if side == "above" else np.nextafter(level - snap_mm, -np.inf)
    order = np.argsort(least_above, kind="stable")
    level, snap_mm, least_above, members = level[order], snap_mm[order], least_above[order], members[order]
    rank = rank_vertices(body.vertices, middle, axes[2], least_above)
    base, count = number_pairs(body.facets, rank)
    if count > MAX_PAIRS and len(members) > 1:
        half = len(members) // 2
        parts = [_slice_parallel(body, values, part, side) for part in (members[:half], members[half:])]
        return _unsorted(order, [section for part in parts for section in part])
    points, weights, halves, start, plane, open_half, open_plane = trace_loops(
        body.vertices, body.facets, body.across, rank, base, count, middle, axes[2], level, snap_mm
    )
    if open_half >= 0:
        _refuse_open(body, values, int(members[open_plane]), open_half)
    area, solid, box = measure_loops(points, start, plane, axes[:2], middle, snap_mm)
    loops = np.flatnonzero(solid)
    loops = loops[np.argsort(plane[loops], kind="stable")]
    first = np.searchsorted(plane[loops], np.arange(len(members) + 1))
    parents = nest_loops(points, start, loops, first, area, box, axes[:2], middle, float(snap_mm.max()))
    is_kept = cancel_empty_regions(points, start, loops, first, area, box, parents, snap_mm)
    if not is_kept.all():
        loops, parents, first = _kept(is_kept, loops, parents, first)
    stack = LoopStack(body, points, weights, halves, start, area, loops, parents, first, axes)
    sections = [Section(values[member], stack, k) for k, member in enumerate(members.tolist())]
    _refuse_inverted(stack, sections, plane)
    return _unsorted(order, sections)


def _kept(
    is_kept: NDArray[np.bool_], loops: Ints, parents: NDArray[np.int32], first: Ints
) -> tuple[Ints, NDArray[np.int32], Ints]:
    """The loops that stay, with parents and planes' parts counted among them; loops, parents, first of `LoopStack`."""
    number = np.concatenate([[0], np.cumsum(is_kept)])
    base = np.repeat(first[:-1], np.diff(first))[is_kept]
    held = parents[is_kept]
    renumbered = np.where(held < 0, -1, number[base + np.maximum(held, 0)] - number[base])
    return loops[is_kept], renumbered.astype(np.int32), number[first]


def _unsorted(order: Ints, sections: list[Section]) -> list[Section]:
    """Sections of sorted planes in the order in which the planes were given."""
    back = np.empty(len(order), dtype=np.int64)
    back[order] = np.arange(len(order))
    return [sections[i] for i in back.tolist()]


def _plane_text(plane: Floats) -> str:
    point = ", ".join(f"{value:.4g}" for value in plane[:3])
    normal = ", ".join(f"{value:.4g}" for value in plane[3:])
    return f"the plane through ({point}) mm with normal ({normal})"


def _refuse_open(body: Mesh, values: Floats, plane: int, half: int) -> None:
    """Raise MeshError: the contour in this plane leads over this open half-edge, 3f + j."""
    facet, edge = divmod(half, 3)
    place = body.vertices[body.facets[facet, [edge, (edge + 1) % 3]]].mean(axis=0)
    raise MeshError(
        f"the mesh is not closed: {_plane_text(values[plane])} (number {plane}) crosses an open edge of facet {facet} "
        f"at {place_text(place)}",
        "load the mesh with planner.mesh.load, which closes small holes, or repair it in the CAD system",
    )


def _refuse_inverted(stack: LoopStack, sections: list[Section], plane: NDArray[np.int32]) -> None:
    """Raise MeshError where a plane's loops enclose less than nothing or a hole lies in no material."""
    area = stack.area[stack.loops]
    total = np.bincount(plane[stack.loops], weights=area, minlength=len(sections))
    loose = (area < 0.0) & (stack.parents < 0)
    if not loose.any() and total.min(initial=0.0) >= 0.0:
        return
    wrong = np.flatnonzero(loose | (total < 0.0)[plane[stack.loops]])[0]
    number = stack.loops[wrong]
    section = sections[plane[number]]
    raise MeshError(
        f"the mesh is inside out or passes through itself: {_plane_text(section.plane)} cuts {area[wrong]:.4g} mm² "
        f"that lie in no material near {place_text(stack.points[stack.start[number]])}",
        "load the mesh with planner.mesh.load, which turns inverted bodies round, or repair it in the CAD system",
    )
