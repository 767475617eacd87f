"""Passes run with another tool axis than planned: stations along a pass, and the pass with axes led smoothly over them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from config.cell import Tool
from planner.kinematics.chain import Floats
from planner.nurbs.curve import Curve
from planner.post.pass_curve import PassCurve

_DEGREE = 3
_LEAST_STATIONS = 4
_FINE_MM = 0.1  # between nodes of a ball cutter's moved tip: on a curve of 10 mm radius its chords are 0.1 um off


@dataclass(frozen=True)
class Stations:
    """Places along a pass at which an axis is chosen.

    knots : of a cubic B-spline over the pass's own domain   parameter, arc_mm : (n,) float, of its control points (Greville abscissae)
    """

    knots: Floats
    parameter: Floats
    arc_mm: Floats

    @classmethod
    def along(cls, curve: PassCurve, pitch_mm: float) -> Stations:
        """Evenly over the arc length, about a pitch apart, ends included; at least four."""
        spans = max(round(curve.length_mm / pitch_mm), _LEAST_STATIONS - _DEGREE)
        low, high = curve.source.tip.domain
        breaks = curve.at_arc_length(np.linspace(0.0, curve.length_mm, spans + 1))
        breaks[0], breaks[-1] = low, high
        knots = np.concatenate([np.full(_DEGREE, low), breaks, np.full(_DEGREE, high)])
        windows = np.lib.stride_tricks.sliding_window_view(knots[1:-1], _DEGREE)
        parameter = np.clip(windows.mean(axis=1), low, high)
        return cls(knots, parameter, curve.arc_length(parameter))


def leaned_curve(curve: PassCurve, stations: Stations, axes: Floats, placed: Floats, tool: Tool) -> PassCurve:
    """The pass with the axes (n, 3), unit vectors of the table frame, at its stations, as a cubic B-spline over them.

    placed : (4, 4) float, table from build
    The spline varies no more than the axes do (variation diminishing, The NURBS Book 3.2); it begins and ends on the first and last.
    The tip stays where it is, but for a ball cutter, whose centre stays: its tip is led on a fine polyline.
    """
    inside = axes @ placed[:3, :3]
    axis = Curve(_DEGREE, stations.knots, inside)
    source = curve.source
    if tool.kind == "ball_mill":
        return _about_centre(curve, axis, placed, 0.5 * tool.diameter_mm)
    return PassCurve(replace(source, axis=axis), placed, curve.place)


def _about_centre(curve: PassCurve, axis: Curve, placed: Floats, radius_mm: float) -> PassCurve:
    """The pass of a ball cutter about the same centres with another axis."""
    count = max(int(np.ceil(curve.length_mm / _FINE_MM)), 8) + 1
    arcs = np.union1d(np.linspace(0.0, curve.length_mm, count), np.minimum(curve.set_point_arcs, curve.length_mm))
    at = curve.at_arc_length(arcs)
    new = axis.evaluate(at)
    new /= np.linalg.norm(new, axis=1, keepdims=True)
    old = curve.axes(at) @ placed[:3, :3]
    tips = curve.source.tip.evaluate(at) + radius_mm * (old - new)
    moves = np.append(True, np.linalg.norm(np.diff(tips, axis=0), axis=1) > 1e-9)
    tips, new, arcs = tips[moves], new[moves], arcs[moves]
    tip = Curve.from_polyline(tips)
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(tips, axis=0), axis=1))])
    setpoints = np.array(curve.source.setpoints)
    setpoints[:, 0] = np.interp(setpoints[:, 0], arcs, reached)
    source = replace(curve.source, tip=tip, axis=Curve(1, tip.knots, new), setpoints=setpoints)
    return PassCurve(source, placed, curve.place)


def lean_rate_deg_mm(curve: PassCurve, pitch_mm: float = 0.5) -> float:
    """The most that the axis turns per mm of the pass, deg/mm, over steps of about the pitch."""
    count = max(int(np.ceil(curve.length_mm / pitch_mm)), 2) + 1
    arcs = np.linspace(0.0, curve.length_mm, count)
    axes = curve.axes(curve.at_arc_length(arcs))
    turn = np.rad2deg(2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(np.diff(axes, axis=0), axis=1), 0.0, 1.0)))
    return float((turn / np.maximum(np.diff(arcs), 1e-9)).max())
