"""Outermost beads run a little into sharp corners, whose tips a round bead would leave empty."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from planner.process import Bead, Settings
from planner.toolpath.fitting import fitted_bead

Floats = NDArray[np.float64]

_VOID = 0.06  # of the bead's width: wider voids at a corner's tip are filled; a tenth is allowed
_BESIDE = 0.06  # of the bead's width: how far the bead may reach over the sides beside the tip for that
_TAPER = 0.5  # of the bead's width: how long before and after the corner the track begins and ends to lean into it


def into_corners(centre: MultiPolygon, bead: Bead, settings: Settings) -> MultiPolygon:
    """The region of the outermost bead's centreline with its sharp corners drawn out along their bisectors.

    centre : outline inset by half the bead's width, mm. A bead whose centre turns at angle 2 h leaves what the narrowest
    bead of the window would still reach: a void (w - w_least) / 2 (1 / sin h - 1) long.
    """
    narrowest = fitted_bead(bead, 0.1 * bead.width_mm, 0.0, settings).width_mm
    parts = []
    for part in shapely.get_parts(shapely.orient_polygons(centre)):
        rings = [_drawn_out(shapely.get_coordinates(ring)[:-1], bead, narrowest) for ring in (part.exterior, *part.interiors)]
        drawn = Polygon(rings[0], rings[1:])
        parts.append(drawn if drawn.is_valid else part)
    return MultiPolygon(parts)


def _drawn_out(ring: Floats, bead: Bead, narrowest_mm: float) -> Floats:
    """A ring with its sharp corners drawn out.  ring : (n, 2) float, mm, the material on its left."""
    sides = np.roll(ring, -1, axis=0) - ring
    lengths = np.linalg.norm(sides, axis=1)
    ahead = sides / np.maximum(lengths, 1e-12)[:, None]
    behind = np.roll(ahead, 1, axis=0)
    turn = np.arctan2(behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0], (behind * ahead).sum(axis=1))
    sine = np.maximum(np.sin(0.5 * (np.pi - turn)), 1e-3)
    void = 0.5 * (bead.width_mm - narrowest_mm) * (1.0 / sine - 1.0)
    out = np.minimum(void - _VOID * bead.width_mm, _BESIDE * bead.width_mm / sine)
    if not (out > 0.0).any():
        return ring
    rows = []
    for k, point in enumerate(ring):
        if not (turn[k] > 0.0 and out[k] > 0.0):
            rows.append(point)
            continue
        bisector = behind[k] - ahead[k]
        rows += [
            point - min(_TAPER * bead.width_mm, 0.4 * lengths[k - 1]) * behind[k],
            point + out[k] * bisector / np.linalg.norm(bisector),
            point + min(_TAPER * bead.width_mm, 0.4 * lengths[k]) * ahead[k],
        ]
    return np.array(rows)
