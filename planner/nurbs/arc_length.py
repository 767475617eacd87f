"""Arc length of a curve and its inverse: Gauss-Legendre per piece of span, Newton on the way back."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Speed = Callable[[Floats], Floats]

_AGREEMENT = 1e-11  # share of the whole length by which a piece and its two halves may differ
_MAX_HALVINGS = 30  # near a point of no speed the error falls only by 4 per halving
_NODES, _WEIGHTS = (np.asarray(part, dtype=np.float64) for part in np.polynomial.legendre.leggauss(8))
_MAX_STEPS = 60  # bisection alone halves a piece down to rounding in about 52


class ArcLengthTable:
    """Cumulative length at the edges of pieces of knot spans, short enough for 8 Gauss-Legendre nodes each."""

    def __init__(self, speed: Speed, breaks: Floats) -> None:
        """speed : |C'| at (k,) parameters.   breaks : (s+1,) float, the distinct knots."""
        self._speed = speed
        low, high = breaks[:-1], breaks[1:]
        starts, lengths = [], []
        whole = self._integral(low, high)
        total = float(whole.sum())
        for _ in range(_MAX_HALVINGS):
            middle = 0.5 * (low + high)
            first, second = self._integral(low, middle), self._integral(middle, high)
            agree = np.abs(first + second - whole) <= _AGREEMENT * total
            starts.append(low[agree])
            lengths.append(first[agree] + second[agree])
            if agree.all():
                break
            wide = ~agree
            low, high = np.concatenate([low[wide], middle[wide]]), np.concatenate([middle[wide], high[wide]])
            whole = np.concatenate([first[wide], second[wide]])
        else:
            starts.append(low)
            lengths.append(whole)
        order = np.argsort(np.concatenate(starts))
        self._edges = np.append(np.concatenate(starts)[order], breaks[-1])
        self._cumulative = np.concatenate([[0.0], np.cumsum(np.concatenate(lengths)[order])])

    @property
    def total(self) -> float:
        """Length of the whole curve, mm."""
        return float(self._cumulative[-1])

    def length_at(self, u: Floats) -> Floats:
        """Length from the start to each parameter: (k,) float, mm."""
        piece = np.clip(np.searchsorted(self._edges, u, side="right") - 1, 0, len(self._edges) - 2)
        return np.asarray(self._cumulative[piece] + self._integral(self._edges[piece], u), dtype=np.float64)

    def parameter_at(self, s: Floats) -> Floats:
        """Parameter at each length from the start: (k,) float. Safeguarded Newton, to about 1e-13 of the length."""
        s = np.clip(s, 0.0, self.total)
        piece = np.clip(np.searchsorted(self._cumulative, s, side="right") - 1, 0, len(self._edges) - 2)
        start, low, high = self._edges[piece], self._edges[piece].copy(), self._edges[piece + 1].copy()
        wanted = s - self._cumulative[piece]
        whole = self._cumulative[piece + 1] - self._cumulative[piece]
        u = start + (high - low) * np.divide(wanted, whole, out=np.zeros_like(wanted), where=whole > 0.0)
        open_ones = np.arange(len(s))
        for _ in range(_MAX_STEPS):
            at = u[open_ones]
            error = self._integral(start[open_ones], at) - wanted[open_ones]
            wide = np.abs(error) > 1e-13 * max(self.total, 1e-300)
            wide &= (high - low)[open_ones] > 4e-16 * np.abs(self._edges[-1])
            open_ones, at, error = open_ones[wide], at[wide], error[wide]
            if open_ones.size == 0:
                break
            high[open_ones] = np.where(error > 0.0, at, high[open_ones])
            low[open_ones] = np.where(error > 0.0, low[open_ones], at)
            speed = self._speed(at)
            step = at - np.divide(error, speed, out=np.full_like(error, np.inf), where=speed > 0.0)
            inside = (step > low[open_ones]) & (step < high[open_ones])
            u[open_ones] = np.where(inside, step, 0.5 * (low[open_ones] + high[open_ones]))
        return np.asarray(u)

    def _integral(self, low: Floats, high: Floats) -> Floats:
        half = 0.5 * (high - low)
        at = (0.5 * (high + low))[:, None] + half[:, None] * _NODES
        return np.asarray(half * (self._speed(at.ravel()).reshape(at.shape) @ _WEIGHTS), dtype=np.float64)
