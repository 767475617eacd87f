"""Layers whose planes turn with the piece: each in a frame of its own, between planes that need not be parallel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import MultiPolygon

from planner.errors import PlanningError
from planner.mesh.findings import place_text
from planner.mesh.mesh import Mesh
from planner.process import Settings
from planner.recipe import Recipe
from planner.slicing.contours import REGION_MM, ContourStyle, fitted_curves, nested_region
from planner.slicing.regions import LayerRegion, built_region
from planner.slicing.resting import Overhang, overhang
from planner.slicing.section import Section, plane_frame
from planner.slicing.slicer import slice_mesh
from planner.slicing.turned_planes import NoRoomError, TurnedPlanes, turned_planes

Floats = NDArray[np.float64]

_INSIDE = 2e-5
"""Of the piece's size: how far inside a layer its bottom and top sections are taken, so that vertices in the planes (rings
of a swept mesh, rims of a cut) lie clearly beside them."""
_TRIES = ((0.995, False), (0.97, False), (0.995, True), (0.97, True), (0.94, True))
"""Shares of the greatest thickness that are planned with, and whether evenly, one after the other, until every layer keeps
the bounds where it is measured: planes are laid out by their distances at sections half a millimetre apart."""
_SLACK = 0.005  # relative: of the bounds of thickness, for what lies between sections


@dataclass(frozen=True, eq=False)
class TurnedLayer:
    """One layer between two planes that need not be parallel.

    region : in the layer's frame (z = normal of its bottom plane, z = 0 in it): sections are the piece's own, in the build
    frame; areas are the bottom, middle and top section seen along z; z_top is the greatest height over the region
    build_from_layer : (4, 4) float, rigid   bottom, top : (6,) float, point (mm) and unit normal, build frame
    thickness_mm : least and greatest height of the top plane over the region, along the bottom's normal
    """

    region: LayerRegion
    build_from_layer: Floats
    bottom: Floats
    top: Floats
    thickness_mm: tuple[float, float]

    @cached_property
    def layer_from_build(self) -> Floats:
        """(4, 4) float   The other way round."""
        return np.asarray(np.linalg.inv(self.build_from_layer))

    @cached_property
    def top_in_layer(self) -> Floats:
        """(6,) float   The top plane in the layer's frame."""
        turn, shift = self.layer_from_build[:3, :3], self.layer_from_build[:3, 3]
        return np.concatenate([turn @ self.top[:3] + shift, turn @ self.top[3:]])

    @cached_property
    def build_from_top(self) -> Floats:
        """(4, 4) float   Frame of the top plane: z is its normal, z = 0 in it; turned the shortest way from the layer's."""
        matrix = np.eye(4)
        matrix[:3, :3] = _turned_to(self.build_from_layer[:3, :3].T, self.top[3:]).T
        matrix[:3, 3] = self.top[:3]
        return matrix

    @property
    def ratio(self) -> float:
        """Greatest over least thickness; infinite where both planes meet at the region's edge."""
        return self.thickness_mm[1] / self.thickness_mm[0] if self.thickness_mm[0] > 0.0 else float("inf")

    def height_at(self, xy: ArrayLike) -> Floats:
        """(n,) float, mm   Height of the top plane over places of the bottom plane, along its normal.  xy : (n, 2) float, mm"""
        places = np.atleast_2d(np.asarray(xy, dtype=np.float64))
        return height_of_plane(self.top_in_layer, places)


def height_of_plane(plane: Floats, xy: Floats) -> Floats:
    """(n,) float, mm   z of a plane, (6,) point and normal, over places (n, 2) of the same frame."""
    point, normal = plane[:3], plane[3:]
    return np.asarray(point[2] - (xy - point[:2]) @ normal[:2] / normal[2])


def turned_layers(mesh: Mesh, path: Floats, settings: Settings, recipe: Recipe) -> tuple[list[TurnedLayer], list[str]]:
    """The layers of a piece along a way of planes, from its base, and what was found.

    mesh : closed, build frame, mm   path : (p, 6) float, planes from the base to the piece's end or past it; the rows
    between which neighbouring planes lie turn linearly.
    Thickness keeps the material's bounds over the whole of each layer and the recipe's rule of the cusp, its ratio within
    a layer max_layer_ratio; with a fixed layer height layers are even and at most so high at the section's centroid.
    Raises PlanningError, one line with the place, where that cannot be: the piece should have been cut there.
    """
    worst: TurnedLayer | None = None
    refused: PlanningError | None = None
    for within, is_even in _TRIES:
        try:
            planes = turned_planes(mesh, path, settings, recipe, within, is_even=is_even)
        except NoRoomError as error:
            refused = error
            continue
        layers = _layers_between(mesh, planes, recipe)
        worst = _out_of_bounds(layers, settings)
        if worst is None:
            return layers, list(planes.findings)
    if worst is None and refused is not None:
        raise refused
    assert worst is not None
    facts = settings.material.deposition
    raise PlanningError(
        f"a layer that turns near {place_text(worst.bottom[:3])} would be {worst.thickness_mm[0]:.2f} to "
        f"{worst.thickness_mm[1]:.2f} mm thick; {settings.material.name} allows {facts.layer_height_mm.min:g} to "
        f"{facts.layer_height_mm.max:g} mm and {facts.max_layer_ratio:g} times within one layer",
        "cut the piece there, choose another layer height, or set axis_layers = never",
    )


def _out_of_bounds(layers: Sequence[TurnedLayer], settings: Settings) -> TurnedLayer | None:
    """A layer that is too thin, too thick or too uneven somewhere; the last may be thin, as the piece ends there."""
    facts = settings.material.deposition
    low, high = facts.layer_height_mm.min * (1.0 - _SLACK), facts.layer_height_mm.max * (1.0 + _SLACK)
    for layer in layers:
        least, most = layer.thickness_mm
        thin = least < low and (layer is not layers[-1] or len(layers) == 1)
        if thin or most > high or layer.ratio > facts.max_layer_ratio * (1.0 + _SLACK):
            return layer
    return None


def _layers_between(mesh: Mesh, planes: TurnedPlanes, recipe: Recipe) -> list[TurnedLayer]:
    """The layers between planes; all sections come from two calls of the slicer."""
    bottoms, tops = planes.bounding[:-1], planes.bounding[1:]
    count = len(bottoms)
    inside = _INSIDE * mesh.diagonal
    above = slice_mesh(mesh, np.vstack([_moved(bottoms, inside), planes.middle]), "above")
    below = slice_mesh(mesh, _moved(tops, -inside), "below")
    style = ContourStyle.from_recipe(recipe)
    rings = [
        [curve.evaluate(curve.sample(REGION_MM))[:-1] for curve in curves]
        for curves in fitted_curves([*above, *below], mesh, style)
    ]
    side = recipe.tolerance_side if recipe.process == "deposit" else "outside"
    layers: list[TurnedLayer] = []
    for i, build_from_layer in enumerate(layer_frames(bottoms)):
        sections = (above[i], above[count + i], below[i])
        areas = (
            seen_along_z(sections[0], rings[i], build_from_layer),
            seen_along_z(sections[1], rings[count + i], build_from_layer),
            seen_along_z(sections[2], rings[2 * count + i], build_from_layer),
        )
        built = built_region(areas, side)
        _refuse_nothing(built, bottoms[i])
        turned = np.linalg.inv(build_from_layer)
        top = np.concatenate([turned[:3, :3] @ tops[i, :3] + turned[:3, 3], turned[:3, :3] @ tops[i, 3:]])
        heights = height_of_plane(top, shapely.get_coordinates(built))
        rests = Overhang(built) if not layers else _resting(built, areas[0], layers[-1], build_from_layer, heights)
        region = LayerRegion(i, 0.0, float(heights.max()), *sections, areas, built, rests, side)
        thickness = (float(heights.min()), float(heights.max()))
        layers.append(TurnedLayer(region, build_from_layer, bottoms[i], tops[i], thickness))
    return layers


def _resting(
    built: MultiPolygon, bottom: MultiPolygon, below: TurnedLayer, build_from_layer: Floats, heights: Floats
) -> Overhang:
    """What of a layer rests on the one below (paper Eq. 1): that one as it is built, where its top plane cuts it."""
    flat = np.linalg.inv(build_from_layer) @ below.build_from_layer

    def carried(xy: Floats) -> Floats:
        points = np.column_stack([xy, below.height_at(xy)])
        return np.asarray(points @ flat[:2, :3].T + flat[:2, 3])

    lower = shapely.transform(below.region.region, carried)
    return overhang(built, lower, float(heights.mean()), bottom)


def _refuse_nothing(built: MultiPolygon, bottom: Floats) -> None:
    """Raise PlanningError where a layer holds nothing."""
    if built.is_empty:
        raise PlanningError(
            f"nothing of the piece lies in the layer at {place_text(bottom[:3])}, but something beyond it",
            "plan the bodies one by one, or set tolerance_side = outside",
        )


def _moved(planes: Floats, along_mm: float) -> Floats:
    """Planes moved along their normals.  planes : (k, 6) float"""
    moved = planes.copy()
    moved[:, :3] += along_mm * moved[:, 3:]
    return moved


def layer_frames(bottoms: Floats) -> list[Floats]:
    """build_from_layer of each layer, (4, 4) float: z is the plane's normal; x of the first is +x laid into its plane, and
    from layer to layer the frame turns the shortest way.

    bottoms : (k, 6) float, mm
    """
    frames = []
    axes = plane_frame(bottoms[0])[1:]
    for plane in bottoms:
        axes = _turned_to(axes, plane[3:])
        matrix = np.eye(4)
        matrix[:3, :3] = axes.T
        matrix[:3, 3] = plane[:3]
        frames.append(matrix)
    return frames


def _turned_to(axes: Floats, normal: Floats) -> Floats:
    """Axes (rows u, v, w) turned the shortest way so that w is the normal, right-angled to the last bit."""
    cross, cosine = np.cross(axes[2], normal), float(axes[2] @ normal)
    turned = axes + np.cross(cross, axes) + np.cross(cross, np.cross(cross, axes)) / (1.0 + cosine)
    u = turned[0] - (turned[0] @ normal) * normal
    u /= np.linalg.norm(u)
    return np.vstack([u, np.cross(normal, u), normal])


def seen_along_z(section: Section, rings: Sequence[Floats], build_from_layer: Floats) -> MultiPolygon:
    """What a section encloses, seen along a layer's z, in the layer's xy, mm.

    rings : (n, 3) float, mm, build frame, each   points of its loops' curves, in their order.
    """
    axes, origin = build_from_layer[:3, :2], build_from_layer[:3, 3]
    return nested_region(section, [(ring - origin) @ axes for ring in rings])
