"""Milling beside what stands higher: passes cut to the stretches on which the cutter is free of it."""

from __future__ import annotations

from collections.abc import Callable

import shapely
from shapely import MultiPolygon

from planner.nurbs.offset import outset
from planner.plan import Pass
from planner.process import Settings
from planner.toolpath.side import stretch_passes, upright_passes

Stands = Callable[[float, Settings], MultiPolygon]
"""Where the centre of an upright cutter must not go with its end at a height, mm."""

_ROOM_MM = 4.0  # beside a pass, for the arcs on and off the wall


def passes_beside(
    region: MultiPolygon, z: float, excess_mm: float, settings: Settings, stands: Stands | None
) -> list[Pass]:
    """`upright_passes` round a region where they are free of what stands, mm; where they are not, nothing is cut."""
    blocked = blocked_near(region, z, excess_mm, settings, stands)
    if blocked.is_empty:
        return upright_passes(region, z, excess_mm, settings)
    return stretch_passes(region, free_of(blocked, region, excess_mm, settings), z, excess_mm, settings)


def blocked_near(
    region: MultiPolygon, z: float, excess_mm: float, settings: Settings, stands: Stands | None
) -> MultiPolygon:
    """Where what stands keeps the cutter's centre from a region's walls and the ways on and off them."""
    if stands is None:
        return MultiPolygon()
    blocked = stands(z, settings)
    near = shapely.buffer(region.envelope, settings.cutter_radius_mm + 2.0 * excess_mm + _ROOM_MM)
    return polygons(shapely.intersection(blocked, near)) if shapely.intersects(blocked, near) else MultiPolygon()


def free_of(blocked: MultiPolygon, region: MultiPolygon, excess_mm: float, settings: Settings) -> MultiPolygon:
    """Where the centre may go round a region."""
    far = shapely.buffer(region.envelope, settings.cutter_diameter_mm + 2.0 * excess_mm + _ROOM_MM)
    return polygons(shapely.difference(far, blocked))


def blocked_mm(region: MultiPolygon, blocked: MultiPolygon, settings: Settings) -> float:
    """Length of the finishing pass round a region that what stands takes away, mm."""
    if blocked.is_empty:
        return 0.0
    return float(shapely.intersection(outset(region, settings.cutter_radius_mm).boundary, blocked).length)


def polygons(shape: shapely.Geometry) -> MultiPolygon:
    """The polygons of any geometry."""
    return MultiPolygon([piece for piece in shapely.get_parts(shape) if piece.geom_type == "Polygon"])
