"""Sacrificial metal under what hangs in every way that the head can be tilted: as little as stands and can be milled away (paper I)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import manifold3d  # type: ignore[import-not-found,unused-ignore]
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.decompose.overhang import LEVEL_DEG
from planner.decompose.solids import mesh_of_solid, polygons, prism, section, solid_of, under
from planner.mesh.facets import pieces_of
from planner.mesh.findings import place_text
from planner.mesh.mesh import Mesh
from planner.nurbs.offset import inset, outset
from planner.process import Settings

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

NECK_BEADS = 2.0  # a support is nowhere narrower than this many beads, unless what it carries is: it must stand
_ON_BASE_MM = 0.05  # what lies this near to the base plane lies on it
_INSIDE_MM = 1e-3  # above a level: where the part is cut to see what is there
_CRUMB_MM2 = 0.05  # smaller areas need no carrying
_CORNER = 1.5  # of a level's step: round the corner of a region a support may be so much farther away
_MITRE = 1.5  # corners stay corners as far as this: rounded ones would have to go on as posts
_INTO_MM = 0.05  # how far prisms reach into what stands, which is then taken out of them exactly
_CHORD_MM = 0.03  # of outlines that are drawn in: far finer than a bead
_GRID_MM = 1e-3  # regions of neighbouring levels are overlaid on this grid


@dataclass(frozen=True, eq=False)
class Hanging:
    """One connected underside that nothing carries.

    facets : (k,) int of the mesh   area_mm2 : seen from below   place : (3,) float, mm, its middle
    reach_mm : greatest distance from what carries its rim; its extent where nothing does
    is_afloat : nothing carries its rim   is_point : a lowest point, its facets those around it
    """

    facets: Ints
    area_mm2: float
    place: Floats
    reach_mm: float
    is_afloat: bool
    is_point: bool = False


@dataclass(frozen=True, eq=False)
class Support:
    """Sacrificial metal for a piece, piece frame.

    mesh : closed, mm, touching the piece and not in it   findings : one line for each underside that it carries
    """

    mesh: Mesh
    hanging: tuple[Hanging, ...]
    findings: tuple[str, ...]

    @property
    def volume_mm3(self) -> float:
        """Of the metal that is built and milled away."""
        return self.mesh.volume


def support_for(mesh: Mesh, limit_deg: float, settings: Settings, obstacles: Mesh | None = None) -> Mesh | None:
    """The mesh of `supports`; None where nothing hangs."""
    found = supports(mesh, limit_deg, settings, obstacles)
    return None if found is None else found.mesh


def supports(mesh: Mesh, limit_deg: float, settings: Settings, obstacles: Mesh | None = None) -> Support | None:
    """What carries everything that hangs beyond the limit, down to the piece itself, to what stands, or to the base plane.

    mesh : closed, mm, piece frame (z up, base plane z = 0)   limit_deg : lean of a wall that holds, tilted head included
    obstacles : closed mesh of what stands already, mm, same frame.
    Under each underside the metal goes down, drawn in from level to level by what the material holds without a tilted
    head: to a neck of two beads, or towards the wall beside it like a bracket, whichever is less.
    Undersides that one bead bridges need none; gaps inside a wider one would have to be narrower than
    `max_unsupported_mm`, less than a bead, so none are left.
    Raises PlanningError if the mesh encloses no volume. The same mesh gives the same support.
    """
    hanging = hanging_regions(mesh, limit_deg, settings)
    if not hanging:
        return None
    part = solid_of(mesh)
    standing = part if obstacles is None else part + solid_of(obstacles)
    columns = [under(mesh, region.facets, -1.0) for region in hanging]
    step = settings.layer_max_mm
    below = manifold3d.Manifold.batch_boolean(columns, manifold3d.OpType.Add)
    loads = _loads(mesh, hanging, settings)
    found = [
        made
        for leans in (False, True)
        for made in [_body(_slabs(loads, standing, settings, leans=leans), below, standing, step)]
        if made is not None
    ]
    if not found:
        return None
    least = min(found, key=lambda body: round(float(body.volume()), 6))
    return Support(mesh_of_solid(least), tuple(hanging), tuple(_line(region, limit_deg) for region in hanging))


def _body(
    slabs: list[manifold3d.Manifold], below: manifold3d.Manifold, standing: manifold3d.Manifold, step_mm: float
) -> manifold3d.Manifold | None:
    """The slabs as far as they lie under what is carried and outside what stands, without crumbs; None if that is nothing."""
    if not slabs or below.is_empty():
        return None
    body = (manifold3d.Manifold.batch_boolean(slabs, manifold3d.OpType.Add) ^ below) - standing
    kept = [piece for piece in body.decompose() if piece.volume() > _CRUMB_MM2 * step_mm]
    return manifold3d.Manifold.batch_boolean(kept, manifold3d.OpType.Add) if kept else None


def hanging_regions(mesh: Mesh, limit_deg: float, settings: Settings) -> list[Hanging]:
    """The connected undersides above the base plane that lean beyond the limit and are wider than a bead bridges.

    Lowest first, then by place.
    """
    steep = mesh.normals[:, 2] < -np.sin(np.radians(min(limit_deg, LEVEL_DEG))) - 1e-9
    steep &= mesh.vertices[mesh.facets, 2].max(axis=1) > _ON_BASE_MM
    points = _lowest_points(mesh, steep)
    if not steep.any():
        return points
    beside = steep[np.maximum(mesh.across, 0) // 3] & (mesh.across >= 0) & np.repeat(steep, 3)
    piece, _ = pieces_of(np.ascontiguousarray(np.where(beside, mesh.across, -1), dtype=np.int32))
    bridged = max(settings.material.deposition.max_unsupported_mm, _bead_mm(settings))
    found = [
        _hanging(mesh, np.flatnonzero(steep & (piece == number)), steep) for number in np.unique(piece[steep]).tolist()
    ]
    wide = [
        region for region in found if region.is_afloat or (region.reach_mm > bridged and region.area_mm2 > _CRUMB_MM2)
    ]
    return sorted([*wide, *points], key=lambda region: tuple(np.round(region.place[[2, 0, 1]], 3).tolist()))


def _lowest_points(mesh: Mesh, steep: Flags) -> list[Hanging]:
    """Vertices above the base plane that are lower than all around them and belong to no underside."""
    around = mesh.facets[:, [0, 1, 2, 0, 1, 2]].ravel(), mesh.facets[:, [1, 2, 0, 2, 0, 1]].ravel()
    heights = mesh.vertices[:, 2]
    lowest = np.full(len(heights), np.inf)
    np.minimum.at(lowest, around[0], heights[around[1]])
    alone = (heights < lowest - 1e-9) & (heights > _ON_BASE_MM) & np.isfinite(lowest)
    alone[np.unique(mesh.facets[steep])] = False
    found = []
    for vertex in np.flatnonzero(alone).tolist():
        facets = np.flatnonzero((mesh.facets == vertex).any(axis=1))
        down = mesh.normals[facets, 2]
        if (down < 0.0).all():  # the foot of a body, not the floor of a hollow
            found.append(Hanging(facets, 0.0, mesh.vertices[vertex], 0.0, True, True))
    return found


def _hanging(mesh: Mesh, facets: Ints, steep: Flags) -> Hanging:
    """One underside: where its rim meets a wall that comes up from below, that wall carries it."""
    weight = -mesh.area_vectors[facets, 2]
    place = (mesh.centroids[facets] * weight[:, None]).sum(axis=0) / weight.sum()
    row, slot = np.nonzero(mesh.adjacency[facets] >= 0)
    other = mesh.adjacency[facets[row], slot]
    rim = ~steep[other]
    row, slot, other = facets[row[rim]], slot[rim], other[rim]
    ends = np.stack([mesh.vertices[mesh.facets[row, slot]], mesh.vertices[mesh.facets[row, (slot + 1) % 3]]], axis=1)
    carries = mesh.centroids[other, 2] < ends[:, :, 2].mean(axis=1) - 1e-9
    outline = mesh.vertices[np.unique(mesh.facets[facets]), :2]
    if not carries.any():
        return Hanging(facets, float(weight.sum()), place, float(np.linalg.norm(np.ptp(outline, axis=0))), True)
    carrier = shapely.multilinestrings(shapely.linestrings(ends[carries][:, :, :2]))
    points = np.vstack([outline, mesh.centroids[facets, :2], _spread(mesh, facets)])
    return Hanging(
        facets, float(weight.sum()), place, float(shapely.distance(shapely.points(points), carrier).max()), False
    )


def _spread(mesh: Mesh, facets: Ints) -> Floats:
    """(n, 2) float, mm   The middles of facets' sides: large facets have their farthest points between corners."""
    corners = mesh.vertices[mesh.facets[facets]][:, :, :2]
    return np.asarray(0.5 * (corners + np.roll(corners, -1, axis=1))).reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class _Loads:
    """What is to be carried: outlines seen from below, and between which heights each lies, mm."""

    shadows: NDArray[np.object_]
    low: Floats
    high: Floats


def _loads(mesh: Mesh, hanging: Sequence[Hanging], settings: Settings) -> _Loads:
    rows = np.concatenate([region.facets for region in hanging if not region.is_point] or [np.zeros(0, dtype=np.int64)])
    corners = mesh.vertices[mesh.facets[rows]]
    points = np.array([region.place for region in hanging if region.is_point]).reshape(-1, 3)
    feet = shapely.buffer(shapely.points(points[:, :2]), 0.5 * NECK_BEADS * _bead_mm(settings), quad_segs=8)
    return _Loads(
        np.concatenate([shapely.polygons(corners[:, ::-1, :2]), feet]),
        np.concatenate([corners[:, :, 2].min(axis=1), points[:, 2]]),
        np.concatenate([corners[:, :, 2].max(axis=1), points[:, 2] + settings.layer_max_mm]),
    )


def _slabs(
    loads: _Loads, standing: manifold3d.Manifold, settings: Settings, *, leans: bool
) -> list[manifold3d.Manifold]:
    """The prisms of each level from the top down, one level for each greatest layer.

    leans : on the walls beside it; else it stands by itself, away from them.
    """
    step = settings.layer_max_mm
    levels = np.arange(int(np.ceil(loads.high.max() / step - 1e-9)) + 1) * step
    out = step * np.tan(np.radians(settings.material.deposition.max_overhang_deg))
    neck = NECK_BEADS * _bead_mm(settings)
    need = MultiPolygon()
    slabs: list[tuple[MultiPolygon, float, float]] = []
    for bottom, top in reversed(list(pairwise(levels.tolist()))):
        due = (loads.high > bottom + _INSIDE_MM) & (loads.low <= top + _INSIDE_MM)
        if need.is_empty and not due.any():
            continue
        there = section(standing, bottom + _INSIDE_MM)
        need = drawn_in(need, out, neck, _near(there, need, neck) if leans else MultiPolygon())
        if due.any():
            fresh = outset(polygons(shapely.union_all(loads.shadows[due], grid_size=_GRID_MM)), _INTO_MM, _CHORD_MM)
            need = polygons(shapely.union(need, fresh, grid_size=_GRID_MM))
        need = _beside(need, there)
        if need.is_empty:
            continue
        if slabs and slabs[-1][0].equals(need):
            slabs[-1] = (need, bottom, slabs[-1][2])
        else:
            slabs.append((need, bottom, top))
    return [prism(region, bottom, top) for region, bottom, top in slabs]


def _beside(need: MultiPolygon, there: MultiPolygon) -> MultiPolygon:
    """What is to be carried outside what stands, and a little into it, without slivers, mm."""
    if need.is_empty or not shapely.intersects(need, there):
        return need
    outside = polygons(shapely.difference(need, inset(there, _INTO_MM, _CHORD_MM), grid_size=_GRID_MM))
    wide = inset(outside, 0.6 * _INTO_MM, _CHORD_MM)
    kept = polygons(outset(wide, 0.6 * _INTO_MM, _CHORD_MM).simplify(0.2 * _INTO_MM))
    return MultiPolygon([piece for piece in kept.geoms if shapely.difference(piece, there).area > _CRUMB_MM2])


def _near(there: MultiPolygon, need: MultiPolygon, within_mm: float) -> MultiPolygon:
    """What stands within a distance of what is to be carried, mm."""
    return (
        polygons(shapely.intersection(there, outset(need, within_mm, _CHORD_MM), grid_size=_GRID_MM))
        if not need.is_empty
        else need
    )


def drawn_in(region: MultiPolygon, out_mm: float, neck_mm: float, beside: MultiPolygon) -> MultiPolygon:
    """The least region that carries another one a level higher, mm.

    out_mm : how far a level may reach beyond the one below   neck_mm : least width
    beside : what it leans on, with which it counts as one.
    Where the region is too narrow to be drawn in it goes on as it is.
    """
    if region.is_empty:
        return region
    whole = region if beside.is_empty else polygons(shapely.union(region, beside, grid_size=_GRID_MM))
    core = inset(inset(whole, out_mm, _CHORD_MM), 0.5 * neck_mm, _CHORD_MM)
    if core.is_empty:
        return region
    core = polygons(shapely.buffer(core, 0.5 * neck_mm, join_style="mitre", mitre_limit=_MITRE))
    held = outset(core, _CORNER * out_mm, _CHORD_MM)
    lost = polygons(shapely.difference(region, held, grid_size=_GRID_MM))
    arms = [piece for piece in lost.geoms if piece.area > _CRUMB_MM2]
    drawn = shapely.union_all([core.simplify(_CHORD_MM), *arms], grid_size=_GRID_MM)
    return polygons(shapely.intersection(drawn, region, grid_size=_GRID_MM))


def _bead_mm(settings: Settings) -> float:
    """Width of the usual bead."""
    return settings.bead_for(min(settings.layer_max_mm, settings.material.deposition.layer_height_mm.usual)).width_mm


def _line(region: Hanging, limit_deg: float) -> str:
    if region.is_point:
        return f"point at {place_text(region.place)} begins in the air: built on sacrificial metal"
    why = "begins in the air" if region.is_afloat else f"reaches {region.reach_mm:.1f} mm beyond what carries it"
    return (
        f"underside at {place_text(region.place)}: {region.area_mm2:.0f} mm² look down beyond {min(limit_deg, LEVEL_DEG):.0f}° "
        f"and it {why}: built on sacrificial metal"
    )


def support_findings(found: Sequence[Support | None]) -> list[str]:
    """The lines of several supports, and their sum in mm³; none where nothing is supported."""
    there = [support for support in found if support is not None]
    if not there:
        return []
    total = sum(support.volume_mm3 for support in there)
    return [
        *(line for support in there for line in support.findings),
        f"{total:.0f} mm³ of support are built and milled away",
    ]
