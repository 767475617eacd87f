"""Tools as solids of revolution about their axis: deposition head and cutter with its holder."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError

Floats = NDArray[np.float64]


class Shape(Protocol):
    """A solid of revolution about the tool axis."""

    @property
    def profile(self) -> Floats:
        """(k, 2) float, mm: height above the tip along the axis, never falling, and radius there; straight between rows."""
        ...


@dataclass(frozen=True)
class HeadShape:
    """A coaxial deposition head from the focus (the tip) upwards: air, the nozzle's cone, the cylinder of the body.

    The defaults are an ordinary coaxial nozzle; usual heads stand off 7 to 16 mm.
    """

    stand_off_mm: float = 13.0
    end_radius_mm: float = 6.0
    cone_half_angle_deg: float = 18.0
    body_radius_mm: float = 25.0
    body_length_mm: float = 120.0

    @property
    def profile(self) -> Floats:
        """(3, 2) float, mm: height above the tip, radius.  Raises InputError if the body is narrower than the nozzle's end."""
        if self.body_radius_mm < self.end_radius_mm or not 0.0 < self.cone_half_angle_deg < 90.0:
            raise InputError("a head narrows towards its tip", "give a body wider than the nozzle's end, a cone of 0 to 90 deg")
        cone = (self.body_radius_mm - self.end_radius_mm) / math.tan(math.radians(self.cone_half_angle_deg))
        body = self.stand_off_mm + cone
        return np.array(
            [
                [self.stand_off_mm, self.end_radius_mm],
                [body, self.body_radius_mm],
                [body + self.body_length_mm, self.body_radius_mm],
            ]
        )


@dataclass(frozen=True)
class CutterShape:
    """An end mill from the centre of its end upwards: flutes, shank, holder.

    shank_radius_mm : None: as the flutes
    """

    radius_mm: float = 4.0
    flute_length_mm: float = 20.0
    shank_radius_mm: float | None = None
    stick_out_mm: float = 40.0
    holder_radius_mm: float = 16.0
    holder_length_mm: float = 120.0

    @property
    def profile(self) -> Floats:
        """(6, 2) float, mm: height above the end, radius.  Raises InputError if the flutes are longer than what sticks out."""
        if self.flute_length_mm > self.stick_out_mm:
            raise InputError(
                f"flutes of {self.flute_length_mm:g} mm do not stick out of a holder by {self.stick_out_mm:g} mm",
                "give a larger stick-out",
            )
        shank = self.radius_mm if self.shank_radius_mm is None else self.shank_radius_mm
        end = self.stick_out_mm + self.holder_length_mm
        return np.array(
            [
                [0.0, self.radius_mm],
                [self.flute_length_mm, self.radius_mm],
                [self.flute_length_mm, shank],
                [self.stick_out_mm, shank],
                [self.stick_out_mm, self.holder_radius_mm],
                [end, self.holder_radius_mm],
            ]
        )
