"""Where on a stretch of the Program reported joints are: every line of it that passes that place, and how near."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellctl.domain.timeline import STANDSTILL, Timeline

Floats = NDArray[np.float64]

SAME_PLACE = 4e-3  # mm or deg: positions of two lines are not told apart below this (reports have 3 decimals, posts 3 or 4)


@dataclass(frozen=True)
class Candidate:
    """A place on the Program. is_still : the line has no motion, so any of its fractions is here."""

    line: int
    fraction: float
    is_still: bool


def candidates(timeline: Timeline, first: int, last: int, joints: Floats) -> tuple[list[Candidate], float]:
    """All places on lines first .. last that are as near to the reported joints as the nearest, and how far that is.

    joints : (axes,) mm or deg, machine coordinates. The distance is in the norm of all joints, mm and deg alike.
    """
    first, last = max(first, 0), min(last, len(timeline) - 1)
    ends = timeline.joints_end[max(first - 1, 0) : last + 1]
    start, end = (ends[:-1], ends[1:]) if first > 0 else (np.vstack([ends[:1], ends[:-1]]), ends)
    chord = end - start
    relative = joints - start
    square = np.einsum("ij,ij->i", chord, chord)
    bulge = timeline.bulge[first : last + 1] if len(timeline.bulge) else np.zeros(len(start))
    is_still = (square < STANDSTILL**2) & (bulge == 0.0)
    fraction = np.einsum("ij,ij->i", relative, chord) / np.maximum(square, STANDSTILL**2)
    fraction = np.where(is_still, 0.0, np.minimum(np.maximum(fraction, 0.0), 1.0))
    miss = relative - fraction[:, None] * chord
    bent = np.flatnonzero(bulge)
    if bent.size:
        columns = np.array(timeline.plane)
        rows = bent[:, None]
        part, gap = _on_arcs(start[rows, columns], chord[rows, columns], bulge[bent], joints[columns])
        fraction[bent] = part
        miss[bent] = relative[bent] - part[:, None] * chord[bent]
        miss[rows, columns] = gap
    away2 = np.einsum("ij,ij->i", miss, miss)
    nearest = float(np.sqrt(away2.min()))
    near = np.flatnonzero(away2 <= (nearest + SAME_PLACE) ** 2)
    found = [Candidate(first + int(k), float(fraction[k]), bool(is_still[k])) for k in near]
    return found, nearest


def _on_arcs(start: Floats, chord: Floats, bulge: Floats, place: Floats) -> tuple[Floats, Floats]:
    """(m,) fraction of each arc nearest to a place (2,), and (m, 2) from there to the place.  start, chord : (m, 2) float"""
    left = np.column_stack([-chord[:, 1], chord[:, 0]])
    centre = start + 0.5 * chord + (0.25 * (1.0 / bulge - bulge))[:, None] * left
    sweep = 4.0 * np.arctan(np.abs(bulge))
    sign = np.sign(bulge)
    first, here = start - centre, place - centre
    cross = first[:, 0] * here[:, 1] - first[:, 1] * here[:, 0]
    turned = np.arctan2(cross, np.einsum("ij,ij->i", first, here)) * sign
    turned = np.where(turned < 0.5 * sweep - np.pi, turned + 2.0 * np.pi, turned)
    part = np.minimum(np.maximum(turned / sweep, 0.0), 1.0)
    angle = part * sweep * sign
    cos, sin = np.cos(angle), np.sin(angle)
    on = np.column_stack([cos * first[:, 0] - sin * first[:, 1], sin * first[:, 0] + cos * first[:, 1]])
    return part, here - on
