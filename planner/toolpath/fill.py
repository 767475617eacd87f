"""Hatch: parallel beads inside the contours, turned from layer to layer, run to and fro without leaving the region."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from planner.nurbs.offset import inset
from planner.plan import Pass
from planner.process import Bead, Settings
from planner.toolpath.contour import edge_mm, straight_bead
from planner.toolpath.fitting import scaled_bead
from planner.toolpath.relief import Relief

Floats = NDArray[np.float64]

_LEAST_STRIP = 0.25  # of the step, half its width: a track on a narrower strip brings more than twice its metal
_TOP_REACH = 0.25  # of the step: the core of a contour's bead begins there
_LEAST_LINE = 0.3  # of the bead's width: shorter tracks are drops; their neighbours cover them


@dataclass(frozen=True)
class Track:
    """One straight bead.  start, end : (2,) float, mm   line : number of its hatch line   region : of its polygon"""

    start: Floats
    end: Floats
    line: int
    region: int


def infill_region(grown: MultiPolygon, bead: Bead, settings: Settings, is_top: bool = False) -> MultiPolygon:
    """Where the centres of hatch beads may run, so that tracks at the step's distance bring just the metal it takes.

    A track fills one step of width. The contours therefore account for as many steps from the edge of full height, and
    hatch ends there; its tracks overlap the contour's.
    is_top : under a finished face no next layer fills what the round ends of tracks leave between them and the contour;
    hatch then runs on as far as no track lies over the contour's middle, and facing takes off what is too much.
    """
    depth = edge_mm(bead, settings) + settings.recipe.contours * bead.step_mm
    return inset(grown, depth - _TOP_REACH * bead.step_mm if is_top else depth)


def hatch_angle(layer: int, settings: Settings) -> float:
    """Direction of a layer's hatch, rad."""
    return math.radians(settings.recipe.hatch_angle_deg + layer * settings.recipe.hatch_rotation_deg)


def hatch_tracks(region: MultiPolygon, angle: float, step_mm: float, least_mm: float) -> list[Track]:
    """Tracks in the order in which they are run: lines evenly spread over each polygon, at most a step apart.

    region : centres of beads, mm   angle : rad   least_mm : shorter tracks are left out.
    Neighbouring lines are run to and fro; where a line falls into several pieces, each strand is run to its end.
    """
    tracks: list[Track] = []
    for number, polygon in enumerate(shapely.get_parts(region)):
        turned = shapely.affinity.rotate(polygon, -angle, origin=(0.0, 0.0), use_radians=True)
        for strand in _strands(_pieces(turned, step_mm, least_mm)):
            for k, (line, low, high, y) in enumerate(strand):
                ends = np.array([[low, y], [high, y]]) if k % 2 == 0 else np.array([[high, y], [low, y]])
                back = ends @ np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
                tracks.append(Track(back[0], back[1], line, number))
    return tracks


Piece = tuple[int, float, float, float]


def _pieces(polygon: Polygon, step_mm: float, least_mm: float) -> list[list[Piece]]:
    """Per hatch line its pieces inside the polygon: (line, from x, to x, y), from left to right."""
    left, bottom, right, top = polygon.bounds
    count = max(1, round((top - bottom) / step_mm))
    heights = bottom + (top - bottom) * (np.arange(count) + 0.5) / count
    ends = np.array([[[left - 1.0, y], [right + 1.0, y]] for y in heights])
    cut = shapely.intersection(shapely.linestrings(ends), polygon)
    lines = []
    for number, (shape, y) in enumerate(zip(cut, heights, strict=True)):
        spans = [part.bounds for part in shapely.get_parts(shape) if part.length >= least_mm]
        lines.append(sorted((number, span[0], span[2], float(y)) for span in spans))
    return lines


def _strands(lines: list[list[Piece]]) -> list[list[Piece]]:
    """Chains of pieces that face each other on neighbouring lines, then the nearest strand after each.

    A piece joins one strand only, so where the region forks or merges, a strand ends and others begin.
    """
    running: list[list[Piece]] = []
    done: list[list[Piece]] = []
    for line in lines:
        following: list[list[Piece]] = []
        taken: set[int] = set()
        for strand in running:
            last = strand[-1]
            side = 2 if len(strand) % 2 else 1
            facing = [
                k for k, piece in enumerate(line) if k not in taken and piece[1] < last[2] and last[1] < piece[2]
            ]
            if facing:
                nearest = min(facing, key=lambda k: abs(line[k][side] - last[side]))
                taken.add(nearest)
                following.append([*strand, line[nearest]])
            else:
                done.append(strand)
        following.extend([piece] for k, piece in enumerate(line) if k not in taken)
        running = following
    return _nearest_first([*done, *running])


def _nearest_first(strands: list[list[Piece]]) -> list[list[Piece]]:
    """Strands ordered so that each starts near the end of the one before it; the first is the lowest, leftmost."""
    left = sorted(strands, key=lambda strand: (strand[0][0], strand[0][1]))
    ordered: list[list[Piece]] = []
    while left:
        chosen = left.pop(0 if not ordered else _nearest(_end(ordered[-1]), left))
        ordered.append(chosen)
    return ordered


def _end(strand: list[Piece]) -> tuple[float, float]:
    """Where a strand ends: x, y."""
    last = strand[-1]
    return last[2] if len(strand) % 2 else last[1], last[3]


def _nearest(at: tuple[float, float], strands: list[list[Piece]]) -> int:
    """Number of the strand that starts nearest to a point."""
    return min(range(len(strands)), key=lambda k: math.dist(at, (strands[k][0][1], strands[k][0][3])))


def raster_passes(
    region: MultiPolygon,
    z: float,
    layer: int,
    bead: Bead,
    settings: Settings,
    relief: Relief | None = None,
    rather: float = 1.0,
    least_times: float = 0.0,
    evens: bool = True,
) -> list[Pass]:
    """Hatch with the metal that a region takes: lines at even distances, the bead of each polygon scaled to them.

    region : that tracks stand for, mm   z : of the surface that receives them   relief : of the layer, where it is not
    equally high everywhere   rather : times the metal   least_times : the bead's metal that they bring in any case
    evens : whether beads are scaled. Every other layer begins at the other end.
    """
    passes: list[Pass] = []
    for polygon in shapely.get_parts(region):
        tracks = hatch_tracks(MultiPolygon([polygon]), hatch_angle(layer, settings), bead.step_mm, _LEAST_LINE * bead.width_mm)
        if not tracks:
            continue
        lit = sum(math.dist(track.start, track.end) for track in tracks)
        times = polygon.area / (bead.step_mm * lit) * rather
        made = scaled_bead(bead, max(times, least_times), settings) if evens else bead
        ends = [(track.start, track.end) for track in tracks]
        if layer % 2:
            ends = [(end, start) for start, end in reversed(ends)]
        passes += [straight_bead(np.append(start, z), np.append(end, z), made, settings, relief) for start, end in ends]
    return passes


def fillable(region: MultiPolygon, bead: Bead) -> MultiPolygon:
    """The polygons of a region that are wide enough for a bead."""
    return MultiPolygon([part for part in region.geoms if not inset(part, _LEAST_STRIP * bead.step_mm).is_empty])
