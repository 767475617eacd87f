"""Documents of estimates, recipe schemas and a plan's figures. Times are seconds; every number has its unit in its name."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, Field

from cellctl.api.models import Strict


class EstimateAsked(Strict):
    """With which recipe; what it leaves out comes from the material."""

    recipe: dict[str, Any] = Field(default_factory=dict)


class CostParts(BaseModel):
    """In `currency`, by the rates of the cell and the material; total is the sum."""

    currency: str
    machine: float
    powder: float
    gas: float
    total: float


class MissingRate(BaseModel):
    """A rate that nobody has stated: no cost is shown until it stands in that file."""

    file: Literal["cell", "material"]
    name: str
    field: str
    unit: str


class EstimateTold(BaseModel):
    """What a part would take, before it is planned. times_s: deposit, mill, changes, interpass, waits; ranges: within which its
    plan is expected; direction: of the first piece, part frame; uncertainty: of the time, relative; basis: how it was found."""

    part_id: str
    material: str
    process: str
    layers: int
    thickness_mm: list[float]
    direction: list[float]
    pieces: int
    setups: int
    build_time_s: float
    time_range_s: list[float]
    times_s: dict[str, float]
    laser_s: float
    powder_g: float
    powder_range_g: list[float]
    mass_g: float
    deposited_mm3: float
    milled_mm3: float
    gas_l: float
    cost: CostParts | None
    missing: list[MissingRate]
    uncertainty: float
    basis: list[str]


class LayerFigures(BaseModel):
    """One layer of a plan: lengths without ways between passes, times at the programmed feed, powder fed."""

    index: int
    subcomponent: int
    z_top_mm: float
    direction: list[float]
    thickness_mm: list[float]
    deposit_mm: float
    mill_mm: float
    deposit_s: float
    mill_s: float
    link_s: float
    powder_g: float


class ProcessFigures(BaseModel):
    """All operations of one process with one tool. cutter_diameter_mm: 0 of the deposition head"""

    process: str
    cutter_diameter_mm: float
    operations: int
    passes: int
    length_mm: float
    time_s: float


class PlanFigures(BaseModel):
    """A plan in figures, by layer and by process."""

    part: str
    material: str
    layers: list[LayerFigures]
    processes: list[ProcessFigures]
    totals: dict[str, float]
    volumes_mm3: dict[str, float]
