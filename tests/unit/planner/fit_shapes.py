"""Plane curves known by formula, ways to take points from them, and how far fitted cubic pieces lie from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SPACINGS = ("even", "even along the arc", "1 % off", "10 % off", "30 % off", "cosine", "wave", "alternating", "random")
NOISES_MM = (0.0, 1e-6, 1e-5, 1e-4)  # none; 32-bit coordinates; coarse exports
_PROBES = np.linspace(0.0, 1.0, 14)[1:-1]  # places within a piece


@dataclass(frozen=True)
class Shape:
    """A plane curve: at(t) (..., 2) float, mm, for low <= t <= high; closed ones have period high - low."""

    name: str
    at: Callable[[Floats], Floats]
    closed: bool
    low: float
    high: float

    def nodes(self, spacing: str, count: int, rng: np.random.Generator) -> Floats:
        """Ascending parameters of `count` points: (count,) float."""
        steps = count if self.closed else count - 1
        number = np.arange(count)
        if spacing == "even along the arc":
            fine = np.linspace(self.low, self.high, 40 * count + 1)
            reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.at(fine), axis=0), axis=1))])
            return np.asarray(np.interp(number / steps * reached[-1], reached, fine))
        off = {"1 % off": 0.01, "10 % off": 0.1, "30 % off": 0.3}.get(spacing, 0.0)
        share = (number + off * rng.uniform(-1.0, 1.0, count)) / steps
        if spacing == "cosine":
            share = 0.5 - 0.5 * np.cos(np.pi * number / steps)
        elif spacing == "wave":
            share = number / steps + 0.08 * np.sin(2.0 * np.pi * number / steps)
        elif spacing == "alternating":
            share = (number + 0.15 * (number % 2)) / steps
        elif spacing == "random":
            share = np.sort(rng.uniform(0.0, 1.0, count))
        if not self.closed:
            share = np.clip(share, 0.0, 1.0)
        kept = share[np.append(True, np.diff(share) > 1e-6)]
        return np.asarray(self.low + (self.high - self.low) * kept)

    def distances(self, nodes: Floats, net: Floats) -> Floats:
        """Largest distance of each cubic Bézier piece from the curve, mm: (S,) float.

        nodes : (n,) float   net : (3S+1, 2) float, mm, the pieces between them. The foot is found by Gauss-Newton,
        then the offset is taken along the normal, which a small error of the foot does not change.
        """
        a = _PROBES
        basis = np.stack([(1 - a) ** 3, 3 * a * (1 - a) ** 2, 3 * a * a * (1 - a), a**3], axis=-1)
        pieces = np.stack([net[0:-1:3], net[1::3], net[2::3], net[3::3]], axis=1)
        points = np.einsum("ak,skd->sad", basis, pieces)
        ends = np.append(nodes, nodes[0] + self.high - self.low) if self.closed else nodes
        width = np.diff(ends)[:, None]
        t = ends[:-1, None] + a * width
        reach = (-np.inf, np.inf) if self.closed else (self.low, self.high)
        for _ in range(8):
            slope = self._slope(t, 1e-4 * np.minimum(width, 1.0))
            step = ((points - self.at(t)) * slope).sum(-1) / np.maximum((slope**2).sum(-1), 1e-300)
            t = np.clip(t + np.clip(step, -width, width), *reach)
        slope = self._slope(t, 1e-3 * np.minimum(width, 1.0))
        away = points - self.at(t)
        across = away[..., 0] * slope[..., 1] - away[..., 1] * slope[..., 0]
        return np.asarray((np.abs(across) / np.maximum(np.linalg.norm(slope, axis=-1), 1e-300)).max(axis=1))

    def _slope(self, t: Floats, step: Floats) -> Floats:
        return (self.at(t + step) - self.at(t - step)) / (2.0 * step)[..., None]


def _polar(t: Floats, radius: Floats) -> Floats:
    return np.asarray(radius[..., None] * np.stack([np.cos(t), np.sin(t)], axis=-1))


def known_shapes() -> list[Shape]:
    """Shapes of the trade: round, pointed, wavy, spiral, nearly square, open and closed."""
    turn = 2.0 * np.pi
    shapes = [
        Shape(f"ellipse {a} x {b}", lambda t, a=a, b=b: np.stack([a * np.cos(t), b * np.sin(t)], -1), True, 0.0, turn)  # type: ignore[misc]
        for a, b in ((23, 23), (30, 10), (30, 20), (30, 5), (30, 28))
    ]
    shapes += [
        Shape(f"{k} waves of {h} mm", lambda t, k=k, h=h: _polar(t, 20 + h * np.cos(k * t)), True, 0.0, turn)  # type: ignore[misc]
        for k, h in ((2, 3.0), (3, 0.5), (5, 0.3))
    ]
    return [
        *shapes,
        Shape("superellipse", lambda t: _powers(t, 0.8), True, 0.0, turn),
        Shape("Archimedean spiral", lambda t: _polar(t, 5 + 2 * t), False, 0.0, 3 * turn),
        Shape("logarithmic spiral", lambda t: _polar(t, 5 * np.exp(0.15 * t)), False, 0.0, 2 * turn),
        Shape("limacon", lambda t: _polar(t, 12 + 5 * np.cos(t)), True, 0.0, turn),
        Shape("egg", lambda t: np.stack([20 * np.cos(t), 12 * np.sin(t) * (1 + 0.2 * np.cos(t))], -1), True, 0.0, turn),
        Shape("eight", lambda t: np.stack([20 * np.sin(t), 12 * np.sin(2 * t + 0.5)], -1), True, 0.0, turn),
        Shape("cubic", lambda t: np.stack([8 * t, 2 * t**3 - 3 * t], -1), False, -2.0, 2.0),
        Shape("bell", lambda t: np.stack([5 * t, 10 * np.exp(-t * t)], -1), False, -4.0, 4.0),
        Shape("airfoil", _airfoil, False, -1.0, 1.0),
        Shape("rounded rectangle", _rounded_rectangle, True, 0.0, 1.0),
    ]


def fourier_shape(seed: int) -> Shape:
    """A random closed curve of six harmonics."""
    rng = np.random.default_rng(seed)
    wave = np.arange(1, 7)
    terms = 8.0 * rng.normal(size=(2, 2, 6)) / wave**2.5
    terms[0, 0, 0] += 24.0
    terms[1, 1, 0] += 16.0

    def at(t: Floats) -> Floats:
        cos, sin = np.cos(t[..., None] * wave), np.sin(t[..., None] * wave)
        return np.stack([cos @ terms[0, 0] + sin @ terms[0, 1], cos @ terms[1, 0] + sin @ terms[1, 1]], axis=-1)

    return Shape(f"Fourier {seed}", at, True, 0.0, 2.0 * np.pi)


def _powers(t: Floats, power: float) -> Floats:
    cos, sin = np.cos(t), np.sin(t)
    return np.stack([20 * np.sign(cos) * np.abs(cos) ** power, 10 * np.sign(sin) * np.abs(sin) ** power], axis=-1)


def _airfoil(t: Floats) -> Floats:
    """NACA 0060 of 100 mm chord, t = +-1 at the trailing edge, round at t = 0."""
    half = 0.5 * np.pi * t
    x = np.sin(half) ** 2
    y = 0.2969 * np.sin(half) + np.sign(t) * (-0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
    return np.asarray(100.0 * np.stack([x, 3.0 * y], axis=-1))


def _rounded_rectangle(t: Floats) -> Floats:
    """40 x 20 mm with corners of 5 mm, by arc length: curvature jumps eight times."""
    quarter = 2.5 * np.pi
    at = np.cumsum([0.0, 30.0, quarter, 10.0, quarter, 30.0, quarter, 10.0, quarter])
    s = (t % 1.0) * at[-1]
    angle = np.interp(s, at, 0.5 * np.pi * np.array([0, 0, 1, 1, 2, 2, 3, 3, 4]))
    x = np.interp(s, at, [-15, 15, 15, 15, 15, -15, -15, -15, -15])
    y = np.interp(s, at, [-5, -5, -5, 5, 5, 5, 5, -5, -5])
    return np.stack([x + 5 * np.sin(angle), y - 5 * np.cos(angle)], axis=-1)
