"""The documents of the fleet."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, Field


class FleetJob(BaseModel):
    """The job on a cell. remaining_s: predicted, null where it is not known"""

    id: str
    name: str
    remaining_s: float | None


class FleetCell(BaseModel):
    """A cell as its service told it last. here: the one of the host that answers; state: empty while its cell process does not answer."""

    cell: str
    here: bool
    path: str = Field(description="of its console, and of its interface before api/v1/, at the host that answers; empty: cannot be reached")
    url: str = Field(description="of its own host")
    state: str
    because: str
    job: FleetJob | None
    alarms: int
    queued: int = Field(description="jobs that are given to it and have not begun")
    age_s: float = Field(description="since its service was heard")
    heard: Literal["living", "silent", "dead"] = Field(
        description="living: it is given work; silent: not heard of late; dead: what waits for any cell is given to others"
    )
    software: str
    facts: dict[str, Any] = Field(description="what is asked whether a job fits it: volume, materials, processes, tools")


class Fleet(BaseModel):
    """The cells of a house, by name. shared: several can be here; unassigned: jobs for any cell that none was chosen for yet."""

    shared: bool
    here: str
    unassigned: int
    cells: list[FleetCell]
