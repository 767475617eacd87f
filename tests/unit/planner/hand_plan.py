"""Small Plans made by hand for the tests of posting, whose every length and angle is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.plan import Layer, Operation, Pass, Plan, Process

UP = np.array([0.0, 0.0, 1.0])
FEED_MM_S, LASER_W, POWDER, GAS = 12.0, 1200.0, 12.0, 15.0
HEIGHT_MM, RADIUS_MM, LEAD_MM = 0.8, 20.0, 2.0
CLEAR_MM = 6.0
LEAN_DEG = 20.0
FOOT_MM = 1.4  # of a cone over the plate: the leaning cutter's edge stays out of it
WAYS = ((-10.0, -4.0), (-10.0, 0.0), (-10.0, 4.0))


def circle(radius: float, z: float, points: int = 60) -> Curve:
    turn = np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)
    return interpolate(np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.full(points, z)]), closed=True)


def link(*points: Sequence[float], axis: ArrayLike = UP, rapid: bool = True, feed: float = 50.0) -> Pass:
    rows = np.array([[0.0, feed, 0.0, 0.0, 0.0]])
    return Pass(
        Curve.from_polyline(np.array(points, dtype=float)), np.array(axis, dtype=float), rows, is_link=True, rapid=rapid
    )


def bead(tip: Curve, lead: float = LEAD_MM, powder: float = POWDER) -> Pass:
    """A deposited pass with the laser off for the lead on both sides."""
    rows = [
        [0.0, FEED_MM_S, 0.0, powder, GAS],
        [lead, FEED_MM_S, LASER_W, powder, GAS],
        [tip.length - lead, FEED_MM_S, 0.0, powder, GAS],
    ]
    return Pass(tip, UP, np.array(rows))


def contour_operation(layer: int, interpass_s: float = 0.0) -> Operation:
    z = HEIGHT_MM * layer
    low, high = (RADIUS_MM, 0.0, z), (RADIUS_MM, 0.0, z + CLEAR_MM)
    passes = (link(high, low), bead(circle(RADIUS_MM, z)), link(low, high))
    return Operation(Process.DEPOSIT_CONTOUR, layer, passes, interpass_s=interpass_s, bead_width_mm=2.0)


def oval(long: float = RADIUS_MM, short: float = 0.6 * RADIUS_MM, z: float = 0.0, points: int = 60) -> Curve:
    """An ellipse: round all the way and nowhere a circle."""
    turn = np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)
    return interpolate(np.column_stack([long * np.cos(turn), short * np.sin(turn), np.full(points, z)]), closed=True)


def oval_operation(layer: int) -> Operation:
    """A contour on an ellipse, with its lead-in and lead-out."""
    z = HEIGHT_MM * layer
    low, high = (RADIUS_MM, 0.0, z), (RADIUS_MM, 0.0, z + CLEAR_MM)
    passes = (link(high, low), bead(oval(z=z)), link(low, high))
    return Operation(Process.DEPOSIT_CONTOUR, layer, passes, bead_width_mm=2.0)


def fill_operation(layer: int) -> Operation:
    z = HEIGHT_MM * layer
    here = (RADIUS_MM, 0.0, z + CLEAR_MM)
    passes = []
    for x, y in WAYS:
        start, end = (x, y, z), (-x, y, z)
        passes += [link(here, (x, y, z + CLEAR_MM), start), bead(Curve.from_polyline(np.array([start, end])))]
        here = (-x, y, z + CLEAR_MM)
        passes.append(link(end, here))
    return Operation(Process.DEPOSIT_FILL, layer, tuple(passes))


def cone_axis(tip: Curve, lean_deg: float) -> Curve:
    """Axis that leans outward by the same angle all round a circle about z: on the circle's own parameter."""
    radius = float(np.linalg.norm(tip.control_points[0, :2]))
    lean = np.deg2rad(lean_deg)
    vectors = np.column_stack(
        [tip.control_points[:, :2] / radius * np.sin(lean), np.full(len(tip.control_points), np.cos(lean))]
    )
    return Curve(tip.degree, tip.knots, vectors)


def cone_operation(
    layer: int, radius: float = 24.0, lean_deg: float = LEAN_DEG, turns: int = 1, diameter: float = 8.0
) -> Operation:
    """Side milling round a cone with the axis on its rulings, once or several times round, reached along the axis."""
    tip = circle(radius, FOOT_MM)
    axis = cone_axis(tip, lean_deg)
    first = axis.evaluate([axis.domain[0]])[0]
    first = first / np.linalg.norm(first)
    start = np.array([radius, 0.0, FOOT_MM])
    far = start + 12.0 * first
    passes: list[Pass] = []
    for _ in range(turns):
        passes += [
            link(far, start + 5.0 * first, axis=first),
            link(start + 5.0 * first, start, axis=first, rapid=False),
        ]
        passes += [Pass(tip, axis, np.array([[0.0, 5.0, 0.0, 0.0, 0.0]])), link(start, far, axis=first)]
    return Operation(Process.MILL_SIDE, layer, tuple(passes), cutter_diameter_mm=diameter, spindle_rpm=3580.0)


def plan_of(*layers: Sequence[Operation], half_mm: float = RADIUS_MM) -> Plan:
    """A Plan of the operations of each layer."""
    bounds = np.array([[-half_mm, -half_mm, 0.0], [half_mm, half_mm, HEIGHT_MM * len(layers)]])
    made = []
    for index, operations in enumerate(layers):
        bottom: NDArray[np.float64] = np.array([0.0, 0.0, HEIGHT_MM * index, 0.0, 0.0, 1.0])
        top = bottom + np.array([0.0, 0.0, HEIGHT_MM, 0.0, 0.0, 0.0])
        made.append(
            Layer(index, bottom, top, (), (), 0.0, 0.0, tuple(replace(item, layer=index) for item in operations))
        )
    return Plan("by hand", "0" * 64, "", "316L", "hybrid", 0.1, np.eye(4), bounds, tuple(made))


def hybrid_plan() -> Plan:
    """Two deposited layers, each a contour and three ways, then a cone milled round them."""
    return plan_of(
        [contour_operation(0), fill_operation(0)], [contour_operation(1), fill_operation(1), cone_operation(1)]
    )
