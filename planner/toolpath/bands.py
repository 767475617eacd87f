"""Bands: how many layers are deposited before their side walls are milled together, and along which tool axis."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.mesh.mesh import Mesh
from planner.plan import Wall
from planner.process import Settings
from planner.slicing.even_walls import even_walls
from planner.slicing.regions import LayerRegion, is_same, united
from planner.slicing.slicer import slice_mesh
from planner.slicing.walls import ruled_walls, wall_error
from planner.toolpath.axis import STEEPEST_AXIS, ruled_motions
from planner.toolpath.scallop import Surface, ball_surface

Floats = NDArray[np.float64]
Kind = Literal["upright", "ruled", "stepped"]

_STEP_SHARE = 0.5  # of the tolerance: height of the steps by which a stepped wall is milled
_RUN_DOWN = 2.0  # layers: how far below its surface a track may wet a wall that goes out there
_WIDER_MM2 = 0.05  # of a section beyond what stands above it: less is rounding
_STEP_IN = 1e-3  # of a step: how far above its level it is looked at
_UPRIGHT_SHARE = 0.1  # of the tolerance: walls that no contour's rulings follow and that lean less are upright
_WALL_SHARE = 0.25  # of the tolerance: how far a ruled wall may stand from the mesh between its ends


@dataclass(frozen=True)
class Band:
    """Neighbouring layers whose walls are milled in one go.

    kind : "upright" walls along the build direction; "ruled" straight leaning walls, the axis follows the rulings;
    "stepped" walls that are neither: milled upright outside all of the band's sections
    region : all sections of the band together, mm   walls : of a ruled band
    continues : whether its bottom outline is the top outline of the band below
    steps : heights, mm, from the top, and what must not be cut from there up: of a stepped band its own, and of every band
    whose wall goes out below, those under it as far as metal runs down there
    surface : of a stepped band, where the recipe has a ball cutter for it
    """

    first: int
    last: int
    z_bottom: float
    z_top: float
    kind: Kind
    region: MultiPolygon
    walls: tuple[Wall, ...]
    continues: bool
    steps: tuple[tuple[float, MultiPolygon], ...] = ()
    surface: Surface | None = None


def make_bands(layers: list[LayerRegion], mesh: Mesh, settings: Settings) -> Iterator[Band]:
    """The layers in bands from below: as many as the recipe and the axial depth allow and as one axis law fits.

    A ledge, a new wall direction or a wall that no straight line follows begins another band. Each band is made when it is
    asked for, so that work on the lowest can begin before the others are known.
    """
    start = 0
    while start < len(layers):
        band = _band(layers, start, start, mesh, settings)
        for last in range(start + 1, len(layers)):
            if not _has_room(layers, start, last, settings) or band.kind == "stepped":
                break
            if not is_same(layers[last - 1].areas[2], layers[last].areas[0], 0.01):
                break
            longer = _band(layers, start, last, mesh, settings)
            if longer.kind != band.kind:
                break
            band = longer
        yield _with_steps(band, mesh, settings, layers[0].z_bottom)
        start = band.last + 1


def _has_room(layers: list[LayerRegion], first: int, last: int, settings: Settings) -> bool:
    most = settings.recipe.mill_every_layers
    height = layers[last].z_top - layers[first].z_bottom
    return height <= settings.mill_every_mm + 1e-9 and (most is None or last - first < most)


def _band(layers: list[LayerRegion], first: int, last: int, mesh: Mesh, settings: Settings) -> Band:
    """The band of layers first ... last with the best axis law that fits it."""
    members = layers[first : last + 1]
    region = united([layer.region for layer in members])
    continues = first > 0 and is_same(layers[first - 1].areas[2], layers[first].areas[0], 0.01)
    kind: Kind = "upright"
    walls: tuple[Wall, ...] = ()
    if not all(layer.is_upright and is_same(layer.region, region) for layer in members):
        kind, walls = leaning(members, region, mesh, settings)
    return Band(
        first, last, members[0].z_bottom, members[-1].z_top, kind, region, walls if kind == "ruled" else (), continues
    )


def leaning(
    members: list[LayerRegion], region: MultiPolygon, mesh: Mesh, settings: Settings
) -> tuple[Kind, tuple[Wall, ...]]:
    """How walls that are not quite upright are milled: along their contours' rulings, upright where that is as good, else evened."""
    walls = ruled_walls(members[0].bottom, members[-1].top, mesh)
    if _fits(walls, members, settings) and _is_followed(walls, settings):
        return "ruled", walls
    near = _UPRIGHT_SHARE * settings.recipe.tolerance_mm
    if all(is_same(area, region, near) for layer in members for area in layer.areas):
        return "upright", ()
    across = [members[0].areas[0], members[len(members) // 2].areas[1], members[-1].areas[2]]
    low, high = members[0].z_bottom, members[-1].z_top
    even = even_walls(across, (lambda xy: np.full(len(xy), low), lambda xy: np.full(len(xy), high)))
    allowed = _WALL_SHARE * settings.recipe.tolerance_mm
    ends = even and max(wall_error(even, across[0], 0.0), wall_error(even, across[2], 1.0)) <= allowed
    if ends and _fits(even, members, settings) and _is_followed(even, settings):
        return "ruled", even
    return ("ruled", walls) if len(members) == 1 and _fits(walls, members, settings) else ("stepped", ())


def _is_followed(walls: tuple[Wall, ...], settings: Settings) -> bool:
    """Whether the flank finds a way round each wall, were it alone."""
    return all(ruled_motions(wall, 0.0, 0.0, None, settings) for wall in walls)


def _with_steps(band: Band, mesh: Mesh, settings: Settings, floor_z: float) -> Band:
    """The band with the levels by which it and the wall under it are milled where no flank follows.

    floor_z : lowest level of the piece.
    """
    if band.kind == "upright":
        return band
    step = _STEP_SHARE * settings.recipe.tolerance_mm
    within = band.kind == "stepped"
    count = max(1, int(np.ceil((band.z_top - band.z_bottom) / step))) if within else 0
    under = min(_RUN_DOWN * settings.layer_max_mm, band.z_bottom - floor_z) if band.first else 0.0
    levels = [band.z_bottom + (band.z_top - band.z_bottom) * k / count for k in range(count)][::-1]
    lower = [band.z_bottom - step * (k + 1) for k in range(int(under / step + 1e-9))]
    found: list[tuple[float, MultiPolygon]] = []
    stands = MultiPolygon() if within else band.region
    for z, section in zip([*levels, *lower], _sections(mesh, np.array([*levels, *lower]), step), strict=True):
        is_wider = z >= band.z_bottom - 1e-9 or shapely.difference(section, stands).area > _WIDER_MM2
        stands = united([stands, section])
        if is_wider:
            found.append((z, stands))
    ball = settings.with_ball_cutter()
    surface = None
    if ball is not None and within and found:
        reach = (min(found[-1][0], band.z_bottom), band.z_top)
        surface = ball_surface(mesh, np.eye(4), reach, ball.cutter_radius_mm, ball.scallop_mm, settings.recipe.crease_deg)
    return replace(band, steps=tuple(found), surface=surface)


def _sections(mesh: Mesh, levels: Floats, step_mm: float) -> list[MultiPolygon]:
    """What stands just above some levels, mm."""
    if not len(levels):
        return []
    planes = np.zeros((len(levels), 6))
    planes[:, 2], planes[:, 5] = levels + _STEP_IN * step_mm, 1.0
    return [section.to_shapely() for section in slice_mesh(mesh, planes)]


def _fits(walls: tuple[Wall, ...], members: list[LayerRegion], settings: Settings) -> bool:
    """Whether ruled walls are there, not too flat, and near enough to every section between their ends."""
    if not walls:
        return False
    low, high = members[0].z_bottom, members[-1].z_top
    for wall in walls:
        u = np.linspace(0.0, 1.0, 100)
        ruling = wall.top.evaluate(u) - wall.bottom.evaluate(u)
        if (ruling[:, 2] < STEEPEST_AXIS * np.linalg.norm(ruling, axis=1)).any():
            return False
    allowed = _WALL_SHARE * settings.recipe.tolerance_mm
    for layer in members:
        middle = 0.5 * (layer.z_bottom + layer.z_top)
        if layer.areas[1].is_empty or wall_error(walls, layer.areas[1], (middle - low) / (high - low)) > allowed:
            return False
    return True
