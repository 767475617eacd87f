"""How far an ordinary end mill sticks out of its holder, and how wide that is: what a cutter needs besides its own width."""

from __future__ import annotations

from planner.process import Settings

_CHUCK_MM = 12.0  # of a collet chuck's radius, around the cutter
_OUT_DIAMETERS = 5.0  # of the cutter: beyond that end mills chatter, so shops clamp them no longer


def stickout_mm(settings: Settings) -> float:
    """From the cutter's end to its holder."""
    return _OUT_DIAMETERS * settings.cutter_diameter_mm


def holder_radius_mm(settings: Settings) -> float:
    """Of the holder, about the cutter's axis: a collet chuck of the size that takes the cutter."""
    return _CHUCK_MM + settings.cutter_radius_mm
