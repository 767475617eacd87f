"""Deposited contours: beads at constant distances inside the boundary, with lead-in, overlap and lead-out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.nurbs.offset import inset
from planner.nurbs.rings import curves_from_region
from planner.plan import Pass
from planner.process import Bead, Settings
from planner.toolpath.corners import into_corners
from planner.toolpath.fitting import Stretch, scaled_bead
from planner.toolpath.motion import Motion, joined, lifted, process_pass, straight
from planner.toolpath.ramps import ramped, with_power
from planner.toolpath.relief import Relief
from planner.toolpath.tilt import GOLDEN

Floats = NDArray[np.float64]

PATH_TOLERANCE_MM = 2e-3  # of toolpaths from the exact offset: a fifth of the machine's chord tolerance
_START_SAMPLES = 180  # round a loop: two degrees are near enough to spread starts
_LEAST_MM = 1e-3  # of a bead before another begins
_OVERLAP = 0.15  # of the bead's width by which a closed bead runs past its start


def bead_row(at_mm: float, bead: Bead, gas_l_min: float, laser_on: bool) -> list[float]:
    """One row of set-points: arc length mm, mm/s, W, g/min, L/min."""
    return [at_mm, bead.speed_mm_s, bead.laser_w if laser_on else 0.0, bead.powder_g_min, gas_l_min]


def edge_mm(bead: Bead, settings: Settings) -> float:
    """Width of the outermost strip of a layer, in which a lone track is lower than the layer, mm.

    Where walls are milled, that strip lies outside the stock allowance, which thus has the layer's full height; a part
    that is only deposited keeps its outline, and the strip is made up for by hatch nearer to the contour.
    """
    return 0.5 * (bead.width_mm - bead.step_mm) if settings.is_milled else 0.0


def contour_passes(
    grown: MultiPolygon,
    z: float,
    layer: int,
    bead: Bead,
    settings: Settings,
    relief: Relief | None = None,
    area_mm2: float | None = None,
) -> list[Pass]:
    """The contours of one layer, outermost first.

    grown : region to fill, allowance included, mm   z : of the surface that receives the beads
    relief : of a layer that is not equally high everywhere   area_mm2 : that their metal is for; None: a step's width each.
    Of milled walls no contour brings less than that.
    The first bead's centre runs half a width inside the boundary, a little less in sharp corners, each further one a step
    inside the last.
    """
    loops = []
    for number in range(settings.recipe.contours):
        centre = inset(grown, 0.5 * bead.width_mm + number * bead.step_mm)
        if number == 0:
            centre = into_corners(centre, bead, settings)
        for ring in curves_from_region(centre, PATH_TOLERANCE_MM):
            loops.append((spread_start(lifted(ring.curve, z), layer + number), number == 0))
    lit = sum(loop.length + overlap_mm(loop, bead) for loop, _ in loops)
    times = 1.0 if area_mm2 is None or not lit else area_mm2 / (lit * bead.step_mm)
    made = scaled_bead(bead, max(times, 1.0) if settings.is_milled else times, settings)
    edge = with_power(made, settings.edge_power, settings)
    return [closed_bead(loop, edge if is_outermost else made, settings, relief=relief) for loop, is_outermost in loops]


def overlap_mm(loop: Motion, bead: Bead) -> float:
    """By how much a closed bead runs past its start, mm."""
    return min(_OVERLAP * bead.width_mm, 0.2 * loop.length)


def spread_start(loop: Motion, number: int) -> Motion:
    """A closed motion begun so many golden shares of a round past its point with the largest x."""
    start = (_rightmost(loop) / loop.length + GOLDEN * number) % 1.0
    return loop.started_at(start * loop.length)


def _rightmost(loop: Motion) -> float:
    """Arc length of the loop's point with the largest x: where starts are counted from, whatever the curve's own start."""
    arcs = np.linspace(0.0, loop.length, _START_SAMPLES, endpoint=False)
    points = loop.tip.evaluate(loop.tip.at_arc_length(arcs))
    return float(arcs[int(np.argmax(np.round(points[:, 0], 3)))])


def closed_bead(
    loop: Motion, bead: Bead, settings: Settings, stretches: Sequence[Stretch] = (), relief: Relief | None = None
) -> Pass:
    """A bead all the way round: tangential lead-in, the loop, a little overlap, lead-out along the loop.

    stretches : along the loop, where the bead changes   relief : of the layer, where it is not equally high everywhere.
    """
    facts = settings.material.deposition
    length = loop.length
    overlap = overlap_mm(loop, bead)
    tail = min(overlap + facts.lead_out_mm, 0.9 * length)
    beads = stretches or [Stretch(0.0, bead)]
    if relief is not None:
        beads = relief.along(loop, length + overlap, beads, settings)
    return _with_leads(loop, [loop, loop.from_arc(tail)[0]], length + overlap, beads, settings)


def open_bead(
    line: Motion, bead: Bead, settings: Settings, stretches: Sequence[Stretch] = (), relief: Relief | None = None
) -> Pass:
    """A bead from end to end, led in and out along its tangents.

    stretches : where the bead changes along it   relief : of the layer, where it is not equally high everywhere.
    """
    pieces = [line]
    if settings.material.deposition.lead_out_mm > 0.0:
        end = line.ends()[2]
        beyond = end + settings.material.deposition.lead_out_mm * line.tangent(at_end=True)
        pieces.append(straight([end, beyond], line.ends()[3]))
    beads = stretches or [Stretch(0.0, bead)]
    if relief is not None:
        beads = relief.along(line, line.length, beads, settings)
    return _with_leads(line, pieces, line.length, beads, settings)


def straight_bead(start: Floats, end: Floats, bead: Bead, settings: Settings, relief: Relief | None = None) -> Pass:
    """A straight bead, led in and out along its own line: one line in all.

    start, end : (3,) float, mm   relief : of the layer, where it is not equally high everywhere.
    """
    facts = settings.material.deposition
    gas = facts.shield_gas_l_min.usual
    lit = float(np.linalg.norm(end - start))
    along = (end - start) / lit
    beads = [Stretch(0.0, bead)]
    if relief is not None:
        beads = relief.along(straight([start, end]), lit, beads, settings)
    rows = [bead_row(facts.lead_in_mm + stretch.at_mm, stretch.bead, gas, True) for stretch in beads]
    if facts.lead_in_mm > 0.0:
        rows.insert(0, bead_row(0.0, beads[0].bead, gas, False))
    if facts.lead_out_mm > 0.0:
        rows.append(bead_row(facts.lead_in_mm + lit, beads[-1].bead, gas, False))
    line = straight([start - facts.lead_in_mm * along, end + facts.lead_out_mm * along])
    return process_pass(line, ramped(np.array(rows), line.length, settings))


def _with_leads(
    first: Motion, pieces: list[Motion], lit_mm: float, stretches: Sequence[Stretch], settings: Settings
) -> Pass:
    """The pass of a tangential lead-in and the pieces, with the laser on for lit_mm from the end of the lead-in."""
    facts = settings.material.deposition
    gas = facts.shield_gas_l_min.usual
    lead = facts.lead_in_mm
    rows = [
        bead_row(lead + stretch.at_mm, stretch.bead, gas, True)
        for stretch in stretches
        if stretch.at_mm < lit_mm - _LEAST_MM
    ]
    if lead > 0.0:
        start, axis, _, _ = first.ends()
        pieces = [straight([start - lead * first.tangent(), start], axis), *pieces]
        rows.insert(0, bead_row(0.0, stretches[0].bead, gas, False))
    whole = joined(pieces)
    if whole.length > lead + lit_mm + 1e-6:
        rows.append(bead_row(lead + lit_mm, stretches[-1].bead, gas, False))
    return process_pass(whole, ramped(np.array(rows), whole.length, settings))
