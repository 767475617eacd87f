"""Round holes whose roof hangs: they are built full, as their own support, and bored from the side afterwards (paper I)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from planner.mesh.crease import crease_edges
from planner.mesh.facets import pieces_of
from planner.mesh.holes import rim_loops
from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_ROUND_MM = 0.02  # how far the vertices of a bore may stand from its cylinder: a fifth of the usual tolerance
_FEWEST = 6  # facets of a wall that goes round
_FLAT_MM = 1e-3  # how far the ends of a bore may stand from a plane across it
_ALONG = np.sin(np.radians(1.0))  # normals of a bore's wall lean at most this much along its axis
_LEVEL = -1e-3  # least z of a bore's axis out of its mouth: from below no cutter comes


@dataclass(frozen=True)
class Bore:
    """A round hole with flat ends.

    mouth : (3,) float, mm, centre of its open end   axis : (3,) float, unit, out of the mouth
    facets : (k,) int, its wall and its bottom in the mesh   is_through : whether its other end is open too
    """

    mouth: Floats
    axis: Floats
    radius_mm: float
    depth_mm: float
    is_through: bool
    facets: Ints

    def turned(self) -> Bore:
        """The same through bore, seen from its other mouth."""
        return replace(self, mouth=self.mouth - self.depth_mm * self.axis, axis=-self.axis)

    def __str__(self) -> str:
        """Diameter, depth and place, as findings name it."""
        x, y, z = self.mouth + 0.0
        kind = "through" if self.is_through else "blind"
        return f"{kind} bore D {2.0 * self.radius_mm:.2f} x {self.depth_mm:.1f} mm at ({x:.1f}, {y:.1f}, {z:.1f}) mm"


def hanging_bores(part: Mesh, max_overhang_deg: float, crease_deg: float) -> list[Bore]:
    """The bores of a part in its build frame that it cannot be built with: part of their wall hangs too far over.

    max_overhang_deg : of a wall from the build direction, what the material holds without support.
    A bore is a smooth piece of surface on one cylinder that looks inward, between two circles across its axis of which
    one is its mouth and the other another mouth or the rim of a flat bottom.
    """
    creases = crease_edges(part, crease_deg)
    across = np.where(creases.ravel(), np.int32(-1), part.across)
    piece, _ = pieces_of(np.ascontiguousarray(across, dtype=np.int32))
    hangs = part.normals[:, 2] < -np.sin(np.radians(max_overhang_deg)) - 1e-9
    found = []
    for number in np.unique(piece[hangs]).tolist():
        bore = _bore_of(part, np.flatnonzero(piece == number), piece)
        if bore is not None:
            found.append(bore)
    return found


def filled(part: Mesh, bores: Sequence[Bore]) -> Mesh:
    """The part with bores full of metal: their walls and bottoms taken out, their mouths closed flat."""
    if not bores:
        return part
    gone = np.zeros(len(part.facets), dtype=np.bool_)
    gone[np.concatenate([bore.facets for bore in bores])] = True
    opened = Mesh(part.vertices, part.facets[~gone])
    vertices, facets = [part.vertices], [opened.facets]
    at = len(part.vertices)
    for rim in rim_loops(opened):
        vertices.append(part.vertices[rim].mean(axis=0)[None, :])
        facets.append(np.column_stack([rim, np.roll(rim, -1), np.full(len(rim), at)]))
        at += 1
    whole = np.concatenate(facets)
    used, renumbered = np.unique(whole, return_inverse=True)
    return Mesh(np.concatenate(vertices)[used], renumbered.reshape(-1, 3))


def has_way_in(solid: Mesh, bore: Bore, room_mm: float = np.inf, holder_radius_mm: float = 0.0) -> bool:
    """Whether nothing of the filled part stands before the bore's mouth, as far as the bore is wide.

    room_mm : from this far before the mouth on, as far as the tool's holder is wide.
    """
    if bore.axis[2] < _LEVEL:
        return False
    height = ((solid.vertices - bore.mouth) @ bore.axis)[solid.facets]
    flat = (solid.vertices - bore.mouth) @ across_axes(bore.axis).T
    return all(
        _keeps_off(flat[solid.facets[(height > above).any(axis=1)]], radius - _ROUND_MM)
        for above, radius in ((_FLAT_MM, bore.radius_mm), (room_mm, holder_radius_mm))
    )


def _keeps_off(corners: Floats, radius_mm: float) -> bool:
    """Whether triangles in a plane, (n, 3, 2) float, mm, keep a distance from the origin."""
    if not len(corners) or radius_mm <= 0.0:
        return True
    double_area = np.abs(
        (corners[:, 1, 0] - corners[:, 0, 0]) * (corners[:, 2, 1] - corners[:, 0, 1])
        - (corners[:, 1, 1] - corners[:, 0, 1]) * (corners[:, 2, 0] - corners[:, 0, 0])
    )
    shadows = [*shapely.polygons(corners[double_area > 1e-12]), *shapely.linestrings(corners[double_area <= 1e-12])]
    return bool((shapely.distance(np.array(shadows), shapely.Point(0.0, 0.0)) >= radius_mm).all())


def across_axes(axis: Floats) -> Floats:
    """(2, 3) float   Two unit vectors at right angles to a unit vector and to each other, counter-clockwise about it."""
    helper = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    first = np.cross(helper, axis)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(axis, first)])


def _bore_of(part: Mesh, members: Ints, piece: Ints) -> Bore | None:
    """The bore that a smooth piece of surface is; None if it is none."""
    if len(members) < _FEWEST:
        return None
    normals, weight = part.normals[members], part.areas[members]
    spread = (normals * weight[:, None]).T @ normals / weight.sum()
    axis = np.linalg.eigh(spread)[1][:, 0]
    if np.abs(normals @ axis).max() > _ALONG:
        return None
    points = part.vertices[np.unique(part.facets[members])]
    frame = across_axes(axis)
    centre, radius = _circle(points @ frame.T)
    away = points @ frame.T - centre
    if np.abs(np.linalg.norm(away, axis=1) - radius).max() > _ROUND_MM:
        return None
    to_axis = centre - part.centroids[members] @ frame.T
    if ((normals @ frame.T) * to_axis).sum(axis=1).min() <= 0.0:
        return None
    return _between_ends(part, members, piece, axis, centre @ frame, radius)


def _circle(points: Floats) -> tuple[Floats, float]:
    """Centre, (2,) mm, and radius of the circle nearest to points, (n, 2): least squares of the squared distance."""
    system = np.column_stack([2.0 * points, np.ones(len(points))])
    solution = np.linalg.lstsq(system, (points**2).sum(axis=1), rcond=None)[0]
    return solution[:2], float(np.sqrt(solution[2] + (solution[:2] ** 2).sum()))


def _between_ends(part: Mesh, members: Ints, piece: Ints, axis: Floats, foot: Floats, radius: float) -> Bore | None:
    """The bore between the two circles that end its wall; None if they are not two flat circles or none is a mouth.

    foot : (3,) float, mm, a point of its axis.
    """
    rims = [part.vertices[rim] @ axis for rim in rim_loops(Mesh(part.vertices, part.facets[members]))]
    if len(rims) != 2 or max(float(np.ptp(rim)) for rim in rims) > _FLAT_MM:
        return None
    low, high = sorted(float(rim.mean()) for rim in rims)
    wall = set(members.tolist())
    outside = [f for f in np.unique(part.adjacency[members]).tolist() if f >= 0 and f not in wall]
    bottoms: list[Ints] = []
    mouths: list[float] = []
    for level, sign in ((low, -1.0), (high, 1.0)):
        beside = [f for f in outside if np.abs(part.vertices[part.facets[f]] @ axis - level).min() < _FLAT_MM]
        if not beside or np.abs(part.normals[beside] @ axis).min() < 1.0 - _ALONG:
            return None
        reach = np.linalg.norm(
            part.vertices[np.unique(part.facets[np.isin(piece, piece[beside])])] @ across_axes(axis).T
            - foot @ across_axes(axis).T,
            axis=1,
        )
        if reach.max() <= radius + _ROUND_MM:
            bottoms.append(np.flatnonzero(np.isin(piece, piece[beside])))
        elif (part.normals[beside] @ axis).min() * sign > 0.0 or (part.normals[beside] @ axis).max() * sign > 0.0:
            mouths.append(sign)
    if not mouths or len(mouths) + len(bottoms) != 2:
        return None
    sign = max(mouths, key=lambda way: round(float(way * axis[2]), 6))
    level = high if sign > 0.0 else low
    mouth = foot + (level - float(foot @ axis)) * axis
    return Bore(mouth, sign * axis, radius, high - low, len(mouths) == 2, np.concatenate([members, *bottoms]))
