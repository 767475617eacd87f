"""Documents of what a hand does at the machine: places, purge, aiming beam, touch-off, tools."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field

from cellctl.api.models import Because, Strict

Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]
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


class Point(Strict):
    """A touched point as the cell has told it. joints : machine coordinates per axis letter, mm or deg"""

    joints: dict[str, Coordinate] = Field(max_length=9)
    tool: int = Field(ge=1, le=99)


class PointAsked(Strict):
    """Read where the machine stands. tool : the one that touches; none: the one that the control says is mounted"""

    tool: int | None = Field(None, ge=1, le=99)


class TouchOff(Strict):
    """What is measured, and its points. axis : of "pivot"; tool, block_mm : of "tool" """

    kind: Literal["pivot", "plane", "origin", "tool"]
    axis: str | None = Field(None, max_length=1)
    tool: int | None = Field(None, ge=1, le=99)
    block_mm: float = Field(0.0, ge=0, le=500, description="height of the gauge block or feeler on the substrate")
    points: list[Point] = Field(max_length=50)


class Adoption(TouchOff):
    """The same, to stand from now on."""

    id: str | None = Ident
    because: str = Because


class TouchOffResult(BaseModel):
    """value, before, shift : (3,) mm; a pivot and an origin in the table frame, a tool's tip from the gauge point

    residuals_mm : per point; adoptable : within the cell file's bounds; why : if not
    """

    kind: str
    name: str
    value_mm: tuple[float, float, float]
    before_mm: tuple[float, float, float]
    shift_mm: tuple[float, float, float]
    residuals_mm: list[float]
    residual_mm: float
    tilt_deg: float
    adoptable: bool
    why: str


class ToolRow(BaseModel):
    """A tool as it stands, beside the cell file's. length_mm: from the gauge point to the tip; wear is taken off both"""

    number: int
    name: str
    kind: str
    filed_length_mm: float
    filed_diameter_mm: float
    length_mm: float
    diameter_mm: float
    length_wear_mm: float
    diameter_wear_mm: float
    measured: bool


class ToolAsked(Strict):
    """What was measured of a tool."""

    id: str | None = Ident
    because: str = Field(min_length=1, max_length=500)
    length_mm: float = Field(gt=0, le=1000)
    diameter_mm: float = Field(gt=0, le=200)
    length_wear_mm: float = Field(0.0, ge=0, le=1)
    diameter_wear_mm: float = Field(0.0, ge=0, le=1)


class MeasuredVersion(BaseModel):
    """One version of what was measured."""

    seq: int
    at: float
    who: str
    because: str
    what: str
    points: dict[str, Any]


class MeasuredState(BaseModel):
    """What stands, and how it came; newest version first."""

    cell_sha256: str
    part_origin_mm: tuple[float, float, float]
    pivots_mm: dict[str, tuple[float, float, float]]
    versions: list[MeasuredVersion]
