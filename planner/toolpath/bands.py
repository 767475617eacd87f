"""Bands: how many layers are deposited before their side walls are milled together, and along which tool axis."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from shapely import MultiPolygon

from planner.mesh.mesh import Mesh
from planner.plan import Wall
from planner.process import Settings
from planner.slicing.regions import LayerRegion, is_same, united
from planner.slicing.slicer import slice_mesh
from planner.slicing.walls import ruled_walls, wall_error
from planner.toolpath.axis import STEEPEST_AXIS

Kind = Literal["upright", "ruled", "stepped"]

_STEP_SHARE = 0.5  # of the tolerance: height of the steps by which a stepped wall is milled
_STEP_IN = 1e-3  # of a step: how far above its level it is looked at
_WALL_SHARE = 0.25  # of the tolerance: how far a ruled wall may stand from the mesh between its ends


@dataclass(frozen=True)
class Band:
    """Neighbouring layers whose walls are milled in one go.

    kind : "upright" walls along the build direction; "ruled" straight leaning walls, the axis follows the rulings;
    "stepped" walls that are neither: milled upright outside all of the band's sections
    region : all sections of the band together, mm   walls : of a ruled band
    continues : whether its bottom outline is the top outline of the band below
    steps : of a stepped band, from the top: heights, mm, and what may not be cut from there up within the band
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
        yield replace(band, steps=_steps(band, mesh, settings)) if band.kind == "stepped" else band
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
        walls = ruled_walls(members[0].bottom, members[-1].top, mesh)
        kind = "ruled" if _fits(walls, members, settings) else "stepped"
    return Band(
        first, last, members[0].z_bottom, members[-1].z_top, kind, region, walls if kind == "ruled" else (), continues
    )


def _steps(band: Band, mesh: Mesh, settings: Settings) -> tuple[tuple[float, MultiPolygon], ...]:
    """Levels between a band's bottom and top, so near to each other that steps between them keep the tolerance."""
    height = band.z_top - band.z_bottom
    count = max(1, int(np.ceil(height / (_STEP_SHARE * settings.recipe.tolerance_mm))))
    levels = band.z_bottom + height * (np.arange(count) + 0.5 * _STEP_IN) / count
    planes = np.zeros((count, 6))
    planes[:, 2], planes[:, 5] = levels, 1.0
    found: list[tuple[float, MultiPolygon]] = []
    stands = MultiPolygon()
    for number, section in reversed(list(enumerate(slice_mesh(mesh, planes)))):
        stands = united([stands, section.to_shapely()])
        found.append((band.z_bottom + height * number / count, stands))
    return tuple(found)


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
