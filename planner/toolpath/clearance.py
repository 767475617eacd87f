"""Tilts at which the deposition head stays clear of the plate and of the layer as it stands beside the bead."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray

from planner.collide.reach import HeadShape, PointTree, reach
from planner.slicing.regions import LayerRegion

Floats = NDArray[np.float64]

CLEARANCE_MM = 0.4
"""Between head and metal: what a bead may stand higher than planned is in `_STANDS`."""
_STANDS = (
    1.7  # of a layer's height above its top: crests, what the ends of beads pile up, and a layer that is half too high
)
_PITCH_MM = 1.0
_FACTORS = (1.0, 0.95, 0.9, 0.85, 0.8, 0.7, 0.6, 0.5, 0.35, 0.2, 0.0)
_SAFE_DEG = 30.0  # below it a nozzle's end stands higher over its focus than layers are
_WIDE_MM = 2000.0  # of the plane on which the layers stand: as wide as what they are built on can be
_ENOUGH_MM = 2.0
_KEPT = 4  # layers whose obstacles are kept


def cleared_tilt(
    points: Floats, outward: Floats, tilt_deg: Floats, layer: LayerRegion, head: HeadShape | None = None
) -> Floats:
    """(n,) float, deg   The tilts, less where the head would meet the plate or metal of the same layer.

    points : (n, 2) float, mm, of the outline   outward : (n, 2) float, unit, the way of the tilt   tilt_deg : (n,) float.
    """
    result = np.array(tilt_deg, dtype=np.float64)
    waiting = np.flatnonzero(result > _SAFE_DEG)
    if not len(waiting):
        return result
    tree = _obstacles(layer)
    shape = HeadShape() if head is None else head
    for factor in _FACTORS:
        angle = np.radians(factor * tilt_deg[waiting])[:, None]
        axes = np.hstack([np.sin(angle) * outward[waiting], np.cos(angle)])
        tips = np.column_stack([points[waiting], np.full(len(waiting), layer.z_bottom)])
        found = reach(tips, axes, tree, (_WIDE_MM, _WIDE_MM), shape, clearance_mm=CLEARANCE_MM, enough_mm=_ENOUGH_MM)
        result[waiting] = factor * tilt_deg[waiting]
        waiting = waiting[~found.free]
        if not len(waiting):
            break
    return result


@lru_cache(maxsize=_KEPT)
def _tree_over(outline: bytes, top_mm: float) -> PointTree:
    """Points all over a region at a height."""
    region = shapely.from_wkb(outline)
    low_x, low_y, high_x, high_y = region.bounds
    x, y = np.meshgrid(np.arange(low_x, high_x + _PITCH_MM, _PITCH_MM), np.arange(low_y, high_y + _PITCH_MM, _PITCH_MM))
    shapely.prepare(region)
    inside = shapely.contains_xy(region, x.ravel(), y.ravel())
    flat = np.vstack(
        [
            np.column_stack([x.ravel()[inside], y.ravel()[inside]]),
            shapely.get_coordinates(shapely.segmentize(region.boundary, _PITCH_MM)),
        ]
    )
    return PointTree.over(np.column_stack([flat, np.full(len(flat), top_mm)]))


def _obstacles(layer: LayerRegion) -> PointTree:
    """The layer's metal when its tilted beads are laid."""
    return _tree_over(shapely.to_wkb(layer.region), layer.z_top + _STANDS * layer.height_mm)
