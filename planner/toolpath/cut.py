"""The milling of tops and walls as operations, and what the cutter leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import shapely
from shapely import MultiPolygon

from planner.nurbs.offset import outset
from planner.plan import Operation, Pass, Process, Wall
from planner.process import Settings
from planner.slicing.regions import LayerRegion
from planner.toolpath.axis import ends_clear, goes_on_below, leans_inward, ruled_motions, steepest_lean
from planner.toolpath.bands import Band
from planner.toolpath.face import face_passes
from planner.toolpath.motion import Motion
from planner.toolpath.side import begun_on_flat, places, rest_passes, side_pass, swept_by, unreached, upright_passes

BULGE = 0.04
"""Of the bead's width: how far melt may run out beyond a track's nominal edge."""
OVERLAP_MM = 0.1  # by which a band reaches under its bottom where the same wall goes on there


def face_operation(
    metal: MultiPolygon, layer: LayerRegion, above_mm: float, settings: Settings, note: str = ""
) -> Operation | None:
    """Facing of a layer's top, in depths of at most the axial depth; None where there is nothing to face.

    metal : what stands there, bulge included, mm   above_mm : height of the metal over the plane.
    """
    depth = settings.material.milling.axial_depth_mm
    cuts = max(1, -int(-(above_mm - 1e-9) // depth))
    passes: list[Pass] = []
    for cut in range(cuts):
        passes.extend(face_passes(metal, layer.z_top + (cuts - cut - 1) * above_mm / cuts, settings))
    return _milled(Process.MILL_FACE, layer.index, passes, settings, note) if passes else None


def side_operations(
    band: Band, below: Sequence[LayerRegion], excess_mm: float, run_down_mm: float, settings: Settings
) -> tuple[list[Operation], list[Left]]:
    """Milling of a band's walls, with the small cutter after the other where the recipe names one, and what they leave.

    below : the finished layers under the band, from the lowest   excess_mm : metal outside the walls
    run_down_mm : how far its metal may have run down on a wall that leans inward.
    """
    small = settings.with_small_cutter()
    note: str = band.kind
    passes = _ruled_passes(band, below, excess_mm, run_down_mm, settings) if band.kind == "ruled" else []
    if not passes:
        note = "upright" if band.kind == "upright" else "stepped"
        passes = upright_passes(band.region, band.z_bottom, excess_mm, settings)
        if _may_reach_under(band, below, passes, settings):
            passes = upright_passes(band.region, band.z_bottom - OVERLAP_MM, excess_mm, settings)
    operations = [_milled(Process.MILL_SIDE, band.last, passes, settings, note)] if passes else []
    rest = _rest_passes(band, excess_mm, settings, small) if small is not None and note != "ruled" else []
    if rest and small is not None:
        operations.append(_milled(Process.MILL_SIDE, band.last, rest, small, f"{note}, rest"))
    left = _left_by_the_cutter(band, small if rest and small is not None else settings)
    if note == "stepped" or not operations:
        left.append(Left("cusps" if operations else "none", band.z_bottom, band.z_top, "", 0, 0.0))
    return operations, left


def _rest_passes(band: Band, excess_mm: float, settings: Settings, small: Settings) -> list[Pass]:
    """Upright passes with the small cutter where the other did not come."""
    missed = unreached(band.region, settings.cutter_radius_mm)
    pieces = [*missed.closed.geoms, *missed.corners.geoms]
    if not pieces:
        return []
    return rest_passes(band.region, MultiPolygon(pieces), band.z_bottom, excess_mm, small)


def _milled(process: Process, layer: int, passes: list[Pass], settings: Settings, note: str) -> Operation:
    return Operation(
        process,
        layer,
        tuple(passes),
        cutter_diameter_mm=settings.cutter_diameter_mm,
        spindle_rpm=settings.spindle_rpm,
        note=note,
    )


def _may_reach_under(band: Band, below: Sequence[LayerRegion], passes: list[Pass], settings: Settings) -> bool:
    """Whether the cutter's end, let down a little, would meet nothing that must stand."""
    if not below or not band.continues or not passes:
        return False
    swept = swept_by(passes, settings.cutter_radius_mm - 0.02)
    near = [layer.areas[2] for layer in below if layer.z_top > band.z_bottom - OVERLAP_MM]
    return all(shapely.intersection(swept, area).area < 1e-3 for area in near)


def _ruled_passes(
    band: Band, below: Sequence[LayerRegion], excess_mm: float, run_down_mm: float, settings: Settings
) -> list[Pass]:
    """Passes round all walls of a ruled band, wall by wall; none if the flank cannot follow one of them.

    The end of a leaning cutter rises away from the wall and leaves a wedge at the foot of what stands outside. Where the
    same wall goes on below, the cutter reaches under the wedge, and as far as metal may have run down on it; else an
    upright pass clears it.
    """
    passes = []
    for wall in band.walls:
        motions = _wall_motions(wall, band, below, excess_mm, run_down_mm, settings)
        if not motions:
            return []
        keep_out = outset(band.region, settings.cutter_radius_mm - 0.5)
        passes += [side_pass(begun_on_flat(motion), keep_out, excess_mm, settings) for motion in motions]
    if band.first == 0 or not band.continues:
        passes = [*upright_passes(band.region, band.z_bottom, excess_mm, settings), *passes]
    return passes


def _wall_motions(
    wall: Wall, band: Band, below: Sequence[LayerRegion], excess_mm: float, run_down_mm: float, settings: Settings
) -> list[Motion]:
    """The motions along one wall, as deep under its bottom as they may go."""
    others = [other for other in band.walls if other is not wall]
    wedge = OVERLAP_MM + excess_mm * steepest_lean(wall)
    if below and band.continues:
        deep = min(wedge + run_down_mm, band.z_bottom)
        if leans_inward(wall) and goes_on_below(wall, deep, below):
            motions = ruled_motions(wall, excess_mm, deep, 0.0, settings, others)
            if motions and ends_clear(motions, deep, below, settings.cutter_radius_mm):
                return motions
        if goes_on_below(wall, wedge, below):
            return ruled_motions(wall, excess_mm, wedge, None, settings, others)
    return ruled_motions(wall, excess_mm, 0.0, 0.0 if band.first == 0 else band.z_bottom, settings, others)


@dataclass(frozen=True)
class Left:
    """What side milling leaves in one band.  kind : "closed", "corners", "cusps" or "none"   volume_mm3 : of the metal."""

    kind: str
    z_bottom: float
    z_top: float
    place: str
    count: int
    volume_mm3: float


def _left_by_the_cutter(band: Band, settings: Settings) -> list[Left]:
    """What the cutter does not reach in the band's holes, slots and inside corners."""
    left = unreached(band.region, settings.cutter_radius_mm)
    height = band.z_top - band.z_bottom
    return [
        Left(kind, band.z_bottom, band.z_top, places(area), len(area.geoms), area.area * height)
        for kind, area in (("closed", left.closed), ("corners", left.corners))
        if area.geoms
    ]


def left_findings(left: list[Left], settings: Settings) -> list[str]:
    """One line for each run of touching bands that leave the same kind of thing."""
    runs: dict[str, list[list[Left]]] = {}
    for item in left:
        known = runs.setdefault(item.kind, [])
        if known and abs(known[-1][-1].z_top - item.z_bottom) < 1e-6:
            known[-1].append(item)
        else:
            known.append([item])
    diameter = settings.cutter_diameter_mm
    words = {
        "closed": f"holes or slots are narrower than the cutter (D {diameter:g} mm) and stay unmilled",
        "corners": f"inside corners keep the cutter's radius {0.5 * diameter:g} mm",
        "cusps": "the flank cannot follow the wall: it is milled upright outside it and keeps its steps",
        "none": "the cutter reaches no wall: side milling left out",
    }
    return [_left_line(run, words[kind]) for kind, found in runs.items() for run in found]


def _left_line(run: list[Left], words: str) -> str:
    height = f"z {run[0].z_bottom:.2f}-{run[-1].z_top:.2f} mm"
    most = max(item.count for item in run)
    if not most:
        return f"{height}: {words}"
    volume = sum(item.volume_mm3 for item in run)
    return f"{height}: {most} {words}, {volume:.1f} mm³, first at {run[0].place} mm"
