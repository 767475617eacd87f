"""Laser power at the start and the end of a bead, on the cold plate and at the edge: rows of set-points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from planner.plan import Pass
from planner.process import Bead, Settings

Floats = NDArray[np.float64]

_STEPS = 2  # of a ramp: shorter than half a millimetre no cell follows
_SHORTEST = 4.0  # ramps: shorter beads have shorter ramps
_LEAST_MM = 1e-3


def ramped(rows: Floats, length_mm: float, settings: Settings) -> Floats:
    """Rows of set-points with the laser's power rising at the start of the bead and falling at its end.

    rows : (n, 5) float, as in `Pass`, lit without a break   length_mm : of the pass
    Over `ramp_mm` at either end power goes in steps from the material's share to the full one, never below what the window
    has. Source: material, `deposition.ramp_mm` and `deposition.ramp_power`.
    """
    facts = settings.material.deposition
    lit = np.flatnonzero(rows[:, 2] > 0.0)
    if settings.ramp_mm <= 0.0 or facts.ramp_power >= 1.0 or not len(lit):
        return rows
    start = float(rows[lit[0], 0])
    end = float(rows[lit[-1] + 1, 0]) if lit[-1] + 1 < len(rows) else length_mm
    ramp = min(settings.ramp_mm, (end - start) / _SHORTEST)
    if ramp < _LEAST_MM:
        return rows
    steps = ramp * np.arange(1, _STEPS + 1) / _STEPS
    begins = np.unique(np.concatenate([rows[:, 0], start + steps, end - steps]))
    begins = begins[np.concatenate([[True], np.diff(begins) > _LEAST_MM])]
    made = rows[np.searchsorted(rows[:, 0], begins + 0.5 * _LEAST_MM, side="right") - 1].copy()
    made[:, 0] = begins
    from_ends = np.minimum(np.floor((begins - start) / (ramp / _STEPS) + 1e-6), np.floor((end - begins) / (ramp / _STEPS) - 1e-6))
    share = facts.ramp_power + (1.0 - facts.ramp_power) * np.clip(from_ends, 0.0, _STEPS) / _STEPS
    on = made[:, 2] > 0.0
    floor = np.minimum(made[:, 2], max(facts.laser_w.min, settings.material.bead.min_power_w))
    made[on, 2] = np.maximum(made[on, 2] * share[on], floor[on])
    return np.asarray(made)


def with_power(bead: Bead, times: float, settings: Settings) -> Bead:
    """The bead with so many times its power, inside the material's window; what the recipe fixes stays."""
    if times == 1.0 or settings.recipe.laser_w is not None:
        return bead
    facts = settings.material.deposition
    least = max(facts.laser_w.min, settings.material.bead.min_power_w)
    return replace(bead, laser_w=min(max(bead.laser_w * times, least), facts.laser_w.max))


def on_cold_plate(passes: list[Pass], settings: Settings) -> list[Pass]:
    """The passes of the layer on the substrate with the power that its cold metal asks for."""
    times = settings.first_layer_power
    if times == 1.0:
        return passes
    facts = settings.material.deposition
    least = max(facts.laser_w.min, settings.material.bead.min_power_w)
    made = []
    for step in passes:
        rows = step.setpoints.copy()
        on = rows[:, 2] > 0.0
        rows[on, 2] = np.clip(rows[on, 2] * times, np.minimum(least, rows[on, 2]), np.maximum(facts.laser_w.max, rows[on, 2]))
        made.append(replace(step, setpoints=rows))
    return made
