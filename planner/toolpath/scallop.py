"""Where a ball touches a wall: rows of contact points level by level, as far apart as the scallops between them may be high."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.collide.gouge import Target
from planner.decompose.solids import mesh_of_solid, solid_of
from planner.mesh.curvature import normal_curvatures
from planner.mesh.mesh import Mesh
from planner.mesh.smooth import SmoothSurface, smooth_surface
from planner.slicing.section import Loop
from planner.slicing.slicer import slice_mesh

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_LEAST_STEP_MM = 0.02  # between levels: on a dome's top this is a row every 0.6 mm at 2 degrees
_FLAT = 0.9995  # of a normal's z: flatter facets are tops, which are faced
_LEAST_BEND = 0.5  # of 1 + curvature x radius: a hollow as narrow as twice the ball is not stepped through any faster
_UPRIGHT = 0.005  # of a normal's z: loops that lean less are the flank's
_OVER_MM = 1e-4  # above the band's top: what lies in that plane stands
_IN_MM = 1e-3  # below the band's top: the highest level, so that it cuts the wall
_STEP_MM = 1.0  # between contact points along straight walls
_NEAR_MM = 0.15  # contact points nearer than this are one
_TURN = np.cos(np.radians(2.0))  # normals that turn more at one place are a crease's
_FAN_RAD = np.radians(8.0)  # between poses in which the ball rolls round an edge


def scallop_step(radius_mm: float, scallop_mm: float, curvature: Floats | float = 0.0) -> Floats:
    """Distance along a surface between passes of a ball that leave scallops of a height, mm.

    curvature : 1/mm, of the surface across the passes, convex > 0.  h = r - sqrt(r^2 - (s/2)^2) on a plane; over a curve of
    radius R the same scallop stands between points R / (R + r) as far apart, squared (for h much smaller than r and R).
    Source: Vickers and Quan, "Ball-mills versus end-mills for curved surface machining", J. Eng. Ind. 111, 1989.
    """
    bend = np.maximum(1.0 + np.asarray(curvature) * radius_mm, _LEAST_BEND)
    return np.asarray(np.sqrt(4.0 * scallop_mm * (2.0 * radius_mm - scallop_mm) / bend))


@dataclass(frozen=True, eq=False)
class Row:
    """Contact points of one closed row, the part on its left.

    z : level, mm   points : (n, 3) float, mm   normals : (n, 3) float, unit, outward, an edge's point once for each normal
    least_up, most_up : z of the normals
    """

    z: float
    points: Floats
    normals: Floats


@dataclass(frozen=True, eq=False)
class Surface:
    """The walls of a band for a ball, in the band's frame.

    rows : from the top   body : the piece as far as it stands when they are milled   spare_mm : (m,) float, of its facets: as
        deep as it likes the ball goes into the cut face, where the next layer's metal comes   standing : body, and what else stands
    """

    rows: tuple[Row, ...]
    body: Mesh
    spare_mm: Floats
    standing: Target

    def beside(self, others: Sequence[Mesh]) -> Surface:
        """The same with other bodies that stand, mm, in the band's frame."""
        bodies = [self.body, *others]
        first = np.cumsum([0, *(len(mesh.vertices) for mesh in bodies[:-1])]).tolist()
        facets = np.vstack([mesh.facets + at for mesh, at in zip(bodies, first, strict=True)])
        spare = np.concatenate([self.spare_mm, np.zeros(len(facets) - len(self.spare_mm))])
        return replace(self, standing=Target.of(Mesh(np.vstack([mesh.vertices for mesh in bodies]), facets), spare))


def ball_surface(
    mesh: Mesh, frame_from_mesh: Floats, heights: tuple[float, float], radius_mm: float, scallop_mm: float, crease_deg: float
) -> Surface:
    """The rows on a mesh between two heights of a frame.

    mesh : of the whole piece, mm   frame_from_mesh : (4, 4) float, rigid   heights : lowest and highest level, mm, frame
    """
    low, top = heights
    smooth = smooth_surface(mesh, crease_deg)
    turn, shift = frame_from_mesh[:3, :3], frame_from_mesh[:3, 3]
    levels = _levels(smooth, turn, shift, low, top, radius_mm, scallop_mm)
    up = turn[2]
    planes = np.column_stack([np.outer(levels - shift[2], up), np.tile(up, (len(levels), 1))])
    rows: list[Row] = []
    for z, section in zip(levels.tolist(), slice_mesh(mesh, planes), strict=True):
        for loop in section.loops:
            points, normals = _contacts(loop, smooth)
            normals = normals @ turn.T
            if np.abs(normals[:, 2]).max() > _UPRIGHT:
                rows.append(Row(z, *_spread(points @ turn.T + shift, normals)))
    body, spare = _standing(mesh, up, top - shift[2] + _OVER_MM, frame_from_mesh)
    return Surface(tuple(rows[::-1]), body, spare, Target.of(body, spare))


def _standing(mesh: Mesh, up: Floats, at: float, frame_from_mesh: Floats) -> tuple[Mesh, Floats]:
    """What of a mesh lies under a height, in the frame, and how deep the ball may go into its facets, mm."""
    body = mesh_of_solid(solid_of(mesh).trim_by_plane(tuple(-up), -at))
    is_cut = np.abs(body.corners @ up - at).max(axis=1) < 0.5 * _OVER_MM
    return body.transformed(frame_from_mesh), np.where(is_cut, np.inf, 0.0)


def _levels(
    smooth: SmoothSurface, turn: Floats, shift: Floats, low: float, top: float, radius_mm: float, scallop_mm: float
) -> Floats:
    """(k,) float, mm   Heights of rows from low to top, no farther apart on any facet than the scallop allows."""
    mesh = smooth.mesh
    z = mesh.corners @ turn[2] + shift[2]
    normal_z = mesh.normals @ turn[2]
    used = (np.abs(normal_z) < _FLAT) & (z.max(axis=1) > low) & (z.min(axis=1) < top)
    z, normal_z = z[used], normal_z[used]
    steep = np.sqrt(1.0 - normal_z**2)
    across = (turn[2] - normal_z[:, None] * mesh.normals[used]) / steep[:, None]
    bend = normal_curvatures(smooth.curvatures[used], across)
    step = scallop_step(radius_mm, scallop_mm, bend) * steep
    bottom, high = z.min(axis=1), z.max(axis=1)
    levels = [low]
    while levels[-1] < top - _IN_MM:
        here = levels[-1]
        rise = _least(step, bottom, high, here, here)
        rise = min(rise, _least(step, bottom, high, here, here + rise))
        levels.append(min(here + max(rise, _LEAST_STEP_MM), top - _IN_MM))
    return np.array(levels)


def _least(step: Floats, bottom: Floats, high: Floats, from_z: float, to_z: float) -> float:
    """Least step of the facets between two heights, mm; a large one where there are none."""
    return float(step[(high >= from_z) & (bottom <= to_z)].min(initial=1e3))


def _contacts(loop: Loop, smooth: SmoothSurface) -> tuple[Floats, Floats]:
    """Points of a loop and the smooth surface's normals there; a crease's points once for each side, (n, 3) each."""
    leaving = loop.facets
    arriving = np.roll(leaving, 1)
    before, after = (_normal_at(smooth, facet, loop) for facet in (arriving, leaving))
    is_crease = (before * after).sum(axis=1) < _TURN
    order = np.sort(np.concatenate([np.arange(len(leaving)), np.flatnonzero(is_crease)]))
    second = np.concatenate([[False], order[1:] == order[:-1]])
    first_of_two = np.concatenate([second[1:], [False]])
    normals = np.where(first_of_two[:, None], before[order], after[order])
    return loop.points[order], normals


def _normal_at(smooth: SmoothSurface, facet: NDArray[np.int64], loop: Loop) -> Floats:
    """(n, 3) float   Unit normals at the loop's points, as the given facets have them along the edge."""
    corners = smooth.mesh.facets[facet]
    rows = np.arange(len(facet))
    found = np.zeros((len(facet), 3))
    for k, share in ((0, 1.0 - loop.weights), (1, loop.weights)):
        place = np.argmax(corners == loop.edges[:, k : k + 1], axis=1)
        found += share[:, None] * smooth.normals[facet, place][rows]
    return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])


def _spread(points: Floats, normals: Floats) -> tuple[Floats, Floats]:
    """Contact points neither too near nor too far from each other, and normals that turn in small steps round outside edges."""
    ahead = np.roll(points, -1, axis=0) - points
    away = np.linalg.norm(ahead, axis=1)
    turn = np.arccos(np.clip((normals * np.roll(normals, -1, axis=0)).sum(axis=1), -1.0, 1.0))
    keep = (away > _NEAR_MM) | (turn > _FAN_RAD)
    points, normals = points[keep], normals[keep]
    after = np.roll(normals, -1, axis=0)
    ahead = np.roll(points, -1, axis=0) - points
    turn = np.arccos(np.clip((normals * after).sum(axis=1), -1.0, 1.0))
    opens = ((after - normals) * ahead).sum(axis=1) >= -1e-9
    fan = np.where(opens, np.ceil(turn / _FAN_RAD), 1.0)
    parts = np.maximum(np.maximum(np.ceil(np.linalg.norm(ahead, axis=1) / _STEP_MM), fan), 1.0).astype(np.int64)
    own = np.repeat(np.arange(len(parts)), parts)
    share = ((np.arange(len(own)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[own])[:, None]
    spread = (1.0 - share) * normals[own] + share * after[own]
    return points[own] + share * ahead[own], spread / np.linalg.norm(spread, axis=1)[:, None]
