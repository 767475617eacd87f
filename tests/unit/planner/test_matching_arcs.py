"""Contours with exact arcs are joined like others: their arcs as cubics within rounding of the circle."""

from __future__ import annotations

import numpy as np

from planner.matching.unweighted import short_cubics
from planner.nurbs.fit import interpolate


def slot(half_mm: float, radius_mm: float, per_end: int) -> np.ndarray:
    """Points round a slot: two half circles and the lines between them, mm."""
    turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, per_end)
    right = np.column_stack([half_mm + radius_mm * np.cos(turn), radius_mm * np.sin(turn)])
    return np.vstack([right, -right])


def test_a_slot_of_arcs_and_lines_keeps_its_shape_within_a_billionth_of_its_radius() -> None:
    exact = interpolate(slot(10.0, 4.0, 33), closed=True, arc_tolerance_mm=1e-6)
    assert exact.weights is not None
    plain = short_cubics(exact)
    assert plain.weights is None and plain.degree == 3
    points = plain.evaluate(np.linspace(0.0, 1.0, 5001))
    x, y = np.abs(points[:, 0]) - 10.0, points[:, 1]
    away = np.where(x > 0.0, np.hypot(x, y) - 4.0, np.abs(y) - 4.0)
    assert np.abs(away).max() < 1e-8
    assert abs(plain.length - exact.length) < 1e-6
    along = plain.derivatives(plain.breaks[1:-1], 1, "left")[1], plain.derivatives(plain.breaks[1:-1], 1)[1]
    unit = [way / np.linalg.norm(way, axis=1)[:, None] for way in along]
    assert np.abs(unit[0] - unit[1]).max() < 1e-5
