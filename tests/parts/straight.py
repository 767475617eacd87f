"""Parts of straight pieces: bars, plates, legs and bores."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from tests.parts.solids import ball, bar, box, revolved, twisted


def tee(segments: int) -> Manifold:
    """A T of round bars: a stem of 10 mm and a bar of 10 mm across its end, axes meeting at z = 40 mm."""
    return bar((0, 0, 0), (0, 0, 40), 5.0, segments) + bar((-20, 0, 40), (20, 0, 40), 5.0, segments)


def cross(segments: int) -> Manifold:
    """A post of 10 mm square and 60 mm height with four arms of 18 mm; flat, so `segments` changes nothing."""
    post = box((-5, -5, 0), (5, 5, 60))
    return post + box((-23, -5, 36), (23, 5, 46)) + box((-5, -23, 36), (5, 23, 46))


def y_branch(segments: int) -> Manifold:
    """A trunk and two arms of 10 mm, each 40 degrees off the trunk, blended by a ball where they meet."""
    node, arm = np.array([0.0, 0.0, 25.0]), 28.0 * np.array([np.sin(np.radians(40.0)), 0.0, np.cos(np.radians(40.0))])
    trunk = bar((0, 0, 0), node, 5.0, segments) + ball(node, 5.0, segments)
    return trunk + bar(node, node + arm, 5.0, segments) + bar(node, node + arm * [-1.0, 1.0, 1.0], 5.0, segments)


def l_bracket(segments: int) -> Manifold:
    """Two plates of 40 x 35 x 5 mm at a right angle, two bores of 6 mm in each."""
    plates = box((0, 0, 0), (35, 40, 5)) + box((0, 0, 0), (5, 40, 35))
    for y in (10.0, 30.0):
        plates -= bar((22, y, -1), (22, y, 6), 3.0, segments) + bar((-1, y, 22), (6, y, 22), 3.0, segments)
    return plates


def branched_tube(segments: int) -> Manifold:
    """An upright tube of 20/14 mm with two side branches of 12/6 mm, opposite each other at two heights, bores joined."""
    outside = bar((0, 0, 0), (0, 0, 56), 10.0, segments)
    outside += bar((0, 0, 34), (24, 0, 34), 6.0, segments) + bar((0, 0, 44), (-24, 0, 44), 6.0, segments)
    inside = bar((0, 0, -1), (0, 0, 57), 7.0, segments)
    return outside - inside - bar((0, 0, 34), (25, 0, 34), 3.0, segments) - bar((0, 0, 44), (-25, 0, 44), 3.0, segments)


def bladed_hub(segments: int) -> Manifold:
    """A hub of 20 mm with a bore of 8 mm and six blades, 14 x 3.2 mm, 14 mm long, twisted by 30 degrees."""
    hub = bar((0, 0, 0), (0, 0, 46), 10.0, segments) - bar((0, 0, -1), (0, 0, 47), 4.0, segments)
    blade = twisted(14.0, 3.2, 16.0, 30.0, max(segments // 4, 4)).rotate([15.0, 0.0, 0.0]).translate([8.0, 0.0, 36.0])
    for k in range(6):
        hub += blade.rotate([0.0, 0.0, 60.0 * k])
    return hub


def table(segments: int) -> Manifold:
    """A top of 44 x 44 x 5 mm on four legs of 6 mm square and 25 mm length, standing on its legs."""
    made = box((-22, -22, 25), (22, 22, 30))
    for x in (-22, 16):
        for y in (-22, 16):
            made += box((x, y, 0), (x + 6, y + 6, 25))
    return made


def two_bodies(segments: int) -> Manifold:
    """A block of 14 x 20 x 10 mm and beside it, 16 mm away, a round post of 12 mm and 16 mm height."""
    return box((-22, -10, 0), (-8, 10, 10)) + bar((14, 0, 0), (14, 0, 16), 6.0, segments)


def plate_with_boss(segments: int) -> Manifold:
    """A plate of 30 x 30 x 4 mm with a boss of one bead: 2.6 mm thick, 5 mm high."""
    return box((-15, -15, 0), (15, 15, 4)) + bar((0, 0, 2), (0, 0, 9), 1.3, segments)


def mushroom(segments: int) -> Manifold:
    """A stem of 10 mm under a half ball of 28 mm whose flat side hangs 9 mm beyond the stem all round."""
    angle = np.linspace(0.0, 0.5 * np.pi, max(segments // 4, 4) + 1)
    cap = [(float(14.0 * np.cos(a)), float(16.0 + 14.0 * np.sin(a))) for a in angle[:-1]]
    return revolved([(0.0, 0.0), (5.0, 0.0), (5.0, 16.0), *cap, (0.0, 30.0)], segments)
