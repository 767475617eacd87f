"""The centroidal axis measured: sections across it, cut by planes that turn until each stands square on the axis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.slicing.section import Section, plane_frame
from planner.slicing.slicer import slice_mesh

Floats = NDArray[np.float64]

ROUNDS = 3  # cut, centre, turn: the third changes the axis of a bend of R = 2.5 r by less than 0.01 r
_ALIKE = 0.25  # of the area: by what a section may differ from the one before the last
_WINDOW = 0.6  # of the radius: standard deviation of the window that smooths the axis's direction


@dataclass(frozen=True, eq=False)
class Cut:
    """The region of one section that the axis runs through.

    plane : (6,) float   region : in the plane's frame, mm   centre : (3,) float, mm, its centroid (in the bore of a ring)
    area_mm2 : without holes' areas
    """

    plane: Floats
    region: shapely.Polygon
    centre: Floats
    area_mm2: float

    @property
    def radius_mm(self) -> float:
        """Radius of the circle with the section's area."""
        return float(np.sqrt(self.area_mm2 / np.pi))

    @property
    def outline(self) -> Floats:
        """(n, 3) float, mm   Its outer boundary in space."""
        frame = plane_frame(self.plane)
        return np.asarray(frame[0] + np.asarray(self.region.exterior.coords)[:-1] @ frame[1:3])

    @property
    def outer_mm(self) -> float:
        """Greatest distance of the outer boundary from the centroid."""
        return float(np.linalg.norm(self.outline - self.centre, axis=1).max())


def cuts_at(mesh: Mesh, planes: Floats) -> list[Cut | None]:
    """The region of each plane's section that holds the plane's point, bores filled; else the nearest; None where empty.

    planes : (k, 6) float, a point on the axis (mm) and a unit normal each.  Of regions inside each other's bores the smallest.
    """
    return [_through(section) for section in slice_mesh(mesh, planes)]


def _through(section: Section) -> Cut | None:
    regions = [region for region in section.to_shapely().geoms if region.area > 0.0]
    if not regions:
        return None
    here = shapely.Point(0.0, 0.0)
    filled = [shapely.Polygon(region.exterior) for region in regions]
    around = [k for k, shape in enumerate(filled) if shape.intersects(here)]
    nearest = min(range(len(regions)), key=lambda k: (filled[k].distance(here), k))
    region = regions[min(around, key=lambda k: (filled[k].area, k)) if around else nearest]
    middle = region.centroid
    return Cut(section.plane, region, section.lift([(middle.x, middle.y)])[0], float(region.area))


def lengths_along(points: Floats) -> Floats:
    """(k,) float, mm   Arc length of a polyline at its points (k, 3)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def resampled(points: Floats, at: Floats) -> Floats:
    """(m, 3) float, mm   Points of a polyline (k, 3) at arc lengths (m,)."""
    along = lengths_along(points)
    return np.column_stack([np.interp(at, along, points[:, k]) for k in range(3)])


def tangents_of(points: Floats, window_mm: float) -> Floats:
    """(k, 3) float   Unit directions of a polyline (k >= 2 points): slope of the parabola fitted in a Gaussian window."""
    along = lengths_along(points)
    spacing = along[-1] / max(len(points) - 1, 1)
    away = along[None, :] - along[:, None]
    weight = np.exp(-0.5 * (away / max(window_mm, 1.2 * spacing, 1e-9)) ** 2)
    scale = max(along[-1], 1e-9)
    terms = np.stack([np.ones_like(away), away / scale, (away / scale) ** 2], axis=-1)
    normal = np.einsum("ijp,ij,ijq->ipq", terms, weight, terms) + 1e-9 * np.eye(3)
    right = np.einsum("ijp,ij,jc->ipc", terms, weight, points)
    slope = np.linalg.solve(normal, right)[:, 1, :]
    return np.asarray(slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-12))


def squared(
    mesh: Mesh, points: Floats, radius_mm: float, most_mm2: Floats | None = None, rounds: int = ROUNDS
) -> tuple[list[Cut | None], Floats]:
    """Cuts square on the axis near points on it (k, 3), and the unit directions (k, 3) of the axis there.

    most_mm2 : (k,) float, areas above which a plane has run into another limb; None: twice the median
    Each round cuts at the points, moves them to the centroids and turns the planes to the axis through them; where the area
    is above the most the point stays and the cut is None in the end.
    """
    here = points.copy()
    cuts: list[Cut | None] = [None] * len(here)
    most = most_mm2
    for _ in range(rounds):
        directions = tangents_of(here, _WINDOW * radius_mm)
        cuts = cuts_at(mesh, np.hstack([here, directions]))
        if most_mm2 is None:
            areas = [cut.area_mm2 for cut in cuts if cut is not None]
            most = np.full(len(here), 2.0 * float(np.median(areas)) if areas else 0.0)
        for k, cut in enumerate(cuts):
            if cut is not None and most is not None and cut.area_mm2 > most[k]:
                cuts[k] = None
            elif cut is not None:
                here[k] = cut.centre
    return cuts, directions


def marched(
    mesh: Mesh, points: Floats, radius_mm: float, step_mm: float, is_over: Callable[[Cut], bool]
) -> tuple[Floats, Floats]:
    """Points (k, 3) on an axis and those that follow its last one, a step apart, as long as the sections stay alike.

    The next plane lies where the parabola through the last points leads; its centroid corrects it. Ends before a section that
    is_over, is missing, is a good deal larger or smaller than those before, or whose centroid strays by a third of a step.
    Returns also the areas (j,), mm², of the points added.
    """
    made = list(points)
    area = _area_at(mesh, made, radius_mm)
    areas = [area] if area is not None else []
    limit = len(points) + int(8.0 * radius_mm / step_mm) + 1
    while len(made) < limit and areas:
        place, direction = _ahead(np.array(made[-max(int(1.2 * radius_mm / step_mm), 5) :]), step_mm)
        cut = cuts_at(mesh, np.concatenate([place, direction])[None, :])[0]
        if cut is None or is_over(cut) or abs(cut.area_mm2 / np.median(areas[-3:]) - 1.0) > _ALIKE:
            break
        if np.linalg.norm(cut.centre - place) > 0.35 * step_mm:
            break
        made.append(cut.centre)
        areas.append(cut.area_mm2)
    return np.array(made), np.array(areas[1:])


def _area_at(mesh: Mesh, points: list[Floats], radius_mm: float) -> float | None:
    """Area of the section square on the axis at the last point."""
    directions = tangents_of(np.array(points[-12:]), _WINDOW * radius_mm)
    cut = cuts_at(mesh, np.concatenate([points[-1], directions[-1]])[None, :])[0]
    return cut.area_mm2 if cut else None


def _ahead(points: Floats, step_mm: float) -> tuple[Floats, Floats]:
    """Point and unit direction a step past the last of some points: on the parabola of least squares through them."""
    along = lengths_along(points) - lengths_along(points)[-1]
    fit = np.polynomial.polynomial.polyfit(along, points, min(2, len(points) - 1))
    fit = np.vstack([fit, np.zeros((3 - len(fit), 3))])
    direction = fit[1] + 2.0 * fit[2] * step_mm
    place = points[-1] + step_mm * fit[1] + step_mm**2 * fit[2]
    return np.asarray(place), np.asarray(direction / np.linalg.norm(direction))
