"""A stretch of a pass in workpiece coordinates: as NURBS where the control takes them, else as few straight moves of tip and axis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.nurbs.curve import Curve
from planner.post.linearise import angle_between_deg
from planner.post.pass_curve import PassCurve

Floats = NDArray[np.float64]

_LINE_SHARE = 0.8  # of the tolerances, for straight moves; words rounded take of the rest
_WEIGHT_SHARE = 0.1  # of the tip tolerance: what weights rounded to the control's step may move the curve
_WEIGHT_TRIALS = 30_000  # numbers that all weights are multiplied by to bring them near to the control's step
_SAME_KNOT = 1e-9  # of the domain: knots of tip and axis nearer than this are one
_SAME_CURVE = 1e-7  # mm: how far knots that go may move the curve; the numbers written have 1e-6
_SAME_PLACE = 1e-6  # of the domain: a cut nearer to a knot than this is made there
_PROBES = (0.25, 0.5, 0.75)  # of a move, where its axis is compared with the pass
_MAX_HALVINGS = 20


@dataclass(frozen=True)
class Control:
    """What a five-axis control takes.

    degrees : of its NURBS, none: straight moves only   takes_axis_splines : the axis may follow a NURBS on the same knots
    weight_step, weight_max : of weights   has_unit_start : the first pole has weight 1   decimals : of positions
    nurbs_unless_told : they go out as such where the cell file does not say   takes_machine_moves : positions of the axes themselves
    tells_rotary : rotary positions say how the tool stands, so that straight moves end where those of the tape do
    """

    dialect: str
    degrees: tuple[int, ...] = ()
    takes_axis_splines: bool = False
    weight_step: float = 0.0
    weight_max: float = 1.0
    has_unit_start: bool = False
    decimals: int = 4
    nurbs_unless_told: bool = True
    takes_machine_moves: bool = True
    tells_rotary: bool = False

    def fitted(self, takes_nurbs: bool | None) -> Control:
        """What it takes in a cell that says whether NURBS go (none: it does not say)."""
        goes = self.nurbs_unless_told if takes_nurbs is None else takes_nurbs
        return self if goes or not self.degrees else replace(self, degrees=(), takes_axis_splines=False)


@dataclass(frozen=True)
class Spline:
    """One NURBS, clamped, whose inner knots have less than full multiplicity: no corners.

    knots : (n + degree + 1,) float   poles : (n, 3) float, mm, workpiece   axes : (n, 3) float, control vectors of the axis, direction only
    weights : (n,) float   is_axis_constant : all axes are the same unit vector
    """

    degree: int
    knots: Floats
    poles: Floats
    axes: Floats
    weights: Floats
    is_axis_constant: bool


@dataclass(frozen=True)
class Frame:
    """From the build frame to the workpiece coordinates of the control (table frame less the work offset).

    rotation : (3, 3) float   shift : (3,) float, mm
    """

    rotation: Floats
    shift: Floats

    @property
    def matrix(self) -> Floats:
        """(4, 4) float, workpiece from build."""
        result = np.eye(4)
        result[:3, :3], result[:3, 3] = self.rotation, self.shift
        return result

    def points(self, values: Floats) -> Floats:
        """(n, 3) points of the build frame in workpiece coordinates, mm."""
        return np.asarray(values @ self.rotation.T + self.shift)

    def vectors(self, values: Floats) -> Floats:
        """(n, 3) directions of the build frame in workpiece coordinates."""
        return np.asarray(values @ self.rotation.T)

    def back(self, values: Floats) -> Floats:
        """(n, 3) points of the workpiece coordinates in the build frame, mm."""
        return np.asarray((values - self.shift) @ self.rotation)


def splines(
    curve: PassCurve, start: float, end: float, frame: Frame, control: Control, tip_tolerance_mm: float
) -> list[Spline]:
    """The pass between two parameters as NURBS that are that stretch exactly; none if the control does not take it so.

    Source: Piegl & Tiller 5.2 (knot insertion), 5.5 (degree elevation). The axis has only a direction: with the tip's weights w its
    control vectors a become a v / w (v: its own weights), for then numerators, and so directions, are the same at every parameter.
    """
    tip, axis = curve.source.tip, curve.source.axis
    degree = max(tip.degree, axis.degree if isinstance(axis, Curve) else 0)
    if tip.degree == 1 or degree not in control.degrees or (isinstance(axis, Curve) and not control.takes_axis_splines):
        return []
    tip = _lean(_between(tip, start, end).with_degree(degree))
    if not isinstance(axis, Curve):
        unit = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
        found = []
        for part in _simple_parts(tip, _corners(tip)):
            axes = frame.vectors(np.tile(unit, (len(part.control_points), 1)))
            found.append(Spline(degree, part.knots, frame.points(part.control_points), axes, _weights(part), True))
    else:
        axis = _lean(_between(axis, start, end).with_degree(degree))
        axis = _snapped(axis, tip)
        cuts = np.union1d(_corners(tip), _corners(axis))
        pairs = zip(_simple_parts(tip, cuts), _simple_parts(axis, cuts), strict=True)
        found = [_joined(first, second, frame) for first, second in pairs]
        if any(np.ptp(item.weights) > 0.0 for item in found):
            return []
    rounded = [_with_steps(item, control) for item in found]
    size = max(float(np.ptp(item.poles, axis=0).max()) for item in found)
    off = max(error for _, error in rounded)
    return [item for item, _ in rounded] if off * size <= _WEIGHT_SHARE * tip_tolerance_mm else []


def samples(curve: PassCurve, tip_tolerance_mm: float) -> Floats:
    """(n,) parameters of a whole pass between which the tip may go straight."""
    return curve.first_parameters(_LINE_SHARE * tip_tolerance_mm)[0]


def straight(curve: PassCurve, parameters: Floats, start: float, end: float, axis_tolerance_deg: float) -> Floats:
    """(n,) parameters from start to end between which tip and axis may go straight (the axis turning in a plane).

    parameters : as `samples` gives them
    """
    slack = _SAME_KNOT * (end - start)
    inner = parameters[(parameters > start + slack) & (parameters < end - slack)]
    found = np.concatenate([[start], inner, [end]])
    if curve.has_constant_axis:
        return found
    for _ in range(_MAX_HALVINGS):
        axes = curve.axes(found)
        wide = np.zeros(len(found) - 1, dtype=np.bool_)
        for share in _PROBES:
            at = found[:-1] + share * np.diff(found)
            between = (1.0 - share) * axes[:-1] + share * axes[1:]
            between /= np.maximum(np.linalg.norm(between, axis=1, keepdims=True), 1e-12)
            wide |= angle_between_deg(between, curve.axes(at)) > _LINE_SHARE * axis_tolerance_deg
        if not wide.any():
            break
        found = np.sort(np.concatenate([found, 0.5 * (found[:-1] + found[1:])[wide]]))
    return found


def _between(curve: Curve, start: float, end: float) -> Curve:
    low, high = curve.domain
    slack = _SAME_PLACE * (high - low)
    start, end = (
        float(near if abs(near - at) <= slack else at) for at in (start, end) for near in [_nearest(curve, at)]
    )
    cuts = [value for value in (start, end) if low + slack < value < high - slack]
    if not cuts:
        return curve
    parts = curve.split(cuts)
    return parts[1] if start > low + slack else parts[0]


def _lean(curve: Curve) -> Curve:
    """The curve without knots that it does not need: joints of pieces that run smoothly into each other."""
    if curve.weights is not None or _corners(curve).size == 0:
        return curve
    return curve.without_knots(_SAME_CURVE)[0]


def _nearest(curve: Curve, at: float) -> float:
    return float(curve.breaks[np.abs(curve.breaks - at).argmin()])


def _corners(curve: Curve) -> Floats:
    """Inner knots of full multiplicity, where the curve may have a corner."""
    values, counts = np.unique(curve.knots, return_counts=True)
    return np.asarray(values[1:-1][counts[1:-1] >= curve.degree])


def _simple_parts(curve: Curve, cuts: Floats) -> tuple[Curve, ...]:
    return curve.split(cuts) if cuts.size else (curve,)


def _snapped(axis: Curve, tip: Curve) -> Curve:
    """The axis with those knots that are the tip's but for rounding made the tip's, on the tip's domain."""
    knots = tip.knots[np.abs(tip.knots[:, None] - axis.knots[None, :]).argmin(axis=0)]
    near = np.abs(knots - axis.knots) <= _SAME_KNOT * (tip.knots[-1] - tip.knots[0])
    near[: axis.degree + 1] = near[-axis.degree - 1 :] = True
    return Curve(axis.degree, np.where(near, knots, axis.knots), axis.control_points, axis.weights)


def _joined(tip: Curve, axis: Curve, frame: Frame) -> Spline:
    """Tip and axis on the knots of both."""
    more_tip, more_axis = _missing(tip.knots, axis.knots), _missing(axis.knots, tip.knots)
    tip = tip.with_knots(more_tip) if more_tip.size else tip
    axis = axis.with_knots(more_axis) if more_axis.size else axis
    weights = _weights(tip)
    vectors = axis.control_points * (_weights(axis) / weights)[:, None]
    return Spline(tip.degree, tip.knots, frame.points(tip.control_points), frame.vectors(vectors), weights, False)


def _missing(knots: Floats, wanted: Floats) -> Floats:
    """Knots to insert, so that each of `wanted` is there as often as it is wanted."""
    values, counts = np.unique(wanted, return_counts=True)
    there = np.searchsorted(knots, values, side="right") - np.searchsorted(knots, values, side="left")
    return np.repeat(values, np.maximum(counts - there, 0))


def _weights(curve: Curve) -> Floats:
    return np.ones(len(curve.control_points)) if curve.weights is None else curve.weights


def _with_steps(item: Spline, control: Control) -> tuple[Spline, float]:
    """The NURBS with weights that are multiples of the control's step, and their largest relative error.

    All weights may be multiplied by one number; the one whose products lie nearest to the steps is taken.
    """
    weights = item.weights / item.weights.max()
    if np.ptp(weights) <= 1e-12:
        return Spline(item.degree, item.knots, item.poles, item.axes, np.ones_like(weights), item.is_axis_constant), 0.0
    different = np.unique(np.round(weights, 12))
    if control.has_unit_start:
        return _with_unit_start(item, control)
    top = int(control.weight_max / control.weight_step)
    steps = np.arange(max(top // 10, top - _WEIGHT_TRIALS, 1), top + 1)
    error = np.zeros(len(steps))
    for value in different.tolist():
        exact = steps * value
        error = np.maximum(error, np.abs(np.rint(exact) - exact) / exact)
    best = int(np.argmin(error))
    # multiplied whole, the control vectors of the axis keep their numerators: a w stays what it was
    stepped = np.rint(weights * steps[best]) * control.weight_step
    return Spline(item.degree, item.knots, item.poles, item.axes, stepped, item.is_axis_constant), float(error[best])


def _with_unit_start(item: Spline, control: Control) -> tuple[Spline, float]:
    """As _with_steps, where the control takes the weight of the first pole as 1."""
    weights = item.weights / item.weights[0]
    if weights.max() > control.weight_max:
        return item, float("inf")
    stepped = np.maximum(np.rint(weights / control.weight_step), 1.0) * control.weight_step
    made = Spline(item.degree, item.knots, item.poles, item.axes, stepped, item.is_axis_constant)
    return made, float(np.abs(stepped / weights - 1.0).max())
