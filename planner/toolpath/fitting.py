"""Beads of a width that is wanted: power first, then speed, within the material's window; metal for what they stand for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from config.material import Window
from planner.process import Bead, Settings
from planner.toolpath.centreline import MiddleLine, ThinPart

Floats = NDArray[np.float64]

_CHANGE = 0.06  # of the bead's width: a larger change of width begins another stretch
_SHORT = 0.01  # of a bead's metal: less is not worth another speed
_LEAST_EVENED, _MOST_EVENED = 0.8, 1.25  # times the metal of a fitted bead: more would be for what lies elsewhere
_LEAST_SHARE = 0.3  # of a bead's width: the metal of narrower strips is not measured by what lies inside the edge


@dataclass(frozen=True)
class Stretch:
    """at_mm : arc length from which on the bead holds, mm."""

    at_mm: float
    bead: Bead


def widest_mm(bead: Bead, edge_mm: float, settings: Settings) -> float:
    """Up to which width one bead takes the place of two, mm: where two bring no more metal than the strip takes.

    edge_mm : of the width on either side no metal is counted. At least the bead's width, at most the window's.
    """
    most = fitted_bead(bead, 10.0 * bead.width_mm, 0.0, settings).width_mm
    return min(max(bead.width_mm, 2.0 * (bead.step_mm + edge_mm)), most)


def fitted_bead(bead: Bead, width_mm: float, edge_mm: float, settings: Settings) -> Bead:
    """The bead as wide as wanted, as far as recipe and material allow.

    bead : of the layer, whose height the metal keeps   edge_mm : of the width on either side no metal is counted.
    Where nothing is milled and the window's powder does not fill the width, the bead is slower.
    """
    facts, law, recipe = settings.material.deposition, settings.material.bead, settings.recipe
    power, speed = bead.laser_w, bead.speed_mm_s
    if recipe.laser_w is None and law.width_power_exponent:
        least = max(facts.laser_w.min, law.min_power_w)
        asked = power * (width_mm / bead.width_mm) ** (1.0 / law.width_power_exponent)
        power = min(max(asked, least), facts.laser_w.max)
    width = bead.width_mm * (power / bead.laser_w) ** law.width_power_exponent
    if recipe.speed_mm_s is None and law.width_speed_exponent:
        speed = _inside(speed * (width_mm / width) ** (1.0 / law.width_speed_exponent), facts.speed_mm_s)
        width *= (speed / bead.speed_mm_s) ** law.width_speed_exponent
    strip = max(min(width_mm, width) - 2.0 * edge_mm, _LEAST_SHARE * width)
    per_area = settings.material.density_g_mm3 * speed * 60.0 / law.catch_efficiency
    powder = bead.powder_g_min
    if recipe.powder_g_min is None:
        powder = _inside(strip * bead.height_mm * per_area, facts.powder_g_min)
    made = Bead(speed, power, powder, width, powder / per_area, bead.step_mm)
    wanted = strip * bead.height_mm
    if settings.is_milled or recipe.speed_mm_s is not None or made.area_mm2 >= wanted * (1.0 - _SHORT):
        return made
    return settings.with_area(made, min(wanted, made.area_mm2 * speed / facts.speed_mm_s.min))


def scaled_bead(bead: Bead, times: float, settings: Settings, *, flow_stays: bool = False) -> Bead:
    """The bead with so many times its metal and its width, or with what of it the window has: by speed, then by powder.

    flow_stays : not by powder, which follows in seconds: for changes within a pass. What the recipe fixes stays.
    """
    if abs(times - 1.0) <= _SHORT:
        return bead
    facts, recipe = settings.material.deposition, settings.recipe
    if flow_stays:
        if recipe.speed_mm_s is not None:
            return bead
        times = min(max(times, bead.speed_mm_s / facts.speed_mm_s.max), bead.speed_mm_s / facts.speed_mm_s.min)
    slowest = bead.speed_mm_s if recipe.speed_mm_s is not None else facts.speed_mm_s.min
    powder = bead.powder_g_min if recipe.powder_g_min is not None else facts.powder_g_min.max
    most = (bead.speed_mm_s / slowest) * (powder / bead.powder_g_min)
    made = settings.with_area(bead, min(times, most) * bead.area_mm2)
    return replace(made, width_mm=bead.width_mm)


def fitted_stretches(line: MiddleLine, bead: Bead, edge_mm: float, settings: Settings) -> list[Stretch]:
    """The beads along a middle line: one where the width changes little, else a new one at every step of it."""
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line.points, axis=0), axis=1))])
    middles = 0.5 * (line.widths_mm[1:] + line.widths_mm[:-1])
    first, found = 0, []
    for k in range(1, len(middles) + 1):
        if k < len(middles) and np.ptp(middles[first : k + 1]) <= _CHANGE * bead.width_mm:
            continue
        wide = float(np.average(middles[first:k], weights=np.diff(at[first : k + 1])))
        found.append(Stretch(float(at[first]), fitted_bead(bead, wide, edge_mm, settings)))
        first = k
    return found


def evened(
    fitted: list[list[Stretch]], part: ThinPart, area_mm2: float, bead: Bead, settings: Settings
) -> list[list[Stretch]]:
    """The beads along the middles of a thin part with the metal that an area takes: ends and corners of it are theirs too.

    fitted : per middle line   bead : of the layer, whose height the metal keeps
    """
    metal = 0.0
    for line, stretches in zip(part.lines, fitted, strict=True):
        ends = [*(stretch.at_mm for stretch in stretches[1:]), line.length_mm]
        metal += sum((end - stretch.at_mm) * stretch.bead.area_mm2 for stretch, end in zip(stretches, ends, strict=True))
    if metal <= 0.0 or area_mm2 <= 0.0:
        return fitted
    times = min(max(area_mm2 * bead.height_mm / metal, _LEAST_EVENED), _MOST_EVENED)
    return [
        [Stretch(stretch.at_mm, scaled_bead(stretch.bead, times, settings)) for stretch in stretches] for stretches in fitted
    ]


def _inside(value: float, window: Window) -> float:
    return min(max(value, window.min), window.max)
