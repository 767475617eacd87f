"""NURBS as a control evaluates them from the numbers in a program; shares no code with the planner's kernel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ReadCurve:
    """poles : (n, 3) float, mm   second : (n, 3) float, poles of a second point on the tool's axis, or None   weights : (n,) float

    knots : (n + degree + 1,) float, clamped
    """

    degree: int
    knots: Floats
    poles: Floats
    weights: Floats
    second: Floats | None = None

    @property
    def fault(self) -> str:
        """What is wrong with the numbers, empty if nothing."""
        p, n = self.degree, len(self.poles)
        if n <= p:
            return f"{n} poles are too few for degree {p}"
        if len(self.knots) != n + p + 1:
            return f"{len(self.knots)} knots for {n} poles of degree {p}"
        if np.any(np.diff(self.knots) < 0.0):
            return "knots decrease"
        if self.knots[p] != self.knots[0] or self.knots[-p - 1] != self.knots[-1] or self.knots[-1] <= self.knots[0]:
            return "knots do not begin and end with degree + 1 equal ones"
        return "" if np.all(self.weights > 0.0) else "a weight is not positive"

    def shares(self, per_span: int) -> Floats:
        """Parameters from 0 to 1: the knots and so many places within each span; enough to fix every polynomial piece."""
        breaks = np.unique(self.knots)
        inner = np.arange(per_span) / per_span
        at = (breaks[:-1, None] + inner * np.diff(breaks)[:, None]).ravel()
        return np.asarray(np.append(at - breaks[0], breaks[-1] - breaks[0]) / (breaks[-1] - breaks[0]))

    def points(self, shares: Floats) -> tuple[Floats, Floats | None]:
        """(k, 3) points at shares of the domain, and those of the second point.

        Source: de Boor's algorithm on homogeneous poles, Farin, Curves and Surfaces for CAGD, 10.2 and 15.7.
        """
        p, knots = self.degree, self.knots
        t = knots[0] + shares * (knots[-1] - knots[0])
        span = np.clip(np.searchsorted(knots, t, side="right") - 1, p, len(self.poles) - 1)
        columns = [self.poles * self.weights[:, None], self.weights[:, None]]
        if self.second is not None:
            columns.append(self.second * self.weights[:, None])
        rows = np.hstack(columns)
        level = rows[span[:, None] - p + np.arange(p + 1)]
        for r in range(1, p + 1):
            for j in range(p, r - 1, -1):
                low, high = knots[span - p + j], knots[span + 1 + j - r]
                share = ((t - low) / (high - low))[:, None]
                level[:, j] = (1.0 - share) * level[:, j - 1] + share * level[:, j]
        found = level[:, p]
        tip = found[:, :3] / found[:, 3:4]
        return tip, found[:, 4:] / found[:, 3:4] if self.second is not None else None
