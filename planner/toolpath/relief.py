"""Beads whose height follows the layer's along a pass: by speed and powder, the width kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.process import Bead, Settings
from planner.slicing.regions import LayerRegion
from planner.toolpath.fitting import Stretch
from planner.toolpath.motion import Motion

Floats = NDArray[np.float64]

_CHANGE = 0.04  # of the height: beads are changed when it has risen or fallen by this share
_STEP_MM = 0.4  # between places at which the height is asked: a sixth of a bead's width


@dataclass(frozen=True)
class Relief:
    """What metal the places of a layer take that is not equally high everywhere.

    height_at : (n, 2) float, mm, to (n,) float, mm, the layer's height   overbuild : share of the height to lay more
    extra_mm : to lay more everywhere   made_mm : height that the layer's bead makes
    """

    height_at: Callable[[Floats], Floats]
    overbuild: float
    extra_mm: float
    made_mm: float

    @classmethod
    def of(cls, layer: LayerRegion, bead: Bead, settings: Settings, height_at: Callable[[Floats], Floats]) -> Relief:
        """The relief of a layer whose bead is made for its greatest height, reserve under finished faces included."""
        extra = max(bead.height_mm - layer.height_mm * (1.0 + settings.overbuild), 0.0)
        return cls(height_at, settings.overbuild, extra, bead.height_mm)

    def shares(self, places: Floats) -> Floats:
        """(n,) float   How much of the layer's bead the places take.  places : (n, 2) float, mm"""
        heights = np.asarray(self.height_at(places), dtype=np.float64)
        return (heights * (1.0 + self.overbuild) + self.extra_mm) / self.made_mm

    def along(self, motion: Motion, lit_mm: float, stretches: Sequence[Stretch], settings: Settings) -> list[Stretch]:
        """The beads along a motion, so that none brings less metal than the layer takes where it is laid.

        lit_mm : length of the bead; a closed motion may be run past its start   stretches : the beads of a level layer.
        Raises RecipeError if the material's window has no bead so high.
        """
        arcs = np.linspace(0.0, lit_mm, max(2, int(np.ceil(lit_mm / _STEP_MM)) + 1))
        tips = motion.tip.evaluate(motion.tip.at_arc_length(np.where(arcs > motion.length, arcs - motion.length, arcs)))
        shares = self.shares(tips[:, :2])
        given = np.searchsorted([stretch.at_mm for stretch in stretches], arcs + 1e-9, side="right") - 1
        found: list[Stretch] = []
        first = 0
        for k in range(1, len(arcs)):
            run = shares[first : k + 1]
            is_last = k == len(arcs) - 1
            if not is_last and run.max() <= (1.0 + _CHANGE) * run.min() and given[k] == given[first]:
                continue
            base = stretches[max(int(given[first]), 0)].bead
            most = float(run.max())
            found.append(Stretch(float(arcs[first]), settings.with_area(base, base.area_mm2 * most)))
            first = k
        return found
