"""Milling sacrificial support away when the piece stands: from which sides, level by level, part surfaces finished."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import manifold3d  # type: ignore[import-not-found,unused-ignore]
import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.decompose.solids import mesh_of_solid, solid_of
from planner.mesh.findings import place_text
from planner.mesh.mesh import Mesh
from planner.plan import Operation, Process
from planner.process import Settings
from planner.toolpath.access import Access
from planner.toolpath.clearing_passes import level_passes
from planner.toolpath.roughing import box_mesh

Floats = NDArray[np.float64]

_PLATE_MM = 10.0  # of the substrate's thickness that can stand in a cutter's way
_ELEVATIONS_DEG = (0.0, 20.0, 45.0)
"""Of the cutter above the base plane: level, it finishes undersides with its flank; raised, it clears the plate."""
_AZIMUTHS = 8
_COARSE_MM = 4.0  # levels by which directions are compared
_FINE_MM = 2.0  # levels by which it is told what one direction reaches
_MOST = 8  # directions that a support is cleared from
_WORTH = 0.01  # of the support: what a further direction must take away
_BODY = 0.008  # of the support: smaller bodies that a direction reaches by chance are not worth its levels
_LEFT_MM3 = 1.0  # less metal than this is rounding
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
    """How a support goes.  clearings : in order   left : closed mesh of what no cutter reaches, mm, piece frame, or None
    findings : one line each
    """

    clearings: tuple[Clearing, ...]
    left: Mesh | None
    left_mm3: float
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
    whole = solid_of(support)
    keep = solid_of(stands), solid_of(_plate(settings) if plate is None else plate)
    excess = _excess_mm(settings) if excess_mm is None else excess_mm
    cutters = [cutter for cutter in (settings, settings.with_small_cutter()) if cutter is not None]
    metal = whole
    found: list[Clearing] = []
    for cutter in cutters:
        seen = [Access(way, *keep, whole, cutter) for way in ways]
        while metal.volume() > _LEFT_MM3 and len(found) < _MOST:
            chosen = _best(seen, metal, _WORTH * whole.volume())
            if chosen is None:
                break
            seen.remove(chosen)
            done, metal = _cleared(chosen, keep, metal, excess, _BODY * whole.volume())
            if done is not None:
                found.append(done)
    left = float(metal.volume())
    if left <= _LEFT_MM3:
        return Cleared(tuple(found), None, 0.0, tuple(_lines(found)))
    rest = mesh_of_solid(metal)
    return Cleared(tuple(found), rest, left, (*_lines(found), *_left_lines(metal)))


def default_directions() -> Floats:
    """(k, 3) float   Unit directions that a cutter may come from, towards the tool; none from below the base plane."""
    turn = 2.0 * np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    rise = np.radians(_ELEVATIONS_DEG)[:, None]
    side = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise) + 0.0 * turn], axis=-1)
    return np.vstack([np.round(side.reshape(-1, 3), 12) + 0.0, [[0.0, 0.0, 1.0]]])


def _best(seen: Sequence[Access], metal: manifold3d.Manifold, worth_mm3: float) -> Access | None:
    """The direction from which most of the metal goes; the first of equals; None if none takes away enough.

    Level directions come first, as long as one of them is worth it: raised ones leave steps on undersides.
    """
    rises = sorted({round(float(access.direction[2]), 6) for access in seen})
    for rise in rises:
        best: tuple[float, Access] | None = None
        for access in (access for access in seen if round(float(access.direction[2]), 6) == rise):
            access.take(metal)
            levels = access.levels(_COARSE_MM)
            there = sum(access.section(float(z)).area for z in 0.5 * (levels[1:] + levels[:-1]))
            left = sum(region.area for region in access.left_at(levels))
            gone = (there - left) * float(levels[0] - levels[1])
            if gone > max(worth_mm3, _LEFT_MM3) and (best is None or gone > 1.02 * best[0]):
                best = (gone, access)
        if best is not None:
            return best[1]
    return None


def _cleared(
    access: Access,
    keep: tuple[manifold3d.Manifold, manifold3d.Manifold],
    metal: manifold3d.Manifold,
    excess_mm: float,
    least_mm3: float,
) -> tuple[Clearing | None, manifold3d.Manifold]:
    """What is milled from one direction, and the metal that stays.

    What the direction does not reach is left alone, so that no levels are spent on it, and kept clear of like the plate.
    least_mm3 : smaller bodies of metal are no goal.
    """
    settings = access.settings
    access.take(metal)
    levels = access.levels(_FINE_MM)
    stuck = access.without(levels, access.left_at(levels))
    bodies = [body for body in (metal - stuck).decompose() if body.volume() > max(least_mm3, _LEFT_MM3)]
    if not bodies:
        return None, metal
    goal = manifold3d.Manifold.batch_boolean(bodies, manifold3d.OpType.Add)
    part, plate = keep
    near = Access(access.direction, part, plate + stuck, goal, settings)
    passes, levels, left = level_passes(near, excess_mm)
    if not passes:
        return None, metal
    operation = Operation(
        Process.MILL_SIDE,
        0,
        tuple(passes),
        cutter_diameter_mm=settings.cutter_diameter_mm,
        spindle_rpm=settings.spindle_rpm,
        note=NOTE,
    )
    rest = (metal - goal) + near.without(levels, left)
    removed = float(metal.volume() - rest.volume())
    back = np.asarray(np.linalg.inv(access.frame_from), dtype=np.float64)
    return Clearing(access.direction, back, operation, access.top_mm, removed), rest


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


def _left_lines(metal: manifold3d.Manifold) -> list[str]:
    """One line for each body that stays, largest first, at most three."""
    bodies = sorted(metal.decompose(), key=lambda body: (-round(float(body.volume()), 3), body.bounding_box()))
    lines = []
    for body in bodies[:3]:
        if body.volume() > _LEFT_MM3:
            box = np.array(body.bounding_box())
            lines.append(
                f"support at {place_text(0.5 * (box[:3] + box[3:]))}, {body.volume():.0f} mm³: no cutter reaches it from any "
                "side past the part and the plate: it stays"
            )
    return lines
