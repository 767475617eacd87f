"""Places on arcs of the line table by their bulge, tan(sweep / 4), counter-clockwise > 0 in the plane of X and Y; 0: a straight line."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def arc_over_chord(bulge: Floats) -> Floats:
    """(n,) float: length of arcs over that of their chords."""
    half = 2.0 * np.arctan(bulge)
    bent = np.abs(half) > 1e-9
    return np.where(bent, half / np.where(bent, np.sin(half), 1.0), 1.0)


def along_and_across(bulge: float, fraction: float) -> tuple[float, float]:
    """Place at a fraction of an arc's length, in units of its chord: along the chord, and beside it towards the arc's middle."""
    half = 2.0 * math.atan(bulge)
    if abs(half) < 1e-12:
        return fraction, 0.0
    done, left = fraction * half, (1.0 - fraction) * half
    return math.sin(done) * math.cos(left) / math.sin(half), abs(math.sin(done) * math.sin(left) / math.sin(half))


def fraction_of_arc(start: Floats, end: Floats, bulge: float, place: Floats) -> float:
    """How much of an arc is behind a place (2,) on or beside it, 0..1: by its angle at the centre.  start, end : (2,) float"""
    chord = end - start
    left = np.array([-chord[1], chord[0]])
    centre = 0.5 * (start + end) + 0.25 * (1.0 / bulge - bulge) * left
    sweep = 4.0 * math.atan(abs(bulge))
    first, here = start - centre, place - centre
    turned = math.atan2(float(first[0] * here[1] - first[1] * here[0]), float(first @ here)) * math.copysign(1.0, bulge)
    if turned < 0.5 * sweep - math.pi:  # behind the start by more than it is beyond the end
        turned += 2.0 * math.pi
    return min(max(turned / sweep, 0.0), 1.0)
