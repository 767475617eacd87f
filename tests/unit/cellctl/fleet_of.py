"""Several hosts on one store, without their processes: each with an engine and a seat of its own, and one clock that the test turns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import msgspec
import tomli_w

from cellctl.domain.fleet import ANY
from cellctl.domain.jobs import JobState
from cellctl.planning import dispatcher
from cellctl.planning.needs import facts_of
from cellctl.store import Store, claims, fleet, jobs, versions
from cellctl.store.fleet import Seat, Told
from cellctl.store.ids import new_id
from cellctl.store.jobs import JobRow
from config import load_cell, load_material
from tests.unit.cellctl.test_store import part_in

J = JobState
RECIPE = 'schema_version = 1\nmaterial = "316L"\nprocess = "deposit"\nbuild_direction = [0.0, 0.0, 1.0]\n'
PLANNED = (J.PLANNING, J.PLANNED, J.POSTING, J.PROVING, J.PROVEN, J.WAITING_FOR_APPROVAL, J.QUEUED)


@cache
def facts() -> dict[str, Any]:
    """What each of the cells offers: the shipped trunnion's."""
    document: dict[str, Any] = msgspec.to_builtins(facts_of(load_cell("trunnion_tcp")))
    return document


def made_ready(store: Store) -> str:
    """A store with the shipped steel; the id of a part in it."""
    material = load_material("316L")
    with store.write() as rows:
        versions.see_shipped(rows, "316L", material.sha256, tomli_w.dumps(material.model_dump(mode="json", exclude_none=True)), 0.0, "came")
    return part_in(store)


def submit(store: Store, part_id: str, cell: str = ANY, **fields: Any) -> str:
    """A job for a cell, or for any."""
    wanted = {"cell": "", "cell_wanted": ANY} if cell == ANY else {"cell": cell, "cell_wanted": cell}
    with store.write() as rows:
        now = store.clock()
        told: dict[str, Any] = {**wanted, **fields, "recipe_toml": RECIPE, "material": "316L"}
        return jobs.add(rows, JobRow(id=new_id("job", now), name="job", part_id=part_id, created_at=now, created_by="me", **told)).id


def job_of(store: Store, job_id: str) -> JobRow:
    with store.read() as rows:
        return jobs.get(rows, job_id)


@dataclass
class Host:
    """One service: its beat, its share of dispatching, its moves. now : of the database, Unix s"""

    store: Store
    cell: str
    now: Callable[[], float]
    ran: list[str] = field(default_factory=list)

    @property
    def seat(self) -> Seat:
        return Seat(self.cell, f"owner of {self.cell}")

    def beat(self) -> list[str]:
        """As the service's keeper does it, in one transaction."""
        with self.store.write() as rows:
            now = self.now()
            fleet.tell(rows, Told(self.cell, self.seat.owner, facts={**facts(), "cell": self.cell}, state="IDLE"), now)
            members = fleet.members(rows, now)
            return dispatcher.free(rows, members, now) + dispatcher.dispatch(rows, members, now)

    def first(self, state: JobState) -> JobRow | None:
        with self.store.read() as rows:
            return next(iter(jobs.first_in(rows, state, 1, self.cell)), None)

    def move(self, job_id: str, *states: JobState, **changes: Any) -> JobRow:
        """Raises WrongCellError, WrongJobStateError."""
        with self.store.write() as rows:
            return jobs.move(rows, job_id, *states, at=self.now(), seat=self.seat, **changes)

    def claim(self, job_id: str) -> None:
        with self.store.write() as rows:
            claims.claim(rows, job_id, self.seat, self.now())

    def withdraw(self, job_id: str) -> None:
        with self.store.write() as rows:
            claims.withdraw(rows, job_id, self.seat)

    def on(self, store: Store) -> Host:
        """The same host with an engine of its own."""
        return replace(self, store=store)
