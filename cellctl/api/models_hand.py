"""Documents of what a hand does at the machine: places, purge, aiming beam."""

from __future__ import annotations

from pydantic import Field

from cellctl.api.models import Because, Strict

Ident = Field(None, min_length=1, max_length=100, description="id of the command: said twice it is carried out once")


class GoTo(Strict):
    """Send the machine to a place of the cell file. feed : mm/min or deg/min"""

    id: str | None = Ident
    because: str = Because
    place: str = Field(min_length=1, max_length=40)
    feed: float | None = Field(None, gt=0, le=100_000)


class Purge(Strict):
    """Powder and gas for a while; powder 0 is a gas test. Flows that are not given are the cell file's."""

    id: str | None = Ident
    because: str = Because
    seconds: float = Field(5.0, gt=0, le=600)
    powder_g_min: float = Field(0.0, ge=0, le=1000)
    carrier_l_min: float | None = Field(None, ge=0, le=1000)
    shield_l_min: float | None = Field(None, ge=0, le=1000)


class PilotAsked(Strict):
    """The aiming beam on (for a while) or off."""

    id: str | None = Ident
    because: str = Because
    on: bool
    seconds: float | None = Field(None, gt=0, le=3600)


class Told(Strict):
    """A command without anything to say."""

    id: str | None = Ident
    because: str = Because
