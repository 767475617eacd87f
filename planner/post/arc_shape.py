"""Arcs by their bulge, tan(sweep / 4), counter-clockwise > 0: lengths, centres and points. 0 is a straight move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def arc_over_chord(bulge: Floats) -> Floats:
    """(n,) float: length of arcs over that of their chords, 1 for straight moves."""
    half = 2.0 * np.arctan(bulge)
    bent = np.abs(half) > 1e-9
    return np.where(bent, half / np.where(bent, np.sin(half), 1.0), 1.0)


def arc_centres(start: Floats, end: Floats, bulge: Floats) -> Floats:
    """(n, 2) float: centres of arcs between points (n, 2); of straight moves the middle."""
    chord = end - start
    bent = bulge != 0.0
    safe = np.where(bent, bulge, 1.0)
    left = np.column_stack([-chord[:, 1], chord[:, 0]])
    return np.asarray(0.5 * (start + end) + np.where(bent, 0.25 * (1.0 / safe - safe), 0.0)[:, None] * left)


def arc_points(start: Floats, end: Floats, bulge: Floats, share: Floats) -> Floats:
    """(n, 2) float: points at shares (n,) of the lengths of arcs between points (n, 2).

    Well conditioned for flat arcs too: along and across the chord, not about the centre.
    """
    chord = end - start
    sweep = 4.0 * np.arctan(bulge)
    half = np.sin(0.5 * sweep)
    bent = np.abs(half) > 1e-12
    safe = np.where(bent, half, 1.0)
    across = np.where(bent, np.sin(0.5 * share * sweep) * np.sin(0.5 * (1.0 - share) * sweep) / safe, 0.0)
    along = np.where(bent, np.sin(0.5 * share * sweep) * np.cos(0.5 * (1.0 - share) * sweep) / safe, share)
    right = np.column_stack([chord[:, 1], -chord[:, 0]])
    return np.asarray(start + along[:, None] * chord + across[:, None] * right)
