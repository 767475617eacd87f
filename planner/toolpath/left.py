"""What milling leaves, and how that is told: one line for each run of bands that leave the same kind of thing."""

from __future__ import annotations

from dataclasses import dataclass

from shapely import MultiPolygon

from planner.process import Settings
from planner.toolpath.side import places, unreached


@dataclass(frozen=True)
class Left:
    """What side milling leaves in one band.

    kind : "closed", "corners", "beside", "unfaced", "flank", "fillets", "cusps" or "none"
    volume_mm3 : of the metal; of "beside" and "unfaced" the area, mm²; of "flank" and "fillets" how far the cutter is off, mm.
    """

    kind: str
    z_bottom: float
    z_top: float
    place: str
    count: int
    volume_mm3: float


def left_by_cutter(region: MultiPolygon, z_bottom: float, z_top: float, settings: Settings) -> list[Left]:
    """What an end mill does not reach in a region's holes, slots and inside corners between two heights, mm."""
    left = unreached(region, settings.cutter_radius_mm)
    return [
        Left(kind, z_bottom, z_top, places(area), len(area.geoms), area.area * (z_top - z_bottom))
        for kind, area in (("closed", left.closed), ("corners", left.corners))
        if area.geoms
    ]


def left_findings(left: list[Left], settings: Settings, *, by_layer: bool = False) -> list[str]:
    """One line for each run of touching bands that leave the same kind of thing.

    by_layer : z_bottom and z_top of each are its first layer and one past its last, of layers that turn.
    """
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
        "flank": "the flank on a twisted wall cuts into it",
        "fillets": "inside corners keep the ball's radius "
        f"{0.5 * (settings.recipe.ball_cutter_diameter_mm or 0.0):g} mm",
        "cusps": "the flank cannot follow the wall: it is milled upright in small steps",
        "beside": "what stands beside the wall keeps the cutter away",
        "unfaced": "what stands beside keeps the facing cutter away",
        "none": "the cutter reaches no wall: side milling left out",
    }
    return [_left_line(run, words[kind], by_layer) for kind, found in runs.items() for run in found]


def _left_line(run: list[Left], words: str, by_layer: bool) -> str:
    height = f"z {run[0].z_bottom:.2f}-{run[-1].z_top:.2f} mm"
    if by_layer:
        height = f"layers {run[0].z_bottom:.0f}-{run[-1].z_top - 1.0:.0f}"
    most = max(item.count for item in run)
    if run[0].kind == "unfaced":
        return f"{height}: {words}: {max(item.volume_mm3 for item in run):.1f} mm² of a top stay as deposited, at {run[-1].place} mm"
    if run[0].kind == "flank":
        return f"{height}: {words}: up to {max(item.volume_mm3 for item in run):.3f} mm"
    if run[0].kind == "fillets":
        most_off = max(run, key=lambda item: item.volume_mm3)
        return f"{height}: {words}: the ball stays up to {most_off.volume_mm3:.2f} mm off its place at {most_off.place} mm"
    if run[0].kind == "beside":
        return f"{height}: {words}: {sum(item.volume_mm3 for item in run):.0f} mm² of it stay as deposited"
    if not most:
        return f"{height}: {words}"
    volume = sum(item.volume_mm3 for item in run)
    return f"{height}: {most} {words}, {volume:.1f} mm³, first at {run[0].place} mm"
