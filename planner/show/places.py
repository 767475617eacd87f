"""Where a layer lies: level ones by their heights, tilted ones in the coordinates of their own bottom plane."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from planner.plan import Layer
from planner.slicing.section import plane_frame

Floats = NDArray[np.float64]

_LEVEL = 1e-9


def is_level(layer: Layer) -> bool:
    """Whether both bounding planes are level, so that heights say where the layer is."""
    return bool(min(layer.bottom[5], layer.top[5]) > 1.0 - _LEVEL)


def flat(layer: Layer, points: Floats) -> Floats:
    """Points of a layer as they are drawn: x and y of a level one, else along the bottom plane's normal into that plane.

    points : (n, 3) float, mm, build frame.  Returns (n, 2) float, mm, in the frame of `planner.slicing.section.plane_frame`.
    """
    if is_level(layer):
        return np.asarray(points[:, :2])
    frame = plane_frame(layer.bottom)
    return np.asarray((points - frame[0]) @ frame[1:3].T)


def tilt_deg(layer: Layer) -> float:
    """Angle of the bottom plane from level, deg."""
    return math.degrees(math.acos(min(max(float(layer.bottom[5]), -1.0), 1.0)))


def thickness(layer: Layer) -> tuple[float, float]:
    """Least and greatest thickness of a layer, mm: what the plan says, else the distance of its planes at the bottom's point."""
    if layer.thickness_mm[1] > 0.0:
        return layer.thickness_mm
    apart = float((layer.top[:3] - layer.bottom[:3]) @ layer.bottom[3:])
    return apart, apart


def where(layer: Layer) -> str:
    """A few words: heights of a level layer; point, tilt and thickness of another one."""
    if is_level(layer):
        return f"z {layer.bottom[2]:.2f} … {layer.top[2]:.2f} mm"
    x, y, z = (np.round(layer.bottom[:3], 1) + 0.0).tolist()
    least, greatest = thickness(layer)
    thick = f"{least:.2f} … {greatest:.2f}" if greatest - least >= 5e-3 else f"{least:.2f}"
    return f"at ({x:.1f}, {y:.1f}, {z:.1f}), {tilt_deg(layer):.1f}° from level, {thick} mm thick"
