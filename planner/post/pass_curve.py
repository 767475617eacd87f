"""One pass of the Plan seen in the table frame: points, axes and arc lengths at parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.errors import PostError
from planner.nurbs.curve import Curve
from planner.plan import Pass

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_SAME_PARAMETER = 1e-9  # of the domain
ARC_SLACK_MM = 1e-3
"""How far behind the end of a pass a set-point may stand through rounding."""


class PassCurve:
    """Tip and axis of a pass on one parameter, mm and unit vectors, table frame.

    place : where the pass is, for messages
    """

    def __init__(self, source: Pass, table_from_build: Floats, place: str) -> None:
        self.source = source
        self.place = place
        self._rotation = table_from_build[:3, :3]
        self._shift = table_from_build[:3, 3]
        self._is_polyline = source.tip.degree == 1 and source.tip.weights is None
        if self._is_polyline:
            steps = np.linalg.norm(np.diff(source.tip.control_points, axis=0), axis=1)
            self._reached = np.concatenate([[0.0], np.cumsum(steps)])
            self._corners = source.tip.knots[1:-1]
        self.length_mm = float(self._reached[-1]) if self._is_polyline else source.tip.length
        self._constant_axis: Floats | None = None
        if not isinstance(source.axis, Curve):
            self._constant_axis = (
                _unit(np.asarray(source.axis, dtype=np.float64).reshape(1, 3), place) @ self._rotation.T
            )
        self._check()

    @property
    def has_constant_axis(self) -> bool:
        """Whether the tool axis stays the same along the pass."""
        return self._constant_axis is not None

    @property
    def set_point_arcs(self) -> Floats:
        """(k,) float, mm: where the set-points change, the first at 0."""
        return np.asarray(self.source.setpoints[:, 0], dtype=np.float64)

    def first_parameters(self, chord_tolerance_mm: float) -> tuple[Floats, Bools]:
        """Parameters whose chords stay within the tolerance, and which of them have to stay (ends and set-points): (n,) and (n,)."""
        tip = self.source.tip
        inner = self.set_point_arcs[1:]
        inner = inner[inner < self.length_mm - ARC_SLACK_MM]
        low, high = tip.domain
        fixed = np.concatenate([[low], self.at_arc_length(inner), [high]]) if inner.size else np.array([low, high])
        samples = self._corners if self._is_polyline else tip.sample(chord_tolerance_mm)
        if isinstance(self.source.axis, Curve):
            samples = np.concatenate([samples, self.source.axis.breaks])
        after = np.searchsorted(fixed, samples).clip(1, len(fixed) - 1)
        apart = np.minimum(np.abs(samples - fixed[after - 1]), np.abs(samples - fixed[after]))
        others = np.unique(samples[apart > _SAME_PARAMETER * (high - low)])
        parameters = np.concatenate([fixed, others])
        order = np.argsort(parameters, kind="stable")
        return parameters[order], (np.arange(len(parameters)) < len(fixed))[order]

    def at_arc_length(self, s: Floats) -> Floats:
        """(n,) parameters at arc lengths (n,), mm."""
        if self._is_polyline:
            return np.asarray(np.interp(s, self._reached, self._corners))
        return self.source.tip.at_arc_length(s)

    def arc_length(self, u: Floats) -> Floats:
        """(n,) arc lengths, mm, at parameters (n,)."""
        if self._is_polyline:
            return np.asarray(np.interp(u, self._corners, self._reached))
        return self.source.tip.arc_length(u)

    def tips(self, u: Floats) -> Floats:
        """(n, 3) mm."""
        if self._is_polyline:
            points = self.source.tip.control_points
            here = np.column_stack([np.interp(u, self._corners, points[:, k]) for k in range(3)])
        else:
            here = self.source.tip.evaluate(u)
        return np.asarray(here @ self._rotation.T + self._shift)

    def axes(self, u: Floats) -> Floats:
        """(n, 3) unit vectors."""
        if self._constant_axis is not None:
            return np.broadcast_to(self._constant_axis, (len(u), 3))
        assert isinstance(self.source.axis, Curve)
        return np.asarray(_unit(self.source.axis.evaluate(u), self.place) @ self._rotation.T)

    def nearest(self, points: Floats, u: Floats) -> Floats:
        """(n,) parameters nearer to points (n, 3) than u (n,): one Newton step along the curve, kept inside the domain."""
        low, high = self.source.tip.domain
        speed = self.source.tip.derivatives(u, 1)[1] @ self._rotation.T
        along = np.einsum("ij,ij->i", points - self.tips(u), speed)
        square = np.einsum("ij,ij->i", speed, speed)
        return np.asarray(np.clip(u + np.divide(along, square, out=np.zeros_like(u), where=square > 0.0), low, high))

    def _check(self) -> None:
        arcs = self.set_point_arcs
        if self.source.setpoints.ndim != 2 or self.source.setpoints.shape[1] != 5 or len(arcs) == 0 or arcs[0] != 0.0:
            raise PostError(f"{self.place}: set-points must be rows of 5 from arc length 0", "plan the part again")
        if not np.all(np.isfinite(self.source.setpoints)) or np.any(np.diff(arcs) <= 0.0):
            raise PostError(
                f"{self.place}: set-points must be finite and in order of arc length", "plan the part again"
            )
        if arcs[-1] > self.length_mm + ARC_SLACK_MM:
            raise PostError(
                f"{self.place}: a set-point at {arcs[-1]:.3f} mm lies behind the end of the pass at {self.length_mm:.3f} mm",
                "plan the part again",
            )
        if not self.source.rapid and not np.all(self.source.setpoints[:, 1] > 0.0):
            raise PostError(
                f"{self.place}: a feed of {self.source.setpoints[:, 1].min():g} mm/s does not move",
                "plan the part again",
            )


def _unit(vectors: Floats, place: str) -> Floats:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    if not np.all(length > 1e-9):
        raise PostError(f"{place}: the tool axis vanishes", "plan the part again")
    return np.asarray(vectors / length)
