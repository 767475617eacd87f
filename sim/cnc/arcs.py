"""G2 and G3: from the arc's words to straight segments within a chord tolerance."""

from __future__ import annotations

import math

from sim.cnc.codes import ARC_RADIUS, INVALID_TARGET, GcodeError

RADIUS_ERROR_MM = 0.005  # grbl: largest difference of start and end radius taken without a relative test
RADIUS_ERROR_LIMIT_MM = 0.5
ANGLE_EPS = 5e-7  # rad, grbl: start and end on one ray mean a full circle


def centre_from_radius(x: float, y: float, radius: float, clockwise: bool) -> tuple[float, float]:
    """Centre, from the start, of an arc to (x, y), from the start, with R (negative: the longer way). Source: grbl 1.1 gcode.c.

    Raises GcodeError 34 when no such circle exists, 33 when start and end are the same.
    """
    if x == 0.0 and y == 0.0:
        raise GcodeError(INVALID_TARGET)
    height = 4.0 * radius * radius - x * x - y * y
    if height < 0.0:
        raise GcodeError(ARC_RADIUS)
    h = -math.sqrt(height) / math.hypot(x, y)
    if not clockwise:
        h = -h
    if radius < 0.0:
        h = -h
    return 0.5 * (x - y * h), 0.5 * (y + x * h)


def segments(
    start: list[float], end: list[float], centre: tuple[float, float], plane: tuple[int, int], clockwise: bool, tolerance_mm: float
) -> list[list[float]]:
    """Points of the arc about start + centre in `plane` (two axis indices), without the start; other axes go along evenly.

    tolerance_mm : how far the chords between them may leave the arc

    Raises GcodeError 33 when the end is not on the circle.
    """
    i, j = plane
    cx, cy = start[i] + centre[0], start[j] + centre[1]
    radius = math.hypot(*centre)
    error = abs(math.hypot(end[i] - cx, end[j] - cy) - radius)
    if radius <= 0.0 or error > RADIUS_ERROR_LIMIT_MM or (error > RADIUS_ERROR_MM and error > 0.001 * radius):
        raise GcodeError(INVALID_TARGET)
    first = math.atan2(start[j] - cy, start[i] - cx)
    sweep = math.atan2(end[j] - cy, end[i] - cx) - first
    if clockwise and sweep >= -ANGLE_EPS:
        sweep -= 2 * math.pi
    elif not clockwise and sweep <= ANGLE_EPS:
        sweep += 2 * math.pi
    if abs(sweep) > 2 * math.pi + ANGLE_EPS:
        sweep -= math.copysign(2 * math.pi, sweep)
    step = 2.0 * math.acos(max(1.0 - tolerance_mm / radius, 0.0))
    count = max(1, math.ceil(abs(sweep) / step))
    points = []
    for k in range(1, count):
        share = k / count
        point = [a + (b - a) * share for a, b in zip(start, end, strict=True)]
        point[i] = cx + radius * math.cos(first + sweep * share)
        point[j] = cy + radius * math.sin(first + sweep * share)
        points.append(point)
    return [*points, end]
