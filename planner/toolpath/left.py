"""What milling leaves, and how that is told: one line for each run of bands that leave the same kind of thing."""

from __future__ import annotations

from dataclasses import dataclass

import shapely
from shapely import MultiPolygon

from planner.process import Settings
from planner.toolpath.side import DRAWN_IN_MM, places, unreached


@dataclass(frozen=True)
class Left:
    """What side milling leaves in one band.

    kind : "closed", "corners", "beside", "unfaced", "flank", "fillets", "cusps" or "none"
    volume_mm3 : of the metal; of "beside" and "unfaced" the area, mm²; of "flank" and "fillets" how far the cutter is off, mm
    radius_mm : of the cutter that leaves it; 0: the usual one   width_mm : of "closed" the widest circle that has room in any of it.
    """

    kind: str
    z_bottom: float
    z_top: float
    place: str
    count: int
    volume_mm3: float
    radius_mm: float = 0.0
    width_mm: float = 0.0


def left_by_cutter(region: MultiPolygon, z_bottom: float, z_top: float, settings: Settings) -> list[Left]:
    """What an end mill does not reach in a region's holes, slots and inside corners between two heights, mm."""
    radius = settings.cutter_radius_mm
    left = unreached(region, radius)
    return [
        Left(kind, z_bottom, z_top, places(area), len(area.geoms), area.area * (z_top - z_bottom), radius, _width(area))
        for kind, area in (("closed", left.closed), ("corners", left.corners))
        if area.geoms
    ]


def _width(area: MultiPolygon) -> float:
    """Diameter of the largest circle in any piece of a region, mm, with what its outline was drawn in by."""
    return max(2.0 * (float(shapely.maximum_inscribed_circle(piece, 0.01).length) + DRAWN_IN_MM) for piece in area.geoms)


def left_findings(left: list[Left], settings: Settings, *, by_layer: bool = False) -> list[str]:
    """One line for each run of touching bands that leave the same kind of thing.

    by_layer : z_bottom and z_top of each are its first layer and one past its last, of layers that turn.
    """
    runs: dict[str, list[list[Left]]] = {}
    for item in left:
        known = runs.setdefault(item.kind, [])
        touches = known and abs(known[-1][-1].z_top - item.z_bottom) < 1e-6
        if touches and known[-1][-1].radius_mm == item.radius_mm:
            known[-1].append(item)
        else:
            known.append([item])
    words = {
        "closed": "holes or slots are narrower than the cutter (D {cutter:g} mm) and stay unmilled, the widest {width:.2f} mm",
        "corners": "inside corners keep the cutter's radius {radius:g} mm",
        "flank": "the flank on a twisted wall cuts into it",
        "fillets": "inside corners keep the ball's radius "
        f"{0.5 * (settings.recipe.ball_cutter_diameter_mm or 0.0):g} mm",
        "cusps": "the flank cannot follow the wall: it is milled upright in small steps",
        "beside": "what stands beside the wall keeps the cutter away",
        "unfaced": "what stands beside keeps the facing cutter away",
        "none": "the cutter reaches no wall: side milling left out",
    }
    lines = []
    for kind, found in runs.items():
        for run in found:
            radius = run[0].radius_mm or settings.cutter_radius_mm
            width = max(item.width_mm for item in run)
            lines.append(_left_line(run, words[kind].format(cutter=2.0 * radius, radius=radius, width=width), by_layer))
    return lines


def _left_line(run: list[Left], words: str, by_layer: bool) -> str:
    height = f"z {run[0].z_bottom:.2f}-{run[-1].z_top:.2f} mm"
    if by_layer:
        height = f"layers {run[0].z_bottom:.0f}-{run[-1].z_top - 1.0:.0f}"
    fullest = max(run, key=lambda item: item.count)
    if run[0].kind == "unfaced":
        return f"{height}: {words}: {max(item.volume_mm3 for item in run):.1f} mm² of a top stay as deposited, at {run[-1].place} mm"
    if run[0].kind == "flank":
        return f"{height}: {words}: up to {max(item.volume_mm3 for item in run):.3f} mm"
    if run[0].kind == "fillets":
        most_off = max(run, key=lambda item: item.volume_mm3)
        return f"{height}: {words}: the ball stays up to {most_off.volume_mm3:.2f} mm off its place at {most_off.place} mm"
    if run[0].kind == "beside":
        return f"{height}: {words}: {sum(item.volume_mm3 for item in run):.0f} mm² of it stay as deposited"
    if not fullest.count:
        return f"{height}: {words}"
    volume = sum(item.volume_mm3 for item in run)
    which = "at" if fullest.count <= 3 else "the first three at"
    return f"{height}: {fullest.count} {words}, {volume:.1f} mm³, {which} {fullest.place} mm"
