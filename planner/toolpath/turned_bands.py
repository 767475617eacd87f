"""Bands of layers that turn: milled together, in the frame of the band's bottom plane, along rulings from plane to plane."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from planner.mesh.mesh import Mesh
from planner.nurbs.offset import inset
from planner.plan import Wall
from planner.process import Settings
from planner.slicing.contours import REGION_MM, fitted_curves
from planner.slicing.even_walls import even_walls
from planner.slicing.regions import LayerRegion, built_region, is_same, united
from planner.slicing.resting import Overhang
from planner.slicing.slicer import slice_mesh
from planner.slicing.turned_outlines import turned_walls
from planner.slicing.turning import TurnedLayer, height_of_plane, seen_along_z
from planner.toolpath.axis import STEEPEST_AXIS
from planner.toolpath.bands import Band, Kind

Floats = NDArray[np.float64]

_WALL_SHARE = 0.25  # of the tolerance: how far a ruled wall may stand from the piece between its ends
_GOES_ON_MM = 0.01  # outlines nearer than this in one plane are one wall
_PARALLEL = 1.0 - 1e-9  # cosine: planes that turn less are parallel
_BELOW_MM = 0.8  # between the sections under a band that its cutter must spare
_ROOM_MM = 10.0  # from z = 0 of a band's frame to its bottom: more than a cutter's end is let down
_RULINGS = 100  # of each wall, at which it is measured


@dataclass(frozen=True, eq=False)
class TurnedBand:
    """Neighbouring layers whose walls are milled in one go.

    band : in the band's frame: z = normal of its bottom plane, z = 0 well under it; of a band on the base in it
    build_from_band : (4, 4) float, rigid   narrow : holes that the cutter does not enter, band frame, mm; not in band.region
    base : (6,) float, band frame   the piece's base plane   base_radius_mm : of its base about that plane's point
    """

    band: Band
    build_from_band: Floats
    narrow: MultiPolygon
    base: Floats
    base_radius_mm: float


def make_turned_bands(layers: Sequence[TurnedLayer], mesh: Mesh, settings: Settings) -> Iterator[TurnedBand]:
    """The layers in bands from the base on: as many as recipe and axial depth allow and as one ruled wall follows.

    A ledge, or a wall that no straight line follows within a quarter of the tolerance, begins another band. Each band is
    made when it is asked for.
    """
    start = 0
    while start < len(layers):
        made = _band(layers, start, start, mesh, settings)
        for last in range(start + 1, len(layers)):
            if not _has_room(layers, start, last, settings) or made.band.kind == "stepped":
                break
            if not _goes_on(layers[last - 1], layers[last]):
                break
            longer = _band(layers, start, last, mesh, settings)
            if longer.band.kind != made.band.kind:
                break
            made = longer
        yield made
        start = made.band.last + 1


def area_in(layer: TurnedLayer, which: int, build_from_frame: Floats) -> MultiPolygon:
    """A section of a layer seen along another frame's z, mm.  which : 0 bottom, 1 middle, 2 top."""
    section = (layer.region.bottom, layer.region.middle, layer.region.top)[which]
    turn, shift = layer.layer_from_build[:3, :3], layer.layer_from_build[:3, 3]
    plane = np.concatenate([turn @ section.plane[:3] + shift, turn @ section.plane[3:]])
    frame_from_layer = np.linalg.inv(build_from_frame) @ layer.build_from_layer

    def carried(xy: Floats) -> Floats:
        points = np.column_stack([xy, height_of_plane(plane, xy)])
        return np.asarray(points @ frame_from_layer[:2, :3].T + frame_from_layer[:2, 3])

    return shapely.transform(layer.region.areas[which], carried)


def _has_room(layers: Sequence[TurnedLayer], first: int, last: int, settings: Settings) -> bool:
    most = settings.recipe.mill_every_layers
    height = _top_mm(layers, first, last)
    return height <= settings.mill_every_mm + 1e-9 and (most is None or last - first < most)


def _top_mm(layers: Sequence[TurnedLayer], first: int, last: int) -> float:
    """Greatest height of a layer's top over the bottom plane of an earlier one, mm."""
    frame_from_layer = layers[first].layer_from_build @ layers[last].build_from_layer
    outline = shapely.get_coordinates(layers[last].region.region)
    points = np.column_stack([outline, layers[last].height_at(outline)])
    return float((points @ frame_from_layer[2, :3] + frame_from_layer[2, 3]).max())


def _goes_on(lower: TurnedLayer, upper: TurnedLayer) -> bool:
    """Whether a layer's bottom outline is the top outline of the one below."""
    return is_same(area_in(lower, 2, upper.build_from_layer), upper.region.areas[0], _GOES_ON_MM)


def _band(layers: Sequence[TurnedLayer], first: int, last: int, mesh: Mesh, settings: Settings) -> TurnedBand:
    """The band of layers first ... last with the best axis law that fits it."""
    members = layers[first : last + 1]
    frame = members[0].build_from_layer
    areas = [area_in(layer, which, frame) for layer in members for which in range(3)]
    region = united(areas)
    continues = first > 0 and _goes_on(layers[first - 1], layers[first])
    kind: Kind = "upright"
    walls: tuple[Wall, ...] = ()
    is_straight = members[-1].top[3:] @ members[0].bottom[3:] > _PARALLEL
    if not (is_straight and all(is_same(area, region) for area in areas)):
        (found,) = turned_walls(mesh, [(members[0].region.bottom, members[-1].region.top)])
        walls = tuple(
            replace(wall, bottom=wall.bottom.transformed(back), top=wall.top.transformed(back))
            for back in [np.linalg.inv(frame)]
            for wall in found
        )
        if not _fits(walls, members, settings):
            walls = _evened(members, areas)
        kind = "ruled" if _fits(walls, members, settings) else "stepped"
    open_region, narrow = _without_narrow(region, settings)
    kept = tuple(wall for wall in walls if kind == "ruled" and not _bounds_any(wall, narrow))
    room = _ROOM_MM if first else 0.0
    lifted = np.eye(4)
    lifted[2, 3] = room
    kept = tuple(
        replace(wall, bottom=wall.bottom.transformed(lifted), top=wall.top.transformed(lifted)) for wall in kept
    )
    band = Band(first, last, room, room + _top_mm(layers, first, last), kind, open_region, kept, continues)
    build_from_band = np.asarray(frame @ np.linalg.inv(lifted))
    back = np.linalg.inv(build_from_band)
    base = layers[0].bottom
    plane = np.concatenate([back[:3, :3] @ base[:3] + back[:3, 3], back[:3, :3] @ base[3:]])
    radius = float(np.linalg.norm(shapely.get_coordinates(layers[0].region.areas[0]), axis=1).max(initial=0.0))
    return TurnedBand(band, build_from_band, narrow, plane, radius)


def _evened(members: Sequence[TurnedLayer], areas: Sequence[MultiPolygon]) -> tuple[Wall, ...]:
    """Walls of a band from its outlines alone, in the frame of the first member.  areas : all sections seen along its z."""
    frame = members[0].build_from_layer
    top = members[-1].top
    back = np.linalg.inv(frame)
    plane = np.concatenate([back[:3, :3] @ top[:3] + back[:3, 3], back[:3, :3] @ top[3:]])
    across = (areas[0], areas[3 * (len(members) // 2) + 1], areas[-1])
    return even_walls(across, (lambda xy: np.zeros(len(xy)), lambda xy: height_of_plane(plane, xy)))


def _fits(walls: tuple[Wall, ...], members: Sequence[TurnedLayer], settings: Settings) -> bool:
    """Whether ruled walls are there, not too flat, and near enough to every section.

    walls : in the frame of the first member.
    """
    if not walls:
        return False
    low, ruling = [], []
    for wall in walls:
        u = np.linspace(0.0, 1.0, _RULINGS)
        low.append(wall.bottom.evaluate(u))
        ruling.append(wall.top.evaluate(u) - low[-1])
    start, along = np.concatenate(low), np.concatenate(ruling)
    if (along[:, 2] < STEEPEST_AXIS * np.linalg.norm(along, axis=1)).any():
        return False
    frame = members[0].build_from_layer
    start, along = start @ frame[:3, :3].T + frame[:3, 3], along @ frame[:3, :3].T
    worst = 0.0
    for layer in members:
        for which, section in ((0, layer.region.bottom), (1, layer.region.middle), (2, layer.region.top)):
            if layer.region.areas[which].is_empty:
                return False
            plane = section.plane
            share = ((plane[:3] - start) @ plane[3:]) / (along @ plane[3:])
            points = (start + share[:, None] * along) @ layer.layer_from_build[:2, :3].T + layer.layer_from_build[:2, 3]
            outline = layer.region.areas[which].boundary
            shapely.prepare(outline)
            worst = max(worst, float(shapely.distance(outline, shapely.points(points)).max()))
    return worst <= _WALL_SHARE * settings.recipe.tolerance_mm


def _without_narrow(region: MultiPolygon, settings: Settings) -> tuple[MultiPolygon, MultiPolygon]:
    """The region with those holes filled that the cutter does not enter, and these holes."""
    narrow: list[Polygon] = []
    parts = []
    for part in region.geoms:
        wide = []
        for ring in part.interiors:
            hole = Polygon(ring)
            if inset(MultiPolygon([hole]), settings.cutter_radius_mm).is_empty:
                narrow.append(hole)
            else:
                wide.append(ring)
        parts.append(Polygon(part.exterior, wide))
    return MultiPolygon(parts), MultiPolygon(narrow)


def _bounds_any(wall: Wall, holes: MultiPolygon) -> bool:
    """Whether a wall is that of one of the holes: it runs clockwise and most of it lies near the hole's outline."""
    if holes.is_empty:
        return False
    ring = wall.bottom.evaluate(np.linspace(0.0, 1.0, _RULINGS))[:, :2]
    if shapely.LinearRing(ring).is_ccw:
        return False
    return bool(shapely.contains_xy(shapely.buffer(holes, 0.5), *ring.mean(axis=0)))


def layers_under(made: TurnedBand, mesh: Mesh, depth_mm: float) -> list[LayerRegion]:
    """What stands of the piece under a band, as layers in the band's frame with planes parallel to its bottom.

    depth_mm : how far down they go, at most to z = 0   Empty for a band on the base.
    """
    band, frame = made.band, made.build_from_band
    deep = min(depth_mm, band.z_bottom)
    if band.first == 0 or deep <= 1e-6:
        return []
    count = max(1, int(np.ceil(deep / _BELOW_MM)))
    levels = np.linspace(band.z_bottom - deep, band.z_bottom, count + 1)
    heights = np.concatenate([levels[:-1], 0.5 * (levels[1:] + levels[:-1]), levels[1:]])
    planes = np.tile(np.concatenate([frame[:3, 3], frame[:3, 2]]), (len(heights), 1))
    planes[:, :3] += heights[:, None] * frame[:3, 2]
    sections = [*slice_mesh(mesh, planes[: 2 * count], "above"), *slice_mesh(mesh, planes[2 * count :], "below")]
    areas = [
        seen_along_z(section, [curve.evaluate(curve.sample(REGION_MM))[:-1] for curve in curves], frame)
        for section, curves in zip(sections, fitted_curves(sections, mesh), strict=True)
    ]
    found = []
    for i in range(count):
        own = (areas[i], areas[count + i], areas[2 * count + i])
        built = built_region(own, "outside")
        cut = (sections[i], sections[count + i], sections[2 * count + i])
        found.append(LayerRegion(i, float(levels[i]), float(levels[i + 1]), *cut, own, built, Overhang(built)))
    return found
