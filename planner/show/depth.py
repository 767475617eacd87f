"""Facets and lines as a picture in which the nearer hides the farther, pixel by pixel."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_FINER = 2  # each pixel is the mean of so many by so many: smooth edges


class DepthImage:
    """A picture that remembers how near every pixel is.

    width, height : pixels   low, high : (2,) float, what of the view is seen, in the units of the corners
    """

    def __init__(self, width: int, height: int, low: Floats, high: Floats) -> None:
        self.scale = _FINER * min(width / (high[0] - low[0]), height / (high[1] - low[1]))
        self.low = 0.5 * (low + high) - 0.5 * _FINER * np.array([width, height]) / self.scale
        self._colour = np.ones((height * _FINER, width * _FINER, 3))
        self._depth = np.full((height * _FINER, width * _FINER), -np.inf)

    def facets(self, corners: Floats, colours: Floats) -> None:
        """Fill flat convex facets.  corners : (n, k, 3) float, right, up, towards the eye   colours : (n, 3) float, 0 … 1."""
        for k in range(1, corners.shape[1] - 1):
            triangles = np.ascontiguousarray(self._pixels(corners[:, [0, k, k + 1]]))
            _fill(triangles, np.ascontiguousarray(colours), self._colour, self._depth)

    def lines(self, ends: Floats, colour: tuple[float, float, float], width: float, lift: float) -> None:
        """Draw straight lines.  ends : (n, 2, 3) float   width : pixels   lift : how much nearer they are taken to be."""
        _stroke(np.ascontiguousarray(self._pixels(ends)), np.array(colour), 0.5 * width * _FINER, lift, self._colour, self._depth)

    def _pixels(self, points: Floats) -> Floats:
        """Right and up in fine pixels, depth as it is."""
        found = points.copy()
        found[..., :2] = (points[..., :2] - self.low) * self.scale
        return found

    @property
    def image(self) -> NDArray[np.uint8]:
        """(height, width, 3) uint8, the lowest row first."""
        height, width = self._depth.shape
        mean = self._colour.reshape(height // _FINER, _FINER, width // _FINER, _FINER, 3).mean(axis=(1, 3))
        return np.asarray(np.round(255.0 * np.clip(mean, 0.0, 1.0)), dtype=np.uint8)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom, top of the picture, in the units of the corners."""
        height, width = self._depth.shape
        right, top = self.low + np.array([width, height]) / self.scale
        return float(self.low[0]), float(right), float(self.low[1]), float(top)


@njit(cache=True)
def _fill(triangles: Floats, colours: Floats, colour: Floats, depth: Floats) -> None:
    """Fill triangles (n, 3, 3) whose corners are pixels and depth; a pixel belongs to a triangle that holds its centre."""
    height, width = depth.shape
    for n in range(len(triangles)):
        t = triangles[n]
        area = (t[1, 0] - t[0, 0]) * (t[2, 1] - t[0, 1]) - (t[2, 0] - t[0, 0]) * (t[1, 1] - t[0, 1])
        if area == 0.0:
            continue
        left = max(int(np.floor(min(t[0, 0], t[1, 0], t[2, 0]))), 0)
        right = min(int(np.ceil(max(t[0, 0], t[1, 0], t[2, 0]))), width)
        bottom = max(int(np.floor(min(t[0, 1], t[1, 1], t[2, 1]))), 0)
        top = min(int(np.ceil(max(t[0, 1], t[1, 1], t[2, 1]))), height)
        for row in range(bottom, top):
            for column in range(left, right):
                x, y = column + 0.5, row + 0.5
                b = ((t[2, 0] - x) * (t[0, 1] - y) - (t[0, 0] - x) * (t[2, 1] - y)) / area
                c = ((t[0, 0] - x) * (t[1, 1] - y) - (t[1, 0] - x) * (t[0, 1] - y)) / area
                a = 1.0 - b - c
                if a < -1e-9 or b < -1e-9 or c < -1e-9:
                    continue
                near = a * t[0, 2] + b * t[1, 2] + c * t[2, 2]
                if near > depth[row, column]:
                    depth[row, column] = near
                    colour[row, column] = colours[n]


@njit(cache=True)
def _stroke(ends: Floats, ink: Floats, half: float, lift: float, colour: Floats, depth: Floats) -> None:
    """Draw lines (n, 2, 3), pixels and depth, over what is not nearer than they are; the picture's depth stays."""
    height, width = depth.shape
    for n in range(len(ends)):
        x0, y0, z0 = ends[n, 0, 0], ends[n, 0, 1], ends[n, 0, 2]
        dx, dy, dz = ends[n, 1, 0] - x0, ends[n, 1, 1] - y0, ends[n, 1, 2] - z0
        steps = max(int(np.ceil(2.0 * max(abs(dx), abs(dy)))), 1)
        for k in range(steps + 1):
            x, y, z = x0 + dx * k / steps, y0 + dy * k / steps, z0 + dz * k / steps + lift
            for row in range(max(int(np.ceil(y - half - 0.5)), 0), min(int(np.floor(y + half - 0.5)) + 1, height)):
                for column in range(max(int(np.ceil(x - half - 0.5)), 0), min(int(np.floor(x + half - 0.5)) + 1, width)):
                    if z > depth[row, column]:
                        colour[row, column] = ink
