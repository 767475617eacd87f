"""The layers of an approximation: walls between planes, measured against the mesh, divided and joined until they keep the cusp."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from planner.matching import LayerWalls, RuledWall, event_heights, match_sections, stack_walls, wall_deviation
from planner.matching.branching import IN_PLANE_FRACTION, swept_curve
from planner.mesh.mesh import Mesh
from planner.mesh.nearest import FacetTree
from planner.nurbs.ruled import RuledSurface
from planner.slicing.confirm import Wanted
from planner.slicing.contours import ContourStyle, section_curves_many
from planner.slicing.section import Section
from planner.slicing.slicer import slice_mesh
from planner.slicing.thickness import confirmed_layers

Floats = NDArray[np.float64]
ModelRule = Literal["ruled", "extruded"]
Report = Callable[[str, float], None]

_ROUNDS = 8  # of dividing what lies too far off; each halves a layer
_JOINS = 4  # rounds of joining neighbours
_JOINABLE = (
    0.4  # of the cusp: a chord's deviation grows with the square of its length, so two equal ones add up to this
)
_PROBES = 24  # sections on which the style is tried
_SMOOTH_SHARE = 0.75  # of the budget that contours may take before there is a single layer
_CONTACT_ROUNDS = 3  # halvings of a layer whose walls would meet


@dataclass(frozen=True, eq=False)
class Slab:
    """One layer: its heights along the direction, mm, its walls, and how far they lie from the mesh, mm."""

    low: float
    high: float
    walls: LayerWalls
    deviation_mm: float


@dataclass(frozen=True)
class LayerLimits:
    """What layers keep: cusp_mm for the whole model, budget_mm of it for the walls, min_mm ... max_mm thick."""

    cusp_mm: float
    budget_mm: float
    min_mm: float
    max_mm: float


class LayerSearch:
    """The fewest layers along a direction whose walls stay within the budget.

    mesh : closed;  axis : (3,) float, unit;  rule, limits, style : see `planner.model.approximate`
    """

    def __init__(
        self, mesh: Mesh, axis: Floats, rule: ModelRule, limits: LayerLimits, style: ContourStyle, report: Report
    ) -> None:
        self.mesh, self.axis, self.rule, self.limits, self.style = mesh, axis, rule, limits, style
        self.report = report
        self.tree = FacetTree(mesh)
        self.touch = 4.0 * IN_PLANE_FRACTION * mesh.diagonal
        self.events = _apart(event_heights(mesh, axis), self.touch)

    def run(self) -> list[Slab]:
        """The layers from below.  Raises as `confirmed_layers` and `stack_walls`."""
        limits = self.limits
        self.report("layers", 0.0)
        self.style = self._style_within_budget()
        wanted = Wanted(limits.budget_mm, limits.min_mm, limits.max_mm, self.rule, "both", self.style.crease_deg)
        found = confirmed_layers(self.mesh, self.axis, wanted).stations
        far = np.abs(found[:, None] - self.events).min(axis=1) > self.touch
        heights = np.sort(np.concatenate([self.events, found[far]]))
        slabs = self.slabs_between(heights[:-1], heights[1:])
        for done in range(_ROUNDS):
            self.report("dividing", 0.2 + 0.05 * done)
            wide = [slab for slab in slabs if self.is_divisible(slab)]
            bad = [slab for slab in wide if slab.deviation_mm > limits.budget_mm]
            if done < _CONTACT_ROUNDS:
                bad += [slab for slab in wide if slab.walls.notes and slab not in bad]
            if not bad:
                break
            slabs = self.divided(slabs, bad)
        return self._joined(slabs)

    def _style_within_budget(self) -> ContourStyle:
        """The style asked for; along the facets where the smooth surface leaves them by more than the walls may."""
        span = self.events[[0, -1]]
        heights = span[0] + (span[1] - span[0]) * (np.arange(_PROBES) + 0.5) / _PROBES
        fitted = section_curves_many(slice_mesh(self.mesh, self._planes(heights)), self.mesh, self.style)
        off = max((item.deviation_mm for section in fitted for item in section), default=0.0)
        return self.style if off <= _SMOOTH_SHARE * self.limits.budget_mm else replace(self.style, fit="facets")

    def is_divisible(self, slab: Slab) -> bool:
        """Whether both halves of a layer would be as thick as they must be."""
        return bool(slab.high - slab.low >= 2.0 * self.limits.min_mm)

    def divided(self, slabs: list[Slab], bad: list[Slab]) -> list[Slab]:
        """The layers with some of them halved."""
        low, high = np.array([s.low for s in bad]), np.array([s.high for s in bad])
        middle = 0.5 * (low + high)
        kept = [slab for slab in slabs if slab not in bad]
        halves = self.slabs_between(np.concatenate([low, middle]), np.concatenate([middle, high]))
        return sorted([*kept, *halves], key=lambda slab: slab.low)

    def slabs_between(self, low: Floats, high: Floats) -> list[Slab]:
        """Layers between any pairs of heights, (k,) each, built and measured."""
        bottoms = slice_mesh(self.mesh, self._planes(low), "above")
        tops = slice_mesh(self.mesh, self._planes(high), "below")
        pairs = list(zip(bottoms, tops, strict=True))
        make = stack_walls if self.rule == "ruled" else extruded_walls
        walls = make(self.mesh, pairs, style=self.style)
        deviation = [wall_deviation(found, self.mesh, self.tree).max_mm for found in walls]
        return [Slab(*row) for row in zip(low.tolist(), high.tolist(), walls, deviation, strict=True)]

    def _planes(self, heights: Floats) -> Floats:
        return np.column_stack([heights[:, None] * self.axis, np.broadcast_to(self.axis, (len(heights), 3))])

    def _joined(self, slabs: list[Slab]) -> list[Slab]:
        """Neighbours made one where no event lies between them and their common wall keeps the budget as well."""
        limits = self.limits
        for done in range(_JOINS):
            self.report("joining", 0.6 + 0.05 * done)
            tried: list[int] = []
            for k in range(len(slabs) - 1):
                one, two = slabs[k], slabs[k + 1]
                if tried and tried[-1] == k - 1:
                    continue
                if two.high - one.low > limits.max_mm or (np.abs(self.events - one.high) <= self.touch).any():
                    continue
                if one.deviation_mm + two.deviation_mm <= _JOINABLE * limits.budget_mm and not one.walls.notes:
                    tried.append(k)
            if not tried:
                break
            low, high = np.array([slabs[k].low for k in tried]), np.array([slabs[k + 1].high for k in tried])
            good = {
                k: slab
                for k, slab in zip(tried, self.slabs_between(low, high), strict=True)
                if slab.deviation_mm <= limits.budget_mm and not slab.walls.notes
            }
            if not good:
                break
            slabs = [good.get(k, slab) for k, slab in enumerate(slabs) if k - 1 not in good]
        return slabs


def extruded_walls(mesh: Mesh, layers: Sequence[tuple[Section, Section]], *, style: ContourStyle) -> list[LayerWalls]:
    """Walls straight along the normal from the larger of both sections of each layer.

    layers : bottom (cut "above") and top (cut "below"), in parallel planes.  Source: paper §IV, zero order approximation.
    """
    used = [max(pair, key=lambda section: section.area_mm2) for pair in layers]
    fitted = section_curves_many(used, mesh, style)
    found = []
    for (bottom, top), section, curves in zip(layers, used, fitted, strict=True):
        walls = []
        for number, item in enumerate(curves):
            low = swept_curve(item.curve, bottom.plane, bottom.normal)
            high = swept_curve(item.curve, top.plane, top.normal)
            own = ((number,), ()) if section is bottom else ((), (number,))
            walls.append(RuledWall(RuledSurface(low, high), "swept", own[0], own[1], 0.0))
        loops = [[getattr(wall.surface, end) for wall in walls] for end in ("curve0", "curve1")]
        matching = match_sections(mesh, bottom, top)
        found.append(LayerWalls(bottom.plane, top.plane, matching, tuple(walls), tuple(loops[0]), tuple(loops[1])))
    return found


def _apart(heights: Floats, least: float) -> Floats:
    """Ascending heights without those nearer than `least` to the one kept before; the last one stays."""
    kept = [float(heights[0])]
    for height in heights[1:].tolist():
        if height - kept[-1] > least:
            kept.append(height)
    if len(kept) > 1:
        kept[-1] = max(kept[-1], float(heights[-1]))
    return np.array(kept)
