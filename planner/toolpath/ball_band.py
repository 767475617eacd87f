"""Which walls of a band a ball cutter mills, beside what else stands, and what it leaves to others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.mesh.mesh import Mesh
from planner.plan import Pass
from planner.process import Settings
from planner.toolpath.ball import FLUTES, Cut, Milled, ball_passes, outside_row
from planner.toolpath.bands import Band
from planner.toolpath.beside import Stands
from planner.toolpath.holder import stickout_mm
from planner.toolpath.left import Left
from planner.toolpath.motion import Motion
from planner.toolpath.scallop import Row
from planner.toolpath.stretches import IsFree, passes_where

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_UPRIGHT = 1.0 - 1e-9  # z of an axis that does not lean
_LEVEL_MM = 1.0  # of heights: poses within it are asked for at its bottom
_ALONG_HOLDER_MM = (0.0, 20.0, 40.0)
"""Places along a holder at which a leaning one is asked for."""
_WORTH = 0.25  # of the tolerance: metal in inside corners that is worth a word


def ball_milled(band: Band, settings: Settings, stands: Stands | None, others: Sequence[Mesh] = ()) -> Milled | None:
    """The walls of a band by the recipe's ball cutter; None where there is none, or nothing for it.

    others : bodies that stand beside the piece, mm, in the band's frame.
    """
    ball = settings.with_ball_cutter()
    if ball is None or band.surface is None or not band.surface.rows:
        return None
    cut: Cut | None = None
    if stands is not None:
        is_free = _free_of(stands, ball)

        def cut(motion: Motion) -> list[Pass]:
            return passes_where(motion, is_free, ball)

    def excess_of(row: Row) -> float:
        return outside_row(band.region, row) if row.z > band.z_bottom else 0.0

    surface = band.surface.beside(others) if others else band.surface
    return ball_passes(surface, 0.0 if stands is None else -np.inf, excess_of, ball, cut)


def _free_of(stands: Stands, settings: Settings) -> IsFree:
    """Which poses of a cutter are free of what stands: its end, and what of it is above, each asked as of an upright one.

    The holder is asked for at places along its axis: one that is free there as an upright one that reaches as high.
    """
    out = stickout_mm(settings)

    def is_free(tips: Floats, axes: Floats) -> Flags:
        free = np.ones(len(tips), dtype=np.bool_)
        leans = bool((axes[:, 2] < _UPRIGHT).any())
        for along in (0.0, FLUTES * settings.cutter_diameter_mm, *(out + np.array(_ALONG_HOLDER_MM))) if leans else (0.0,):
            there = tips + along * axes
            level = np.floor((there[:, 2] - (out if along >= out else 0.0)) / _LEVEL_MM) * _LEVEL_MM
            for z in np.unique(level).tolist():
                own = level == z
                blocked = stands(z, settings)
                if not blocked.is_empty:
                    shapely.prepare(blocked)
                    free[own] &= ~shapely.contains_xy(blocked, there[own, 0], there[own, 1])
        return free

    return is_free


def steps_of_missed(band: Band, missed: list[float]) -> tuple[tuple[float, MultiPolygon], ...]:
    """The steps at heights that the ball does not reach: those nearer to a row that it missed than to the next."""
    rows = np.unique([row.z for row in band.surface.rows]) if band.surface is not None else np.empty(0)
    gap = float(np.diff(rows).max(initial=0.0))
    return tuple(step for step in band.steps if any(abs(step[0] - z) <= gap + 1e-6 for z in missed))


def fillets(milled: Milled | None, band: Band, settings: Settings) -> list[Left]:
    """What inside corners keep of the ball's shape, where that is worth a word."""
    if milled is None or milled.pushed_mm <= _WORTH * settings.recipe.tolerance_mm:
        return []
    x, y, z = milled.place
    return [Left("fillets", band.z_bottom, band.z_top, f"({x:.1f}, {y:.1f}, {z:.1f})", 0, milled.pushed_mm)]
