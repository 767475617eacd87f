"""Where walls begin to lean: the wedge between the level layer below and the first bead along the wall, filled from above."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from planner.plan import Pass
from planner.process import Bead, Settings
from planner.slicing.regions import LayerRegion
from planner.toolpath.contour import closed_bead, open_bead
from planner.toolpath.fitting import Stretch
from planner.toolpath.leaning import Run, lean_deg
from planner.toolpath.tilt import axes_of, smoothed, spread_rows, tilt_deg, tilted_motion

Floats = NDArray[np.float64]

_LEAST_DEG = 12.0  # between the beads of two layers: less is closed by the beads themselves
_LEAST_SHARE = 0.3  # of the layer's bead: smaller wedges too
_AFTER_TILTED = 0.5  # of a wedge over beads that are tilted too: they reach into it
_NEAR_MM = 0.3  # of the overhang below: as for the layer itself
_LEAST_POINTS = 4
_SAME_MM = 0.05


def heel_pass(
    run: Run, widths: Floats, layer: LayerRegion, below: LayerRegion | None, bead: Bead, settings: Settings
) -> Pass | None:
    """The bead that fills the wedge under the inner half of the first beads of a run; None where there is none worth one.

    widths : (n,) float, mm, of the run's beads across the tool axis   below : the layer below; None: not known.
    The wedge's sides are half the run's width in the layer's plane and half a bead's width square to the tool axis; its
    metal is laid at its centroid with the head as it was for the layer below.
    """
    if below is None:
        return None
    before = _tilt_below(run, below, settings)
    if float(np.median(run.tilt_deg - before)) < _LEAST_DEG:
        return None
    turn = np.radians(np.maximum(run.tilt_deg - before, 0.0))
    level, square = 0.5 * widths * run.share, 0.5 * widths
    area = float(np.median(0.5 * level * square * np.sin(turn)))
    area *= _AFTER_TILTED if float(np.median(before)) > 0.0 else 1.0
    if area < _LEAST_SHARE * bead.area_mm2:
        return None
    inward = (level + (level + square * np.cos(turn)) / 3.0) + 0.5 * run.height_mm * np.tan(np.radians(run.lean_deg))
    tips = np.column_stack([run.points - inward[:, None] * run.outward, np.full(len(run.points), layer.z_bottom)])
    axes = axes_of(run.outward, smoothed(before[:, None], run.spacing_mm, run.closed)[:, 0])
    rows = spread_rows(tips, layer.index, run.closed)
    rows = rows[np.linalg.norm(np.roll(tips[rows], -1, axis=0) - tips[rows], axis=1) > _SAME_MM]
    if len(rows) < _LEAST_POINTS:
        return None
    made = settings.with_area(bead, min(area, bead.area_mm2))
    motion = tilted_motion(tips[rows], axes[rows], run.closed)
    return (closed_bead if run.closed else open_bead)(motion, made, settings, [Stretch(0.0, made)])


def _tilt_below(run: Run, below: LayerRegion, settings: Settings) -> Floats:
    """(n,) float, deg   Tilt of the beads of the layer below under a run's points."""
    if below.overhang.is_empty:
        return np.zeros(len(run.points))
    back = run.height_mm * np.tan(np.radians(run.lean_deg))
    under = run.points - back[:, None] * run.outward
    lean = lean_deg(under, np.full(len(under), below.height_mm), below)
    hangs = np.asarray(shapely.dwithin(shapely.points(under), below.overhang, _NEAR_MM + float(back.max())))
    return np.where(hangs, tilt_deg(lean, settings), 0.0)
