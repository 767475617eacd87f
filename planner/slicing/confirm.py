"""Layer boundaries whose walls were measured: estimated from curvature, measured against the mesh, corrected."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from planner.matching import WallDeviation, measured_walls
from planner.mesh.mesh import Mesh
from planner.mesh.nearest import FacetTree
from planner.slicing.circles import Circles, facet_circles, thickest_boundaries
from planner.slicing.contours import ContourStyle
from planner.slicing.cusp import RULES, SIDES, LayerRule, ToleranceSide
from planner.slicing.deviation import ROUGHLY, SAMPLES, WallDeviations, slab_deviations
from planner.slicing.stations import Stations

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

AIM = 0.98
"""Of the allowed cusp: what corrections aim at, so that the next measurement, of slightly other slabs, stays below it."""
AS_BUILT = 0
"""In place of a number of samples: the walls themselves, as `planner.matching` makes them, measured both ways."""
STAGES: dict[LayerRule, tuple[tuple[int, int], ...]] = {
    "extruded": ((ROUGHLY, 5), (SAMPLES, 4)),
    "ruled": ((ROUGHLY, 5), (AS_BUILT, 4)),
}
"""Samples of each section and rounds of estimating and measuring at most: first roughly, then as it counts."""
SPLITS = 12  # rounds of halving what is still too thick, and of joining what need not be two
JOINABLE = 0.9  # neighbours whose shares of what is allowed add up to less may be one layer
NEARLY = 0.02  # share of slabs beyond the cusp that may be cut in two instead of another round
RIM = 1.1
"""Of how far the contours themselves lie from the mesh: where that is beyond the cusp, no thinner layer betters it."""
_SCALE = (0.02, 20.0)  # and of all of them together
_STEP = (0.2, 2.0)  # bounds of one correction


@dataclass(frozen=True)
class Wanted:
    """What layers must keep: cusp δ, least and greatest thickness in mm, the rule and the side of walls, the crease angle.

    style : how the contours of ruled walls are made; None: along the smooth surface, as recipes have it by default.
    """

    cusp_mm: float
    min_mm: float
    max_mm: float
    rule: LayerRule
    side: ToleranceSide
    crease_deg: float
    style: ContourStyle | None = None

    @property
    def contours(self) -> ContourStyle:
        """The style of the contours."""
        return self.style or ContourStyle(crease_deg=self.crease_deg)


@dataclass(frozen=True, eq=False)
class Confirmed:
    """Layers and what was measured of them.

    stations : (k + 1,) float      boundaries, ascending
    deviation_mm : (k,) float      greatest distance between wall and mesh; ruled walls: both ways, as they are built
    share : (k,) float             of what is allowed: the cusp, or what the contours themselves have, however thin the layer
    is_bound : (k,) bool           layers that the cusp does not limit: of least or greatest thickness, or ending where the
                                   part changes
    """

    stations: Floats
    deviation_mm: Floats
    share: Floats
    is_bound: Flags

    def mean_share(self, cusp_mm: float) -> float:
        """Mean deviation of the layers that only the cusp limits, over the cusp; NaN if there are none."""
        free = self.deviation_mm[~self.is_bound]
        return float(free.mean() / cusp_mm) if len(free) else float("nan")


class Confirmation:
    """The search for the fewest layers whose walls keep the cusp.

    breaks : (b,) float, stations, ascending   boundaries that must be; the first and last are the part's ends.
    """

    def __init__(self, mesh: Mesh, stations: Stations, breaks: Floats, wanted: Wanted, touch: float) -> None:
        self.mesh, self.stations, self.breaks, self.wanted, self.touch = mesh, stations, breaks, wanted, touch
        self.tree = FacetTree(mesh)
        self.circles: Circles = facet_circles(mesh, stations, wanted.crease_deg, touch)
        self.least = wanted.min_mm / float(self.circles.rate.max())
        self.most = wanted.max_mm / float(self.circles.rate.max())
        self.stages = STAGES[wanted.rule]

    def run(self) -> Confirmed:
        """Estimate, measure and correct until the layers are few and right; then halve what is still too thick.

        A layer of least thickness may exceed the cusp: the bounds win, its deviation tells.
        Raises as `slice_mesh` and, for ruled walls, `stack_walls`.
        """
        scale = (self.breaks[:1], np.ones(1))
        best, known, fewest = self.breaks, WallDeviations.none(), np.inf
        for samples, rounds in self.stages:
            for _ in range(rounds):
                asked, drawn = self._boundaries(scale)
                measured = self._slabs(drawn[:-1], drawn[1:], samples)
                off = int(self._too_far(drawn, measured).sum())
                scale = self._corrected(scale, asked, drawn, measured)
                if samples == self.stages[-1][0] and len(drawn) + off < fewest:
                    best, known, fewest = drawn, measured, len(drawn) + off
                if off <= max(NEARLY * len(drawn), 1):
                    break
        return self._told(*self._joined(*self._split(best, known)))

    def _slabs(self, lower: Floats, upper: Floats, samples: int) -> WallDeviations:
        """What is measured of any slabs between stations, (k,) each."""
        planes, wanted = (self.stations.planes(lower), self.stations.planes(upper)), self.wanted
        if samples != AS_BUILT:
            found = slab_deviations(self.mesh, planes, wanted.rule, wanted.side, self.tree, samples)
            return replace(found, share=found.deviation_mm / wanted.cusp_mm)
        walls = measured_walls(self.mesh, *planes, style=wanted.contours, tree=self.tree)
        is_swept = np.array([item.deviation.is_swept for item in walls], dtype=bool)
        figures = np.array([_weighed(item.deviation, wanted.cusp_mm) for item in walls]).reshape(-1, 2)
        return WallDeviations(figures[:, 0], is_swept, figures[:, 1])

    def _too_far(self, boundaries: Floats, measured: WallDeviations) -> Flags:
        """Which slabs exceed what is allowed though they could be thinner."""
        return np.asarray((measured.share > 1.0) & (np.diff(boundaries) >= 2.0 * self.least))

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
        ratio = AIM / np.maximum(measured.share, 1e-9)
        thickness = np.diff(drawn)
        factor = np.clip(ratio**power, *_STEP) * np.minimum(thickness / asked, 1.0)
        is_last = np.isin(drawn[1:], self.breaks)  # what is left over of a span may be thinner than it need be
        factor[is_last | (thickness <= self.least * 1.001)] = np.minimum(factor, 1.0)[
            is_last | (thickness <= self.least * 1.001)
        ]
        return drawn[:-1], np.clip(before * factor, *_SCALE)

    def _split(self, boundaries: Floats, measured: WallDeviations) -> tuple[Floats, WallDeviations]:
        """Cut slabs that are too far off into equal parts until none is left that may be cut."""
        for _ in range(SPLITS):
            too_far = self._too_far(boundaries, measured)
            if not too_far.any():
                break
            parts = np.where(too_far, 2, 1)
            is_new = np.repeat(too_far, parts)
            within = np.arange(len(is_new)) - np.repeat(np.cumsum(parts) - parts, parts)
            step = np.repeat(np.diff(boundaries) / parts, parts)
            boundaries = np.append(np.repeat(boundaries[:-1], parts) + within * step, boundaries[-1])
            halves = self._slabs(boundaries[:-1][is_new], boundaries[1:][is_new], self.stages[-1][0])
            measured = measured.taken(np.repeat(np.arange(len(parts)), parts)).with_new(is_new, halves)
        return boundaries, measured

    def _joined(self, boundaries: Floats, measured: WallDeviations) -> tuple[Floats, WallDeviations]:
        """Join neighbouring slabs whose common wall keeps the cusp as well."""
        for _ in range(SPLITS):
            worth = ~np.isin(boundaries[1:-1], self.breaks)
            worth &= boundaries[2:] - boundaries[:-2] <= self.most + self.touch
            worth &= measured.share[1:] + measured.share[:-1] < JOINABLE
            for i in range(1, len(worth)):
                worth[i] &= not worth[i - 1]
            tried = np.flatnonzero(worth)
            together = self._slabs(boundaries[tried], boundaries[tried + 2], self.stages[-1][0])
            is_good = together.share <= 1.0
            kept = tried[is_good]
            if not len(kept):
                break
            is_new = np.zeros(len(measured.share), dtype=bool)
            is_new[kept] = True
            stays = np.delete(np.arange(len(measured.share)), kept + 1)
            measured = measured.with_new(is_new, together.taken(np.flatnonzero(is_good))).taken(stays)
            boundaries = np.delete(boundaries, kept + 1)
        return boundaries, measured

    def _told(self, boundaries: Floats, measured: WallDeviations) -> Confirmed:
        """The layers, with those that other bounds than the cusp limit."""
        thickness = np.diff(boundaries)
        is_bound = np.isin(boundaries[1:], self.breaks) | (thickness >= self.most * (1.0 - 1e-9) - self.touch)
        is_bound |= (thickness <= self.least * 1.001) | ((measured.share > 1.0) & (thickness < 2.0 * self.least))
        return Confirmed(boundaries, measured.deviation_mm, measured.share, is_bound)


def _weighed(found: WallDeviation, cusp_mm: float) -> tuple[float, float]:
    """The deviation of a layer, mm, and its share of what is allowed: the cusp or what the contours themselves have.

    Sections of the mesh that lie off their own contour by more than the cusp, in the plane of a surface that is nearly
    level, tell nothing of the layer: what there is to see is seen from the wall.
    """
    outward = float(found.wall_to_mesh.max(initial=0.0))
    inward = float(found.mesh_to_wall.max(initial=0.0))
    if cusp_mm < inward <= RIM * found.rim_mm[1]:
        inward = 0.0
    return max(outward, inward), max(outward / max(cusp_mm, RIM * found.rim_mm[0]), inward / cusp_mm)


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
