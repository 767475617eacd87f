"""Milling sacrificial support away when the piece stands: from which sides, level by level, part surfaces finished."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.decompose.solids import solid_of
from planner.mesh.findings import place_text
from planner.mesh.mesh import Mesh
from planner.plan import Operation, Process
from planner.process import Settings
from planner.toolpath.access import Access
from planner.toolpath.clearing_passes import level_passes
from planner.toolpath.metal import Metal
from planner.toolpath.roughing import box_mesh

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_PLATE_MM = 10.0  # of the substrate's thickness that can stand in a cutter's way
_ELEVATIONS_DEG = (0.0, 10.0, 20.0, 35.0)
"""Of the cutter above the base plane: level, it finishes undersides with its flank; raised, its holder clears the plate."""
_AZIMUTHS = 8
_COARSE_MM = 3.0  # levels by which directions are compared
_FINE_MM = 0.8  # levels by which it is told what one direction reaches
_MOST = 6  # directions that a support is cleared from
_RAISED = 4.0  # times the sine squared of its elevation: what a raised direction is worth less, terraces being needed
_LEAST_WEIGHT = 0.2
_WORTH = 0.015  # of the support: what a further direction must take away
_IN_VAIN = 3  # directions that clear less than was told from afar, after which no others are tried
_BODY = 0.012  # of the support: smaller bodies that a direction reaches by chance are not worth its levels
_LEFT_MM3 = 1.0  # less metal than this is rounding
_CORNER = 0.35  # of the cutter's radius: half the thickness of metal that it leaves in inside corners, at most
NOTE = "support"


@dataclass(frozen=True, eq=False)
class Clearing:
    """What is milled from one direction.

    direction : (3,) float, unit, from the part to the tool, piece frame
    piece_from_clearing : (4, 4) float, rigid, mm; in the clearing's frame z is the direction
    operation : in the clearing's frame, without ways between its passes; its layer is 0
    top_mm : highest of all that stands, plate included, in that frame: above it the tool moves freely
    removed_mm3 : of the support
    """

    direction: Floats
    piece_from_clearing: Floats
    operation: Operation
    top_mm: float
    removed_mm3: float


@dataclass(frozen=True, eq=False)
class Cleared:
    """How a support goes.

    clearings : in order   left : (n, 3) float, mm, middles of the cells of metal that no cutter reaches, piece frame
    left_mm3 : their volume   stuck_mm3 : of it, what is thicker than the rests in inside corners that every cutter leaves
    findings : one line each
    """

    clearings: tuple[Clearing, ...]
    left: Floats
    left_mm3: float
    stuck_mm3: float
    findings: tuple[str, ...]


def clearing(
    support: Mesh,
    stands: Mesh,
    settings: Settings,
    directions: ArrayLike | None = None,
    *,
    plate: Mesh | None = None,
    excess_mm: float | None = None,
) -> Cleared:
    """How support is milled away when everything stands.

    support : closed, mm, piece frame   stands : closed, what stays: the piece and what stands beside it
    directions : (k, 3) float, unit, towards the tool; None: level and raised ones all round, and straight down
    plate : closed mesh of the substrate; None: the recipe's, below z = 0 about the origin
    excess_mm : how far metal stands out of the support's faces; None: the allowance and half a bead.
    Directions are taken one after the other, that which clears most first, until nothing worth a set-up is left.
    Raises PlanningError if a mesh encloses no volume.
    """
    ways = default_directions() if directions is None else np.atleast_2d(np.asarray(directions, dtype=np.float64))
    metal = Metal.from_mesh(support)
    keep = solid_of(stands), solid_of(_plate(settings) if plate is None else plate)
    excess = _excess_mm(settings) if excess_mm is None else excess_mm
    cutters = [cutter for cutter in (settings, settings.with_small_cutter()) if cutter is not None]
    there = np.ones(len(metal.numbers), dtype=np.bool_)
    found: list[Clearing] = []
    for cutter in cutters:
        ranking = _Ranking([Access(way, *keep, metal, cutter) for way in ways])
        vain = 0
        while metal.volume_mm3(there) > _LEFT_MM3 and len(found) < _MOST and vain < _IN_VAIN:
            chosen = ranking.best(there, _WORTH * support.volume)
            if chosen is None:
                break
            done, gone = _cleared(chosen, there, excess, _BODY * support.volume)
            if done is None or done.removed_mm3 <= _BODY * support.volume:
                vain += 1
                continue
            found.append(done)
            there &= ~gone
    bodies = [body for body in metal.bodies(there) if len(body) * metal.cell_mm3 > _LEFT_MM3]
    corner = _CORNER * cutters[-1].cutter_radius_mm
    stuck = sum(len(body) for body in bodies if metal.half_thickness_mm(body) > corner) * metal.cell_mm3
    lines = (*_lines(found), *_left_lines(metal, bodies, corner))
    return Cleared(tuple(found), metal.points[there], metal.volume_mm3(there), stuck, lines)


def default_directions() -> Floats:
    """(k, 3) float   Unit directions that a cutter may come from, towards the tool; none from below the base plane."""
    turn = 2.0 * np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    rise = np.radians(_ELEVATIONS_DEG)[:, None]
    side = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise) + 0.0 * turn], axis=-1)
    return np.vstack([np.round(side.reshape(-1, 3), 12) + 0.0, [[0.0, 0.0, 1.0]]])


class _Ranking:
    """Directions by the metal that goes from them. What was found for one holds until it would be the best."""

    def __init__(self, seen: Sequence[Access]) -> None:
        self._seen = list(seen)
        self._gain = [np.inf] * len(seen)
        self._weight = [max(1.0 - _RAISED * float(access.direction[2]) ** 2, _LEAST_WEIGHT) for access in seen]

    def best(self, there: Flags, worth_mm3: float) -> Access | None:
        """The direction from which most of the metal goes, which is then used up; None if none is worth it.

        The first of equals. Raised ones count less: they leave steps on undersides, where a level flank leaves none.
        """
        told: set[int] = set()
        while True:
            top = max(range(len(self._seen)), key=lambda k: (round(self._gain[k] * self._weight[k], 3), -k))
            if top in told or self._gain[top] <= max(worth_mm3, _LEFT_MM3):
                break
            access = self._seen[top]
            self._gain[top] = access.metal.volume_mm3(access.reached(there, _COARSE_MM))
            told.add(top)
        if self._gain[top] <= max(worth_mm3, _LEFT_MM3):
            return None
        self._gain[top] = 0.0
        return self._seen[top]


def _cleared(access: Access, there: Flags, excess_mm: float, least_mm3: float) -> tuple[Clearing | None, Flags]:
    """What is milled from one direction, and which cells of the metal that removes.

    What the direction does not reach is left alone, so that no levels are spent on it, and kept clear of like the plate.
    least_mm3 : smaller bodies of metal are no goal.
    """
    settings, metal = access.settings, access.metal
    within = access.reached(there, _FINE_MM)
    goal = np.zeros(len(there), dtype=np.bool_)
    for body in metal.bodies(within):
        goal[body] = len(body) * metal.cell_mm3 > max(least_mm3, _LEFT_MM3)
    if metal.volume_mm3(goal) <= least_mm3:
        return None, goal
    passes, gone = level_passes(access, goal, there & ~within, excess_mm)
    if not passes:
        return None, gone
    operation = Operation(
        Process.MILL_SIDE,
        0,
        tuple(passes),
        cutter_diameter_mm=settings.cutter_diameter_mm,
        spindle_rpm=settings.spindle_rpm,
        note=NOTE,
    )
    back = np.asarray(np.linalg.inv(access.frame_from), dtype=np.float64)
    return Clearing(access.direction, back, operation, access.top_mm, metal.volume_mm3(gone)), gone


def _plate(settings: Settings) -> Mesh:
    half = 0.5 * np.array(settings.recipe.substrate_mm)
    return box_mesh(np.array([*-half, -_PLATE_MM]), np.array([*half, 0.0]))


def _excess_mm(settings: Settings) -> float:
    """How far deposited metal stands out of what was asked: the allowance and half of the widest usual bead."""
    return settings.allowance_mm + 0.5 * settings.bead_for(settings.layer_max_mm).width_mm


def _lines(found: Sequence[Clearing]) -> list[str]:
    if not found:
        return []
    text = ", ".join("(" + ", ".join(f"{value:.2g}" for value in done.direction + 0.0) + ")" for done in found)
    return [
        f"{sum(done.removed_mm3 for done in found):.0f} mm³ of support are milled away, the cutter coming from {text}"
    ]


def _left_lines(metal: Metal, bodies: Sequence[NDArray[np.int64]], corner_mm: float) -> list[str]:
    """One line for each of the three largest bodies that stay, and one for the others."""
    lines = []
    for body in bodies[:3]:
        points = metal.points[body]
        where = place_text(0.5 * (points.min(axis=0) + points.max(axis=0)))
        why = (
            "no cutter reaches it from any side past the part and the plate"
            if metal.half_thickness_mm(body) > corner_mm
            else "the cutter's radius leaves it in an inside corner"
        )
        lines.append(f"support at {where}, {len(body) * metal.cell_mm3:.0f} mm³: {why}: it stays")
    others = sum(len(body) for body in bodies[3:]) * metal.cell_mm3
    return [*lines, f"{others:.0f} mm³ of support stay in {len(bodies) - 3} smaller places"] if len(bodies) > 3 else lines
