"""How far round the cutter stands in metal along its passes, and the feed of the stretches on which that is more than it should."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.nurbs.offset import outset
from planner.plan import Pass
from planner.process import Settings

Floats = NDArray[np.float64]
Cells = NDArray[np.uint8]

_CELLS = 40.0  # in the cutter's radius: sides of the raster's squares
_MOST_SIDE = 3000  # squares along a side of the raster: larger metal is looked at more coarsely
_CHORD_MM = 0.01  # between a pass and its chords
_WINDOW_MM = 1.0  # of way on one feed at least
_STEPS = (0.75, 0.5, 0.35, 0.25)  # of the feed: slower steps, the least that a full slot is cut with
_SLACK_RAD = np.radians(10.0)  # of an angle: what the raster's squares may add, metal just beside the cutter with them


def engagement_limit_rad(radial_depth_mm: float, radius_mm: float) -> float:
    """The angle in which a cutter stands in metal at a radial depth along a straight wall: cos = 1 - depth / radius.

    Source: Altintas, Manufacturing Automation, 2nd ed., 2.5 (exit minus entry angle of peripheral milling).
    """
    return float(np.arccos(np.clip(1.0 - radial_depth_mm / radius_mm, -1.0, 1.0)))


@dataclass(frozen=True, eq=False)
class Engaged:
    """Along one pass: arc_mm (n,) float, length from its start   angle_rad (n,) float, of the cutter's edge that stands in metal."""

    arc_mm: Floats
    angle_rad: Floats

    @property
    def greatest_rad(self) -> float:
        """0 without samples."""
        return float(self.angle_rad.max(initial=0.0))


def engagements(passes: Sequence[Pass], metal: MultiPolygon, radius_mm: float) -> list[Engaged]:
    """The engagement along passes that run one after another in metal of one level, seen along the build direction.

    metal : what stands there before the first, mm   A pass's leading half of the cutter's edge is asked at every step; what it
    has gone over is gone. Right to a square of the raster, a fortieth of the radius: 9 degrees at an edge along the way.
    """
    if metal.is_empty or not passes:
        return [Engaged(np.zeros(1), np.zeros(1)) for _ in passes]
    bounds = np.array(metal.bounds)
    pitch = max(radius_mm / _CELLS, float((bounds[2:] - bounds[:2]).max()) / _MOST_SIDE)
    low = bounds[:2] - 2.0 * pitch
    shape = np.ceil((bounds[2:] - low) / pitch).astype(np.int64) + 3
    cells = _raster(_edges(metal), low[0], low[1], pitch, int(shape[0]), int(shape[1]))
    found = []
    for one in passes:
        arcs, points = _way(one, pitch)
        found.append(Engaged(arcs, _swept(cells, points, low[0], low[1], pitch, radius_mm)))
    return found


def eased(passes: Sequence[Pass], metal: MultiPolygon, radius_mm: float, limit_rad: float) -> list[Pass]:
    """The passes with less feed where the cutter stands in metal by more than an angle: feed x limit / angle, in steps.

    metal : what stands at the passes' level before the first, mm. Passes with more than one row of set-points stay as they are.
    """
    found = engagements(passes, metal, radius_mm)
    return [
        _slowed(one, seen, limit_rad) if len(one.setpoints) == 1 and seen.greatest_rad > limit_rad + _SLACK_RAD else one
        for one, seen in zip(passes, found, strict=True)
    ]


def eased_round(passes: list[Pass], region: MultiPolygon, excess_mm: float, settings: Settings) -> list[Pass]:
    """Passes round a region, slower where the cutter stands in the metal outside it by more than the radial depth asks for."""
    if excess_mm <= 0.0 or region.is_empty or not passes:
        return passes
    metal = shapely.difference(outset(region, excess_mm), region)
    pieces = MultiPolygon([piece for piece in shapely.get_parts(metal) if piece.geom_type == "Polygon"])
    radius = settings.cutter_radius_mm
    return eased(passes, pieces, radius, engagement_limit_rad(settings.material.milling.radial_depth_mm, radius))


def _slowed(one: Pass, seen: Engaged, limit_rad: float) -> Pass:
    """A pass in stretches of at least a window, each as slow as its greatest engagement asks for."""
    length = float(seen.arc_mm[-1])
    count = max(1, int(length / _WINDOW_MM))
    own = np.minimum((seen.arc_mm / length * count).astype(np.int64), count - 1)
    most = np.zeros(count)
    np.maximum.at(most, own, seen.angle_rad)
    share = np.where(most > limit_rad + _SLACK_RAD, limit_rad / np.maximum(most, 1e-9), 1.0)
    steps = np.array([1.0, *_STEPS])
    share = steps[np.argmin(np.abs(steps[None, :] - share[:, None]), axis=1)]
    starts = np.concatenate([[0], np.flatnonzero(np.diff(share)) + 1])
    rows = np.repeat(np.asarray(one.setpoints, dtype=np.float64), len(starts), axis=0)
    rows[:, 0] = starts / count * length
    rows[:, 1] *= share[starts]
    return replace(one, setpoints=rows)


def _way(one: Pass, pitch: float) -> tuple[Floats, Floats]:
    """Arc lengths (n,) mm and points (n, 2) mm along a pass, at most a square apart."""
    u = one.tip.sample(_CHORD_MM)
    points, arcs = one.tip.evaluate(u)[:, :2], one.tip.arc_length(u)
    at = np.linspace(0.0, float(arcs[-1]), max(2, int(np.ceil(arcs[-1] / pitch)) + 1))
    return at, np.ascontiguousarray(np.column_stack([np.interp(at, arcs, points[:, k]) for k in (0, 1)]))


def _edges(region: MultiPolygon) -> Floats:
    """(m, 4) float, mm   The sides of a region's outlines: x, y of start and end."""
    rings = [ring for piece in region.geoms for ring in (piece.exterior, *piece.interiors)]
    chains = [shapely.get_coordinates(ring) for ring in rings]
    return np.vstack([np.hstack([chain[:-1], chain[1:]]) for chain in chains])


@njit(cache=True)
def _raster(
    edges: Floats, low_x: float, low_y: float, pitch: float, columns: int, rows: int
) -> Cells:  # pragma: no cover
    """(rows, columns) uint8: squares whose middles lie in outlines, even-odd."""
    cells = np.zeros((rows, columns), np.uint8)
    for e in range(len(edges)):
        x0, y0, x1, y1 = edges[e]
        if y0 == y1:
            continue
        bottom, top = min(y0, y1), max(y0, y1)
        first = max(0, int(np.ceil((bottom - low_y) / pitch - 0.5)))
        for j in range(first, rows):
            y = low_y + (j + 0.5) * pitch
            if y >= top:
                break
            x = x0 + (y - y0) / (y1 - y0) * (x1 - x0)
            i = max(0, int(np.ceil((x - low_x) / pitch - 0.5)))
            if i < columns:
                cells[j, i] ^= 1
    for j in range(rows):
        for i in range(1, columns):
            cells[j, i] ^= cells[j, i - 1]
    return cells


@njit(cache=True)
def _swept(cells: Cells, points: Floats, low_x: float, low_y: float, pitch: float, radius: float) -> Floats:  # pragma: no cover
    """(n,) float, rad: how much of the cutter's leading edge stands in metal at each point; what it covers is cleared."""
    rows, columns = cells.shape
    count = int(np.ceil(np.pi * radius / pitch))
    edge = radius + 0.5 * pitch
    angles = np.zeros(len(points))
    for n in range(len(points)):
        x, y = points[n, 0], points[n, 1]
        if n:
            ahead_x, ahead_y = x - points[n - 1, 0], y - points[n - 1, 1]
            length = np.hypot(ahead_x, ahead_y)
            if length > 0.0:
                heading = np.arctan2(ahead_y, ahead_x)
                met = 0
                for k in range(count):
                    angle = heading + ((k + 0.5) / count - 0.5) * np.pi
                    i = int(np.floor((x + edge * np.cos(angle) - low_x) / pitch))
                    j = int(np.floor((y + edge * np.sin(angle) - low_y) / pitch))
                    if 0 <= i < columns and 0 <= j < rows and cells[j, i]:
                        met += 1
                angles[n] = met * np.pi / count
        first = max(0, int(np.floor((y - radius - low_y) / pitch)))
        last = min(rows - 1, int(np.ceil((y + radius - low_y) / pitch)))
        for j in range(first, last + 1):
            off = low_y + (j + 0.5) * pitch - y
            half2 = radius * radius - off * off
            if half2 > 0.0:
                half = np.sqrt(half2)
                begin = max(0, int(np.ceil((x - half - low_x) / pitch - 0.5)))
                end = min(columns - 1, int(np.floor((x + half - low_x) / pitch - 0.5)))
                for i in range(begin, end + 1):
                    cells[j, i] = 0
    return angles
