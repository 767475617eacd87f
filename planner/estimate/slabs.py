"""The layers that an estimate counts with: their sections and how their walls run, without contours, walls or passes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.decompose.bores import Bore, filled, hanging_bores
from planner.decompose.pieces import Division, Piece
from planner.mesh.mesh import Mesh
from planner.process import Settings
from planner.slicing.layers import layer_levels
from planner.slicing.regions import LayerRegion, is_same, layer_regions
from planner.slicing.slicer import slice_mesh
from planner.toolpath.bands import leaning

Floats = NDArray[np.float64]

_SAME_MM = 0.01  # sections nearer than this run on into each other, as in the planner's bands
_TOP_SHARE = 0.02  # of a layer's top that is free: it is a finished face, as in `planner.toolpath.tops`
_LOOKED_AT = 6  # leaning layers of a piece whose walls are fitted as the planner does; the others are taken to be as the nearest of them


@dataclass(frozen=True, eq=False)
class Slab:
    """One layer of a piece.

    height_mm : of the layer   region : what is built, mm, in the layer's plane   is_top : part of its top stays free
    is_upright : its walls run along the build direction   is_stepped : they are too curved or too flat for a cutter's flank
    goes_on : whether its outline begins where the layer below ended   out_mm : how far its walls lean over its height
    room_mm : height of the piece below it, for what is milled under it
    """

    height_mm: float
    region: MultiPolygon
    is_top: bool
    is_upright: bool
    is_stepped: bool
    goes_on: bool
    out_mm: float
    room_mm: float


@dataclass(frozen=True, eq=False)
class Sliced:
    """One piece in layers.  bores : holes that are cut from the side when it stands"""

    slabs: tuple[Slab, ...]
    bores: tuple[Bore, ...]


def sliced_pieces(division: Division, settings: Settings) -> list[Sliced]:
    """Each piece of a division in layers by the recipe's rule.  Raises PlanningError or RecipeError."""
    return [_sliced(piece, settings) for piece in division.pieces]


def _sliced(piece: Piece, settings: Settings) -> Sliced:
    if piece.path is not None and settings.recipe.process != "mill":
        return Sliced(_turned(piece, piece.path, settings), ())
    mesh = piece.mesh.transformed(np.linalg.inv(piece.build_from_piece))
    bores: list[Bore] = []
    if settings.recipe.process == "hybrid":
        bores = hanging_bores(mesh, settings.material.deposition.max_overhang_deg, settings.recipe.crease_deg)
        mesh = filled(mesh, bores)
    return Sliced(_straight(mesh, settings), tuple(bores))


def _straight(mesh: Mesh, settings: Settings) -> tuple[Slab, ...]:
    recipe = settings.recipe
    levels, _ = layer_levels(mesh, recipe.cusp_mm, settings.layer_min_mm, settings.layer_max_mm, rule="facet")
    regions = [region for region in layer_regions(mesh, levels) if not region.region.is_empty]
    following = [*regions[1:], None]
    stepped = _stepped(regions, mesh, settings) if settings.is_milled else set()
    return tuple(
        _slab(region, regions[i - 1] if i else None, following[i], settings, i in stepped) for i, region in enumerate(regions)
    )


def _stepped(regions: list[LayerRegion], mesh: Mesh, settings: Settings) -> set[int]:
    """Which layers have walls that no flank follows, from some that are looked at."""
    leaning_ones = np.flatnonzero([not region.is_upright for region in regions])
    if not len(leaning_ones):
        return set()
    looked_at = leaning_ones[np.unique(np.linspace(0, len(leaning_ones) - 1, _LOOKED_AT).round().astype(np.int64))]
    is_stepped = np.array([leaning([regions[i]], regions[i].region, mesh, settings)[0] == "stepped" for i in looked_at])
    nearest = np.abs(leaning_ones[:, None] - looked_at[None, :]).argmin(axis=1)
    return set(leaning_ones[is_stepped[nearest]].tolist())


def _slab(
    layer: LayerRegion, below: LayerRegion | None, above: LayerRegion | None, settings: Settings, is_stepped: bool
) -> Slab:
    top = layer.areas[2]
    free = top.area if above is None else float(shapely.difference(top, above.areas[0]).area)
    out = 0.0 if layer.is_upright else float(shapely.hausdorff_distance(layer.areas[0].boundary, layer.areas[2].boundary))
    return Slab(
        height_mm=layer.height_mm,
        region=layer.region,
        is_top=settings.is_milled and free > _TOP_SHARE * top.area,
        is_upright=layer.is_upright,
        is_stepped=is_stepped,
        goes_on=below is not None and is_same(below.areas[2], layer.areas[0], _SAME_MM),
        out_mm=out,
        room_mm=0.0 if below is None else layer.z_bottom,
    )


def _turned(piece: Piece, path: Floats, settings: Settings) -> tuple[Slab, ...]:
    """Layers across the centroidal axis of a piece that bends, each as high as the recipe's layers, mm."""
    way = piece.axis
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1)))
    count = max(1, int(np.ceil(along[-1] / settings.layer_max_mm - 1e-3)))
    stations = np.linspace(0.0, along[-1], count + 1)
    middle = np.array([0.5 * (a + b) for a, b in pairwise(stations)])
    points = np.column_stack([np.interp(middle, along, way[:, k]) for k in range(3)])
    place = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path[:, :3], axis=0), axis=1)))
    normals = np.column_stack([np.interp(middle * place[-1] / along[-1], place, path[:, 3 + k]) for k in range(3)])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    sections = slice_mesh(piece.mesh, np.hstack([points, normals]))
    regions = [section.to_shapely() for section in sections]
    height = float(along[-1] / count)
    return tuple(
        Slab(height, region, settings.is_milled and i == count - 1, False, False, i > 0, 0.0, i * height)
        for i, region in enumerate(regions)
        if not region.is_empty
    )
