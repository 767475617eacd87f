"""Overhang built from the side: beads along the tangent of leaning walls, and level passes out from what carries them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from planner.plan import Pass
from planner.process import Bead, Settings
from planner.slicing.regions import LayerRegion
from planner.toolpath.contour import closed_bead, open_bead
from planner.toolpath.fitting import Stretch, fitted_bead
from planner.toolpath.heel import heel_pass
from planner.toolpath.leaning import Heights, Run, leaning_runs
from planner.toolpath.ledge import ledge_passes
from planner.toolpath.tilt import TURN_DEG_S, across_axis, axes_of, smoothed, spread_rows, tilted_motion, turn_deg_mm

Floats = NDArray[np.float64]

WIDEST = 1.35  # of the bead's width: walls up to it are one tilted bead
_LEAST_REST = 0.6  # of the bead's width: a narrower rest beside a tilted bead is taken into it
_MOST_ALONG_MM = 1.0  # of a bead along the tool axis: higher steps of the wall are built in several
_CHANGE = 0.05  # of its metal or width: a larger change begins another stretch
_BEYOND_MM = 5.0  # outside a leaning wall: how far what its beads stand for is cut from the layer
_SLIVER = 0.15  # of the bead's width: what is left narrower than twice that beside tilted beads is theirs
_LEAST_POINTS = 4
_SPREADS = (0.6, 1.8)  # rings that close up to less are points
_ROUND_END = 0.35  # of the bead's width: so far from an end of a wall its beads end, whose tips are round
_FAR_OVER_DEG = 45.0
_SETTLES, _SETTLES_RING = 0.08, 0.15
"""Of the bead's width: so much farther out than its focus a bead comes to lie that is laid with the head far over, on walls that
open or run straight, and on rings that close inward. Measured in the twin on walls (tests/unit/sim/test_proof_of_overhang.py), funnel
and dome (tests/parts); to be set for the own head."""


@dataclass(frozen=True)
class Overhanging:
    """passes : in order, inner first   rest : what upright beads make of the layer, mm."""

    passes: list[Pass]
    rest: MultiPolygon


def overhang_passes(
    layer: LayerRegion,
    grown: MultiPolygon,
    middle: MultiPolygon,
    growth_mm: float,
    bead: Bead,
    settings: Settings,
    height_at: Heights | None = None,
    below: LayerRegion | None = None,
) -> Overhanging:
    """The passes that build what hangs out, and the region that is left to upright beads.

    grown : the layer's region with what is milled off, mm   middle : its section half-way up, grown by growth_mm
    bead : of the layer   height_at : of a layer that is not equally high everywhere   below : the layer below, where known.
    Along walls that lean, beads stand on those of the layer below, along the tool axis; each takes the place of a strip
    of the layer as wide as it is across its axis. Undersides are closed by level passes from what carries them.
    Raises RecipeError if the material's window has no such bead.
    """
    passes: list[Pass] = []
    rest: shapely.Geometry = grown
    runs = leaning_runs(layer, middle, growth_mm, settings, height_at)
    taken = []
    for run in runs:
        widths = _widths(run, bead, settings)
        heel = heel_pass(run, widths, layer, below, bead, settings)
        passes += [heel] if heel is not None else []
        passes += _stack(run, widths, layer, bead, settings)
        taken.append(_strip(run, widths))
    if taken:
        rest = shapely.difference(shapely.union(rest, middle), shapely.union_all(taken))
    ledges, under = ledge_passes(layer, taken, bead, settings)
    if ledges:
        rest = shapely.difference(rest, under)
    if not passes and not ledges:
        return Overhanging([], grown)
    return Overhanging([*passes, *ledges], _without_slivers(rest, bead))


def _widths(run: Run, bead: Bead, settings: Settings) -> Floats:
    """(n,) float, mm   Width across the tool axis of the beads along a run: the wall's where one bead makes it all."""
    wall = run.across_mm / run.share
    usual = bead.width_mm
    widest = min(WIDEST * usual, fitted_bead(bead, 10.0 * usual, 0.0, settings).width_mm)
    least = fitted_bead(bead, 0.1 * usual, 0.0, settings).width_mm
    alone = np.median(wall) <= widest or np.median(run.across_mm - usual * run.share) < _LEAST_REST * usual
    chosen = np.clip(wall, least, widest) if alone else np.minimum(np.clip(wall, least, widest), usual)
    return smoothed(chosen[:, None], run.spacing_mm, run.closed)[:, 0]


def _strip(run: Run, widths: Floats) -> shapely.Geometry:
    """What the beads of a run stand for half-way up the layer, and what lies outside their wall."""
    inner = run.points - (widths * run.share)[:, None] * run.outward
    outer = run.points + _BEYOND_MM * run.outward
    if not run.closed:
        return shapely.make_valid(Polygon(np.vstack([outer, inner[::-1]])))
    across, wall = shapely.make_valid(Polygon(inner)), Polygon(run.points)
    if wall.exterior.is_ccw:  # an outline: its material lies inside
        return shapely.difference(wall.buffer(_BEYOND_MM), across)
    return shapely.union(across, wall)


def _stack(run: Run, widths: Floats, layer: LayerRegion, bead: Bead, settings: Settings) -> list[Pass]:
    """The beads of a layer along a run, one on the other along the tool axis; inner first."""
    over = 1.0 + settings.overbuild
    along = run.share * run.height_mm * over
    count = max(1, int(np.ceil(float(along.max()) / _MOST_ALONG_MM - 1e-9)))
    outward = smoothed(run.outward, run.spacing_mm, run.closed)
    outward = outward / np.linalg.norm(outward, axis=1)[:, None]
    axes = axes_of(outward, smoothed(run.tilt_deg[:, None], run.spacing_mm, run.closed)[:, 0])
    lean = np.tan(np.radians(run.lean_deg))
    step = run.height_mm / count
    closes = run.closed and not shapely.LinearRing(run.points).is_ccw
    settles = _SETTLES_RING if closes else _SETTLES
    inward = (settles * widths * (run.tilt_deg > _FAR_OVER_DEG))[:, None] * across_axis(outward, run.tilt_deg)
    areas = widths * along / count
    passes = []
    for number in range(count):
        up = (number + 0.5) * step
        out = (up - 0.5 * run.height_mm) * lean - 0.5 * widths * run.share
        middles = np.column_stack([run.points + out[:, None] * run.outward, layer.z_bottom + up])
        tips = middles - (0.5 * run.share * step)[:, None] * axes + inward
        metal = areas * _spread(middles, tips, run.closed)
        rows = spread_rows(tips, layer.index + number, run.closed)
        made = _pass(tips[rows], axes[rows], widths[rows], metal[rows], run, bead, settings)
        if made is not None:
            passes.append(made)
    return passes


def _spread(middles: Floats, tips: Floats, closed: bool) -> Floats:
    """(n,) float   How much longer the way through the beads' middles is than that of the tip: rings that open outward."""
    ways = [
        np.linalg.norm(np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0), axis=1)
        if closed
        else np.linalg.norm(np.gradient(points, axis=0), axis=1)
        for points in (middles, tips)
    ]
    return np.asarray(np.clip(ways[0] / np.maximum(ways[1], 1e-6), *_SPREADS))


def _pass(
    tips: Floats, axes: Floats, widths: Floats, areas: Floats, run: Run, bead: Bead, settings: Settings
) -> Pass | None:
    """One tilted bead through tips; None where they close up to nothing."""
    ends = _half_beads(run, widths, tips)
    tips, axes, widths, areas = tips[ends], axes[ends], widths[ends], areas[ends]
    following = np.roll(tips, -1, axis=0) if run.closed else np.vstack([tips[1:], tips[-1:] + 1.0])
    kept = np.linalg.norm(following - tips, axis=1) > 0.05
    tips, axes, widths, areas = tips[kept], axes[kept], widths[kept], areas[kept]
    if len(tips) < _LEAST_POINTS:
        return None
    motion = tilted_motion(tips, axes, run.closed)
    slowest = TURN_DEG_S / np.maximum(turn_deg_mm(axes, tips, run.closed), 1e-6)
    arcs = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(tips, axis=0), axis=1))])
    arcs *= motion.length / (arcs[-1] + (np.linalg.norm(tips[0] - tips[-1]) if run.closed else 0.0))
    stretches = _stretches(arcs, widths, areas, slowest, bead, settings)
    return (closed_bead if run.closed else open_bead)(motion, bead, settings, stretches)


def _half_beads(run: Run, widths: Floats, tips: Floats) -> NDArray[np.int64]:
    """Rows of an open run without half a bead at either end, whose round ends fill it."""
    rows = np.arange(len(tips))
    if run.closed:
        return rows
    cut = int(_ROUND_END * float(np.median(widths)) / run.spacing_mm)
    return rows[cut : len(rows) - cut] if len(rows) > 2 * cut + _LEAST_POINTS else rows


def _stretches(
    arcs: Floats, widths: Floats, areas: Floats, fastest: Floats, bead: Bead, settings: Settings
) -> list[Stretch]:
    """Beads along the arcs, another one where metal, width or the speed that the axis can follow change."""
    found: list[Stretch] = []
    first = 0
    for k in range(1, len(arcs) + 1):
        if k < len(arcs) and all(
            values[first : k + 1].max() <= (1.0 + _CHANGE) * values[first : k + 1].min()
            for values in (widths, areas, np.minimum(fastest, settings.material.deposition.speed_mm_s.max))
        ):
            continue
        wide, metal = float(widths[first:k].mean()), float(areas[first:k].max())
        found.append(
            Stretch(float(arcs[first]), tilted_bead(bead, wide, metal, float(fastest[first:k].min()), settings))
        )
        first = k
    return found


def tilted_bead(bead: Bead, width_mm: float, area_mm2: float, fastest_mm_s: float, settings: Settings) -> Bead:
    """A bead of a width and a cross-section, no faster than the tool axis can turn along it, as the window allows.

    Raises RecipeError if the window has none so large.
    """
    wide = fitted_bead(bead, width_mm, 0.0, settings)
    made = settings.with_area(wide, max(area_mm2, 1e-3))
    if made.speed_mm_s <= fastest_mm_s or settings.recipe.speed_mm_s is not None:
        return made
    slow = max(fastest_mm_s, settings.material.deposition.speed_mm_s.min)
    return settings.slowed(replace(made, step_mm=bead.step_mm), slow)


def _without_slivers(rest: shapely.Geometry, bead: Bead) -> MultiPolygon:
    """The polygons of what is left, without strips that the beads beside them cover."""
    cut = _SLIVER * bead.width_mm
    opened = shapely.intersection(shapely.buffer(shapely.buffer(rest, -cut), 1.01 * cut), rest)
    return MultiPolygon([part for part in shapely.get_parts(opened) if part.geom_type == "Polygon"])
