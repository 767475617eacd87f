"""A part approximated by layers with ruled or upright sides: the whole as one closed model."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import RecipeError
from planner.matching import LayerWalls
from planner.matching.layer import SURFACE_STYLE
from planner.mesh.mesh import Mesh
from planner.model.closing import ClosedModel, closed_model
from planner.model.layering import LayerLimits, LayerSearch, ModelRule, Report, Slab
from planner.model.measuring import ModelDeviation, distances_between, two_way
from planner.slicing.contours import ContourStyle

Floats = NDArray[np.float64]

CHORD_SHARE = 1.0 / 20.0
"""Of the cusp: how far the model's triangles may lie from its surfaces."""
WALL_SHARE = 0.93
"""Of the cusp: what the walls may use; the rest is for the triangles, twice where both lie on the same side."""
_LEAST_SHARE = 0.25  # of the cusp: least thickness of a layer, unless it is given
_LEAST_EXTENT = 1e-4  # of the part's extent: the same, where that is more
_CHECKS = 4  # times that the whole is measured and what is too far off divided


@dataclass(frozen=True)
class ModelCounts:
    """Layers, contours in their bottom planes and the topmost, groups of contours that part, join, begin or end, and
    pairs of contours matched by the direct test and by the climb."""

    layers: int
    contours: int
    branchings: int
    openings: int
    direct: int
    indirect: int


@dataclass(frozen=True, eq=False)
class Approximation:
    """Layers that approximate a mesh.

    mesh : what they stand for   axis : (3,) float, unit, build direction   slabs : from below
    chord_mm : distance of the triangles from the surfaces that `triangles` keeps unless told otherwise
    """

    mesh: Mesh
    axis: Floats
    cusp_mm: float
    rule: ModelRule
    slabs: tuple[Slab, ...]
    chord_mm: float

    @property
    def layers(self) -> tuple[LayerWalls, ...]:
        """The walls of every layer, from below."""
        return tuple(slab.walls for slab in self.slabs)

    @property
    def notes(self) -> tuple[str, ...]:
        """One line for every layer whose walls could not be ruled as its contours ask."""
        return tuple(note for slab in self.slabs for note in slab.walls.notes)

    @property
    def counts(self) -> ModelCounts:
        """How many layers, contours, branchings and matches."""
        matched = [layer.matching for layer in self.layers]
        opening = ("begin", "end", "hole_opens", "hole_closes")
        return ModelCounts(
            layers=len(self.slabs),
            contours=sum(len(layer.bottom_loops) for layer in self.layers) + len(self.layers[-1].top_loops),
            branchings=sum(found.branching_count for found in matched) + self._jumps(),
            openings=sum(group.kind in opening for found in matched for group in found.groups),
            direct=sum(found.direct_count for found in matched),
            indirect=sum(found.indirect_count for found in matched),
        )

    def _jumps(self) -> int:
        """Planes between two layers in which the number of contours changes."""
        return sum(len(low.top_loops) != len(high.bottom_loops) for low, high in pairwise(self.layers))

    @cached_property
    def closed(self) -> ClosedModel:
        """The watertight model within chord_mm of the surfaces, with the origin of every facet."""
        return closed_model(self.layers, self.chord_mm)

    def triangles(self, chord_mm: float | None = None) -> Mesh:
        """The watertight model as a mesh within chord_mm of its surfaces.  Raises PlanningError if it does not close."""
        return self.closed.mesh if chord_mm is None else closed_model(self.layers, chord_mm).mesh

    def deviation(self, mesh: Mesh | None = None) -> ModelDeviation:
        """Two-way distance between the model's triangles and a mesh, its own unless another is given."""
        return two_way(self.closed.mesh, mesh or self.mesh)

    def export(self, path: str | Path, *, with_original: bool = False) -> None:
        """Write the model: .stl, .glb (with_original: the mesh as a second, transparent node) or .step.

        Raises InputError for another suffix, FileFormatError if the file cannot be written or the extra `cad` is missing.
        """
        from planner.files.model_file import write_model

        write_model(self, path, with_original=with_original)


def unreported(stage: str, share: float) -> None:
    """Progress that nobody watches.  stage : what is being done;  share : of all, 0 ... 1."""


def approximate(
    mesh: Mesh,
    direction: ArrayLike,
    cusp_mm: float,
    *,
    rule: ModelRule = "ruled",
    min_mm: float | None = None,
    max_mm: float | None = None,
    style: ContourStyle = SURFACE_STYLE,
    chord_mm: float | None = None,
    report: Report = unreported,
) -> Approximation:
    """Layers along a direction whose closed model lies within cusp_mm of the mesh, both ways.

    direction : (3,) float, any length;  rule : "ruled" (paper Eq. 19) or "extruded" walls
    min_mm, max_mm : bounds of a layer's thickness; None: a quarter of the cusp, and the part's extent. A plane goes to
    every level face and wherever contours change, however near to the next. The bounds win over the cusp.
    style : how contours are fitted;  chord_mm : of the triangles, None: a twentieth of the cusp
    Raises RecipeError for numbers that make no sense; PlanningError where the model does not close; else as
    `confirmed_layers` and `stack_walls`.
    Source: paper §IV-VI.
    """
    axis = np.asarray(direction, dtype=np.float64)
    if axis.shape != (3,) or not np.isfinite(axis).all() or not np.linalg.norm(axis) > 0.0:
        raise RecipeError(f"the build direction {direction!r} is no direction", "give three numbers, not all zero")
    axis = axis / np.linalg.norm(axis)
    if rule not in ("ruled", "extruded"):
        raise RecipeError(f"layer rule {rule!r}", 'choose "ruled" or "extruded"')
    if not (np.isfinite(cusp_mm) and cusp_mm > 0.0):
        raise RecipeError(f"a cusp of {cusp_mm} mm cannot be kept", "choose one above 0")
    chord = CHORD_SHARE * cusp_mm if chord_mm is None else chord_mm
    if not (np.isfinite(chord) and chord > 0.0):
        raise RecipeError(f"a chord error of {chord} mm cannot be kept", "choose one above 0")
    extent = float(np.ptp(mesh.vertices[mesh.facets.ravel()] @ axis))
    most = extent if max_mm is None else max_mm
    least = min(max(_LEAST_SHARE * cusp_mm, _LEAST_EXTENT * extent), most) if min_mm is None else min_mm
    limits = LayerLimits(cusp_mm, WALL_SHARE * cusp_mm, least, most)
    search = LayerSearch(mesh, axis, rule, limits, style, report)
    slabs = search.run()
    for check in range(_CHECKS):
        report("closing and measuring", 0.8 + 0.05 * check)
        found = Approximation(mesh, axis, cusp_mm, rule, tuple(slabs), chord)
        bad = [slab for slab in _too_far(found, search) if search.is_divisible(slab)]
        if not bad:
            break
        slabs = search.divided(slabs, bad)
    return Approximation(mesh, axis, cusp_mm, rule, tuple(slabs), chord) if bad else found


def _too_far(found: Approximation, search: LayerSearch) -> list[Slab]:
    """The layers in which the closed model and the mesh are farther apart than the cusp."""
    model = found.closed.mesh
    tree = search.tree
    ways = (distances_between(model, found.mesh, tree), distances_between(found.mesh, model))
    heights = [way.points[way.distance_mm > found.cusp_mm] @ found.axis for way in ways]
    height = np.concatenate(heights)
    tops = np.array([slab.high for slab in found.slabs])
    touched = np.unique(np.clip(np.searchsorted(tops, height), 0, len(tops) - 1))
    return [found.slabs[k] for k in touched.tolist()]
