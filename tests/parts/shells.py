"""Parts of thin walls that lean, bend and close: built by deposition alone, without support."""

from __future__ import annotations

import numpy as np
from manifold3d import CrossSection, Manifold

from tests.parts.solids import revolved

WALL_MM = 3.0


def leaning_wall(segments: int) -> Manifold:
    """A wall of 3 mm, 30 mm wide and 30 mm up its slope, leaning 60 degrees from upright; flat, so `segments` changes nothing."""
    foot, reach, height = WALL_MM / np.cos(np.radians(60.0)), 30.0 * np.sin(np.radians(60.0)), 15.0
    outline = [(0.0, 0.0), (foot, 0.0), (foot + reach, height), (reach, height)]
    upright = CrossSection([outline]).extrude(30.0)
    return upright.transform(np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 15.0], [0.0, 1.0, 0.0, 0.0]]))


def bent_pipe(segments: int) -> Manifold:
    """A quarter of a torus: a pipe of 16/10 mm bent by 90 degrees about a radius of 25 mm, rising from z = 0 towards +x."""
    turn = np.linspace(0.0, 2.0 * np.pi, segments, endpoint=False)
    rings = [[(float(25.0 + r * np.cos(a)), float(r * np.sin(a))) for a in turn[::way]] for r, way in ((8.0, 1), (5.0, -1))]
    turned = CrossSection(rings).revolve(max(segments // 2, 8), 90.0)  # about z, from x towards y
    return turned.transform(np.array([[-1.0, 0.0, 0.0, 25.0], [0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0]]))


def dome(segments: int) -> Manifold:
    """Half of a spherical shell of 40/34 mm, standing on its rim, closed at the top."""
    outer, inner = arc(20.0, 0.0, 90.0, segments), arc(17.0, 0.0, 90.0, segments)
    return revolved([*outer, *inner[::-1]], segments)


def funnel(segments: int) -> Manifold:
    """A spout of 12 mm and above it a cone that opens by 50 degrees from upright to 50 mm, wall of 3 mm throughout."""
    lean = np.radians(50.0)
    along, across = np.array([np.sin(lean), np.cos(lean)]), WALL_MM * np.array([-np.cos(lean), np.sin(lean)])
    low = np.array([6.0, 10.0])
    high = low + along * (25.0 - low[0]) / along[0]
    inner = 6.0 - WALL_MM
    knee = low + across + along * (inner - (low + across)[0]) / along[0]
    corners = [(inner, 0.0), (6.0, 0.0), tuple(low), tuple(high), tuple(high + across), tuple(knee)]
    return revolved([(float(r), float(z)) for r, z in corners], segments)


def spherical_shell(segments: int) -> Manifold:
    """A hollow ball of 36/30 mm, cut 16.5 mm below its centre: a flat foot of 14 mm, closed everywhere else."""
    tilt = -float(np.degrees(np.arcsin(16.5 / 18.0)))
    outer = [(0.0, -16.5), *arc(18.0, tilt, 90.0, segments)]
    ball, hollow = revolved(outer, segments), revolved(arc(15.0, -90.0, 90.0, segments), segments)
    return (ball - hollow).translate([0.0, 0.0, 16.5])


def arc(radius: float, start_deg: float, end_deg: float, segments: int) -> list[tuple[float, float]]:
    """(r, z) along a circle about the origin, counter-clockwise, on the axis exactly where it ends there."""
    count = max(round(segments * (end_deg - start_deg) / 360.0), 4) + 1
    angles = np.radians(np.linspace(start_deg, end_deg, count))
    points = [(float(radius * np.cos(a)), float(radius * np.sin(a))) for a in angles]
    return [(0.0 if r < 1e-9 else r, z) for r, z in points]
