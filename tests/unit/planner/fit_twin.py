"""The local cubic interpolation once more, in plain numpy and by other formulas: what the compiled kernel must give."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def bezier_net(points: Floats, closed: bool, matched: bool) -> Floats:
    """Control points of the pieces between smooth plane points: (3S+1, 2) float, mm.

    points : (n, 2) float, mm, neighbours not five times farther apart than the next ones
    """
    around = _extended(points, closed)
    start, end = around[2:-3], around[3:-2]
    q = np.diff(around, axis=0)
    kappa3 = _circle_curvatures(around)
    tangent = _tangents(q)
    left, right = tangent[:-1], tangent[1:]
    chord = end - start
    alpha = np.array([_speed_root(d, s) for d, s in zip(chord, left + right, strict=True)])
    handle = alpha / 3.0
    if matched:
        kappa = np.array([_quartic_curvature(q[i : i + 4], kappa3[i : i + 3]) for i in range(len(tangent))])
        if not closed:
            kappa[[0, 1, -2, -1]] = 0.0
        handle = _chosen(handle, chord, tangent, kappa, kappa3, q)
    net = np.empty((3 * len(chord) + 1, 2))
    net[0:-1:3], net[-1] = start, end[-1]
    net[1::3], net[2::3] = start + handle[:, None] * left, end - handle[:, None] * right
    return net


def _extended(points: Floats, closed: bool) -> Floats:
    """Two points before the first and two after the last piece."""
    if closed:
        return np.concatenate([points[-2:], points, points[:3]])
    ends = []
    for path in (points, points[::-1]):
        q1, q2 = path[1] - path[0], path[2] - path[1]
        q0 = 2.0 * q1 - q2
        ends.append((path[0] - q0, path[0] - q0 - (2.0 * q0 - q1)))
    return np.array([ends[0][1], ends[0][0], *points, ends[1][0], ends[1][1]])


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _tangents(q: Floats) -> Floats:
    """Eq. 4: alpha = |q0 x q1| / (|q0 x q1| + |q2 x q3|), V = (1 - alpha) q1 + alpha q2."""
    before, after = np.abs(_cross(q[:-3], q[1:-2])), np.abs(_cross(q[2:-1], q[3:]))
    share = before / (before + after)
    v = (1.0 - share)[:, None] * q[1:-2] + share[:, None] * q[2:-1]
    return np.asarray(v / np.hypot(*v.T)[:, None])


def _circle_curvatures(path: Floats) -> Floats:
    """Signed curvature of the circle through each point and its neighbours: 4 area / (a b c)."""
    a, b, c = path[:-2], path[1:-1], path[2:]
    sides = np.linalg.norm(b - a, axis=1) * np.linalg.norm(c - b, axis=1) * np.linalg.norm(c - a, axis=1)
    return np.asarray(2.0 * _cross(b - a, c - b) / sides)


def _speed_root(chord: Floats, both: Floats) -> float:
    """Eq. 5 as corrected: the positive root of (16 - |S|²) x² + 12 D·S x - 36 |D|²."""
    return float(np.roots([16.0 - both @ both, 12.0 * (chord @ both), -36.0 * (chord @ chord)]).real.max())


def _quartic_curvature(q: Floats, circles: Floats) -> float:
    """Curvature at the middle of four chords: quadratic in arc length, with three circles as its divided differences."""
    length = np.hypot(*q.T)
    length = length * (1.0 + (circles[1] * length) ** 2 / 24.0)
    s = np.concatenate([[0.0], np.cumsum(length)])
    s -= s[2]
    rows = []
    for i in range(3):
        # f''= 1, s, s² integrated twice, as divided differences of second order
        f = np.stack([s[i : i + 3] ** 2 / 2.0, s[i : i + 3] ** 3 / 6.0, s[i : i + 3] ** 4 / 12.0])
        x = s[i : i + 3]
        rows.append(2.0 * ((f[:, 2] - f[:, 1]) / (x[2] - x[1]) - (f[:, 1] - f[:, 0]) / (x[1] - x[0])) / (x[2] - x[0]))
    return float(np.linalg.solve(np.array(rows), circles)[0])


def _chosen(handle: Floats, chord: Floats, tangent: Floats, kappa: Floats, circles: Floats, q: Floats) -> Floats:
    """Curvature handles where the piece and both neighbours are sure of them, equal speed elsewhere."""
    left, right, length = tangent[:-1], tangent[1:], np.hypot(*chord.T)
    sign = np.sign(kappa[:-1] + kappa[1:])
    bulge = sign * (_cross(left, chord) + _cross(chord, right))
    turn = sign * _cross(left, right)
    quadratic = 1.5 * np.abs(kappa[:-1] + kappa[1:])
    even = np.array([
        max((r.real for r in np.roots([a, 2.0 * b, -c]) if abs(r.imag) < 1e-12), default=0.0) if a > 0.0 else 0.0
        for a, b, c in zip(quadratic, turn, bulge, strict=True)
    ])  # fmt: skip
    change = np.abs(0.375 * (even - handle) * bulge) / length
    central = 7.0 * (q[1:-2] + q[2:-1]) - q[:-3] - q[3:]
    astray = np.abs(_cross(tangent, central))
    unresolved = (circles[:-3] - circles[1:-2] - circles[2:-1] + circles[3:]) ** 2
    sure = (kappa[:-1] * kappa[1:] > 0.0) & (even > 0.2 * length) & (even < 0.55 * length)
    sure &= change * np.abs(kappa[:-1] + kappa[1:]) > 0.02 * length**2 * unresolved
    sure &= change > np.maximum(astray[:-1], astray[1:]) / 6.0
    fits = sure & np.roll(sure, 1) & np.roll(sure, -1)
    return np.where(fits, even, handle)
