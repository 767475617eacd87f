"""The cells on this store: one row each, written by the service of the cell; who wrote it last owns the cell while it is heard."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import Connection, RowMapping, delete, insert, select, text, update

from cellctl.domain.fleet import LEASE_S, is_dead, is_living
from cellctl.store.engine import StoreError
from cellctl.store.parts import NotFoundError
from cellctl.store.schema import fleet

DOCUMENTS = ("facts", "doing")


class LeaseHeldError(StoreError):
    """Another service runs this cell."""

    def __init__(self, cell: str, host: str, age_s: float) -> None:
        super().__init__(
            f"the cell {cell} is run by another service, at {host or 'an unknown host'}, heard {age_s:.1f} s ago",
            f"stop that service, or wait {LEASE_S:g} s after it has died; two services never run one cell",
        )


@dataclass(frozen=True)
class Seat:
    """Which cell's machinery speaks. owner : of the service; empty where none keeps a lease, then the cell alone is asked for"""

    cell: str
    owner: str = ""


class WrongCellError(Exception):
    """A job that is not this service's to move: it was given to another cell, or the cell to another service. Nothing was changed."""

    def __init__(self, job_id: str, cell: str, seat: Seat) -> None:
        whose = f"it is {cell}'s" if cell != seat.cell else "another service has that cell"
        super().__init__(f"{job_id} is not {seat.cell}'s to move any more: {whose if cell else 'it waits for a cell'}")


@dataclass(frozen=True)
class Told:
    """What a service tells of its cell.

    owner : of the service, the same as long as its store folder is    secret : by which other services of the fleet know it
    host_url : of its web process; stop_url : where its cell process listens for STOP, empty: on the page's own host
    certificate : PEM, by which both are known to the other hosts; empty: the authorities of their systems say
    facts : of `domain.fitting`; state : of the cell, empty while the cell process does not answer
    doing : {job, name, because, remaining_s, alarms}
    """

    cell: str
    owner: str
    secret: str = ""
    host_url: str = ""
    stop_url: str = ""
    certificate: str = ""
    software: str = ""
    cell_sha256: str = ""
    facts: dict[str, Any] = field(default_factory=dict)
    state: str = ""
    doing: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Member(Told):
    """A cell of the fleet as it was told last. heard_at : Unix s by the database's clock; age_s : since then"""

    heard_at: float = 0.0
    age_s: float = 0.0

    @property
    def is_living(self) -> bool:
        """Whether its service owns it, and it is given work."""
        return is_living(self.age_s)

    @property
    def is_dead(self) -> bool:
        """Whether what waits for it is given to others."""
        return is_dead(self.age_s)


def now_of(connection: Connection, clock: Callable[[], float]) -> float:
    """Unix time, s: the database's where several hosts share it, as theirs may differ; else `clock`, of the one host that there is."""
    if connection.dialect.name == "sqlite":
        return clock()
    return float(connection.execute(text("SELECT extract(epoch FROM clock_timestamp())")).scalar_one())


def _member(row: RowMapping, now: float) -> Member:
    fields = {name: json.loads(row[name]) if name in DOCUMENTS else row[name] for name in row}
    return Member(**fields, age_s=max(now - row["heard_at"], 0.0))


def members(connection: Connection, now: float) -> list[Member]:
    """All cells that a service on this store ever ran, by name."""
    return [_member(row, now) for row in connection.execute(select(fleet).order_by(fleet.c.cell)).mappings()]


def member(connection: Connection, cell: str, now: float) -> Member:
    """One cell. Raises NotFoundError."""
    row = connection.execute(select(fleet).where(fleet.c.cell == cell)).mappings().first()
    if row is None:
        raise NotFoundError("cell", cell)
    return _member(row, now)


def tell(connection: Connection, told: Told, now: float) -> None:
    """Write the row of a cell: a heartbeat, and the lease with it. Raises LeaseHeldError while another service is heard there."""
    check_lease(connection, told.cell, told.owner, now)
    values = {name: json.dumps(value) if name in DOCUMENTS else value for name, value in told.__dict__.items()}
    values["heard_at"] = now
    if connection.execute(update(fleet).where(fleet.c.cell == told.cell).values(**values)).rowcount == 0:
        connection.execute(insert(fleet).values(**values))


def check_lease(connection: Connection, cell: str, owner: str, now: float) -> None:
    """Raises LeaseHeldError while another service than `owner` is heard for this cell."""
    row = connection.execute(select(fleet.c.owner, fleet.c.host_url, fleet.c.heard_at).where(fleet.c.cell == cell)).first()
    if row is not None and row.owner not in ("", owner) and is_living(max(now - row.heard_at, 0.0)):
        raise LeaseHeldError(cell, row.host_url, max(now - row.heard_at, 0.0))


def is_owner(connection: Connection, cell: str, owner: str) -> bool:
    """Whether this service wrote the cell's row last: no other took the cell over since."""
    return connection.execute(select(fleet.c.owner).where(fleet.c.cell == cell)).scalar() == owner


def check_seat(connection: Connection, job_id: str, cell: str, seat: Seat) -> None:
    """Raises WrongCellError unless the job's cell is this service's, and nobody took the cell over."""
    if cell != seat.cell or (seat.owner and not is_owner(connection, seat.cell, seat.owner)):
        raise WrongCellError(job_id, cell, seat)


def leave(connection: Connection, cell: str, owner: str) -> None:
    """A service ends in order: another may take its cell over at once. What was given to the cell waits as after a death."""
    connection.execute(update(fleet).where(fleet.c.cell == cell, fleet.c.owner == owner).values(owner="", state=""))


def forget(connection: Connection, cell: str) -> None:
    """Take a cell that is no more out of the fleet; its service would put it in again."""
    connection.execute(delete(fleet).where(fleet.c.cell == cell))
