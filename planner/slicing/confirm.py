"""Layer boundaries whose walls were measured: estimated from curvature, measured against the mesh, corrected."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.mesh.nearest import FacetTree
from planner.slicing.circles import Circles, facet_circles, thickest_boundaries
from planner.slicing.cusp import RULES, SIDES, LayerRule, ToleranceSide
from planner.slicing.deviation import ROUGHLY, SAMPLES, WallDeviations, slab_deviations, wall_deviations
from planner.slicing.stations import Stations

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

AIM = 0.98
"""Of the allowed cusp: what corrections aim at, so that the next measurement, of slightly other slabs, stays below it."""
ROUGH_ROUNDS, FULL_ROUNDS = 5, 4
"""Rounds of estimating and measuring at most, first with few points of each section, then with all."""
SPLITS = 12  # rounds of halving what is still too thick, and of joining what need not be two
JOINABLE = 0.9  # of the cusp: neighbours whose deviations add up to less may be one layer
NEARLY = 0.02  # share of slabs beyond the cusp that may be cut in two instead of another round
_SCALE = (0.02, 20.0)  # and of all of them together
_STEP = (0.2, 2.0)  # bounds of one correction


@dataclass(frozen=True)
class Wanted:
    """What layers must keep: cusp δ, least and greatest thickness in mm, the rule and the side of walls, the crease angle."""

    cusp_mm: float
    min_mm: float
    max_mm: float
    rule: LayerRule
    side: ToleranceSide
    crease_deg: float


@dataclass(frozen=True)
class Confirmed:
    """Boundaries (k + 1,) as stations, ascending, and the measured deviation (k,) of the walls between them, mm."""

    stations: Floats
    deviation_mm: Floats


class Confirmation:
    """The search for the fewest layers whose walls keep the cusp.

    breaks : (b,) float, stations, ascending   boundaries that must be; the first and last are the part's ends.
    """

    def __init__(self, mesh: Mesh, stations: Stations, breaks: Floats, wanted: Wanted, touch: float) -> None:
        self.mesh, self.stations, self.breaks, self.wanted, self.touch = mesh, stations, breaks, wanted, touch
        self.tree = FacetTree(mesh)
        self.circles: Circles = facet_circles(mesh, stations, wanted.crease_deg, touch)
        self.least = wanted.min_mm / float(self.circles.rate.max())

    def run(self) -> Confirmed:
        """Estimate, measure and correct until the layers are few and right; then halve what is still too thick.

        A layer of least thickness may exceed the cusp: the bounds win, its deviation tells.
        """
        scale = (self.breaks[:1], np.ones(1))
        best, fewest = self.breaks, np.inf
        samples, rounds = ROUGHLY, ROUGH_ROUNDS
        while rounds > 0:
            rounds -= 1
            asked, drawn = self._boundaries(scale)
            measured = self._measure(drawn, samples)
            off = int(self._too_far(drawn, measured.deviation_mm).sum())
            scale = self._corrected(scale, asked, drawn, measured)
            if samples == SAMPLES and len(drawn) + off < fewest:
                best, fewest = drawn, len(drawn) + off
            is_near = off <= max(NEARLY * len(drawn), 1)
            if is_near and samples == SAMPLES:
                break
            if samples != SAMPLES and (is_near or rounds == 0):
                samples, rounds = SAMPLES, FULL_ROUNDS
        return self._joined(self._split(best))

    def _measure(self, boundaries: Floats, samples: int = SAMPLES) -> WallDeviations:
        planes = self.stations.planes(boundaries)
        return wall_deviations(self.mesh, planes, self.wanted.rule, self.wanted.side, self.tree, samples)

    def _too_far(self, boundaries: Floats, deviation_mm: Floats) -> Flags:
        """Which slabs exceed the cusp though they could be thinner."""
        return np.asarray((deviation_mm > self.wanted.cusp_mm) & (np.diff(boundaries) >= 2.0 * self.least))

    def _boundaries(self, scale: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
        """The thickness that each layer asks for, (k,), and the boundaries drawn to meet the breaks, (k + 1,)."""
        wanted = self.wanted
        asked, drawn = [], [self.breaks[:1]]
        for span in pairwise(self.breaks.tolist()):
            greedy = thickest_boundaries(
                self.circles, span, (wanted.min_mm, wanted.max_mm), scale, wanted.cusp_mm,
                (RULES[wanted.rule], SIDES[wanted.side]), self.touch,
            )  # fmt: skip
            even = drawn_between(greedy, span, self.least)
            asked.append(np.diff(greedy) if len(even) == len(greedy) else np.diff(even))
            drawn.append(even[1:])
        return np.concatenate(asked), np.concatenate(drawn)

    def _corrected(
        self, scale: tuple[Floats, Floats], asked: Floats, drawn: Floats, measured: WallDeviations
    ) -> tuple[Floats, Floats]:
        """The scale by which the next estimate differs, from what was measured.

        A chord's deviation grows with the square of its length, a step's with the length itself.
        """
        before = np.interp(drawn[:-1], *scale)
        power = np.where(measured.is_swept | (self.wanted.rule != "ruled"), 1.0, 0.5)
        ratio = AIM * self.wanted.cusp_mm / np.maximum(measured.deviation_mm, 1e-9 * self.wanted.cusp_mm)
        thickness = np.diff(drawn)
        factor = np.clip(ratio**power, *_STEP) * np.minimum(thickness / asked, 1.0)
        is_last = np.isin(drawn[1:], self.breaks)  # what is left over of a span may be thinner than it need be
        factor[is_last | (thickness <= self.least * 1.001)] = np.minimum(factor, 1.0)[
            is_last | (thickness <= self.least * 1.001)
        ]
        return drawn[:-1], np.clip(before * factor, *_SCALE)

    def _slabs(self, lower: Floats, upper: Floats) -> Floats:
        """Measured deviation of any slabs, mm: (k,)."""
        planes = self.stations.planes(lower), self.stations.planes(upper)
        return slab_deviations(self.mesh, planes, self.wanted.rule, self.wanted.side, self.tree).deviation_mm

    def _split(self, boundaries: Floats) -> Confirmed:
        """Cut slabs that are too far off into equal parts until none is left that may be cut."""
        deviation = self._slabs(boundaries[:-1], boundaries[1:])
        for _ in range(SPLITS):
            too_far = self._too_far(boundaries, deviation)
            if not too_far.any():
                break
            parts = np.where(too_far, 2, 1)
            is_new = np.repeat(too_far, parts)
            within = np.arange(len(is_new)) - np.repeat(np.cumsum(parts) - parts, parts)
            step = np.repeat(np.diff(boundaries) / parts, parts)
            boundaries = np.append(np.repeat(boundaries[:-1], parts) + within * step, boundaries[-1])
            deviation = np.repeat(deviation, parts)
            deviation[is_new] = self._slabs(boundaries[:-1][is_new], boundaries[1:][is_new])
        return Confirmed(boundaries, deviation)

    def _joined(self, found: Confirmed) -> Confirmed:
        """Join neighbouring slabs whose common wall keeps the cusp as well."""
        boundaries, deviation = found.stations, found.deviation_mm
        most = self.wanted.max_mm / float(self.circles.rate.max()) + self.touch
        for _ in range(SPLITS):
            worth = ~np.isin(boundaries[1:-1], self.breaks) & (boundaries[2:] - boundaries[:-2] <= most)
            worth &= deviation[1:] + deviation[:-1] < JOINABLE * self.wanted.cusp_mm
            for i in range(1, len(worth)):
                worth[i] &= not worth[i - 1]
            tried = np.flatnonzero(worth)
            together = self._slabs(boundaries[tried], boundaries[tried + 2])
            kept = tried[together <= self.wanted.cusp_mm]
            if not len(kept):
                break
            deviation[kept] = together[together <= self.wanted.cusp_mm]
            boundaries, deviation = np.delete(boundaries, kept + 1), np.delete(deviation, kept + 1)
        return Confirmed(boundaries, deviation)


def drawn_between(greedy: Floats, span: tuple[float, float], least: float) -> Floats:
    """Boundaries drawn together so that the last one meets the top of the span, none nearer than least to the next.

    greedy : (k + 1,) float   from the bottom of the span to its top or beyond.  Returns (j + 1,) float, j <= k.
    """
    bottom, top = span
    even = bottom + (greedy - bottom) * ((top - bottom) / (greedy[-1] - bottom))
    even[-1] = top
    if np.diff(even).min() >= least * (1.0 - 1e-9):
        return np.asarray(even)
    most = int((top - bottom) / least * (1.0 + 1e-9))
    if most < len(greedy) - 1:
        return np.linspace(bottom, top, max(most, 1) + 1)
    for i in range(len(even) - 2, 0, -1):
        even[i] = min(even[i], even[i + 1] - least)
    for i in range(1, len(even) - 1):
        even[i] = max(even[i], even[i - 1] + least)
    return np.asarray(even)
