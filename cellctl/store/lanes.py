"""The two queues of jobs and their order: for the planner (submitted) and for the cell (queued).

A job stands by (priority, rank, seq). A move gives it a rank between its new neighbours, so that no other row changes; only where no
room is left between two are the ranks of those that follow spread anew. Every change of a lane gives it a new version.
"""

from __future__ import annotations

import base64
import binascii
from enum import StrEnum

from sqlalchemy import ColumnElement, Connection, and_, func, insert, select, tuple_, update

from cellctl.domain.jobs import JobState
from cellctl.store.job_tables import queue_versions
from cellctl.store.pages import CursorError
from cellctl.store.schema import jobs

GAP = 2**20  # between two that join one after the other: room for twenty moves into one place before ranks are spread
SPREAD_FIRST, ROOM_LEAST = 16, 2**12  # jobs whose ranks are spread at least, and the room between two that this has to give
FIRST, LAST = 1, 9  # priorities


class Lane(StrEnum):
    """A queue of jobs."""

    PLANNING = "planning"
    CELL = "cell"


STATE_OF = {Lane.PLANNING: JobState.SUBMITTED, Lane.CELL: JobState.QUEUED}
LANE_OF = {state: lane for lane, state in STATE_OF.items()}
Place = tuple[int, int, int]  # priority, rank, seq
PLACE = (jobs.c.priority, jobs.c.rank, jobs.c.seq)


class NotInLaneError(Exception):
    """A job that does not stand in this queue."""

    def __init__(self, job_id: str, lane: Lane) -> None:
        super().__init__(f"{job_id} does not stand in the {'planning queue' if lane is Lane.PLANNING else 'queue of the cell'}")


def version(connection: Connection, lane: Lane) -> int:
    """Number of the lane's order as it is now."""
    return int(connection.execute(select(queue_versions.c.version).where(queue_versions.c.lane == lane.value)).scalar() or 0)


def changed(connection: Connection, lane: Lane) -> int:
    """The order of a lane changed; its new version."""
    row = queue_versions.c
    if connection.execute(update(queue_versions).where(row.lane == lane.value).values(version=row.version + 1)).rowcount == 0:
        connection.execute(insert(queue_versions).values(lane=lane.value, version=1))
    return version(connection, lane)


def joined_or_left(connection: Connection, *states: JobState) -> None:
    """A job went from one state to another, or was added in one."""
    for lane in {LANE_OF[state] for state in states if state in LANE_OF}:
        changed(connection, lane)


def last_rank(connection: Connection) -> int:
    """The greatest rank of all jobs."""
    return int(connection.execute(select(func.max(jobs.c.rank))).scalar() or 0)


def _in(lane: Lane, cell: str | None = None) -> ColumnElement[bool]:
    state = jobs.c.state == STATE_OF[lane].value
    return state if cell is None else and_(state, jobs.c.cell == cell)


def place_of(connection: Connection, lane: Lane, job_id: str) -> Place:
    """Where a job stands in a lane. Raises NotInLaneError."""
    row = connection.execute(select(*PLACE).where(_in(lane), jobs.c.id == job_id)).first()
    if row is None:
        raise NotInLaneError(job_id, lane)
    return (row[0], row[1], row[2])


def ahead_of(connection: Connection, lane: Lane, place: Place, cell: str | None = None) -> int:
    """How many stand before a place.  cell : here and below, among the jobs of one cell, None: of all"""
    query = select(func.count()).select_from(jobs).where(_in(lane, cell), tuple_(*PLACE) < tuple_(*place))
    return int(connection.execute(query).scalar_one())


def length(connection: Connection, lane: Lane, cell: str | None = None) -> int:
    """How many stand in a lane."""
    return int(connection.execute(select(func.count()).select_from(jobs).where(_in(lane, cell))).scalar_one())


def neighbour(connection: Connection, lane: Lane, place: Place, after: bool, cell: str | None = None) -> Place | None:
    """The place behind (or before) this one, None at the end."""
    here, order = tuple_(*PLACE), PLACE if after else tuple(column.desc() for column in PLACE)
    query = select(*PLACE).where(_in(lane, cell), here > tuple_(*place) if after else here < tuple_(*place)).order_by(*order).limit(1)
    row = connection.execute(query).first()
    return None if row is None else (row[0], row[1], row[2])


def at_position(connection: Connection, lane: Lane, position: int, without: str, cell: str | None = None) -> Place | None:
    """The place of the job that is `position`-th (from 0) among all but one, None behind the last."""
    query = select(*PLACE).where(_in(lane, cell), jobs.c.id != without).order_by(*PLACE).offset(position).limit(1)
    row = connection.execute(query).first()
    return None if row is None else (row[0], row[1], row[2])


def insert_between(connection: Connection, lane: Lane, job_id: str, before: Place | None, after: Place | None) -> None:
    """Put a job between two neighbours (None: none on that side): it takes a priority that fits there, and a rank between theirs.

    before : who stands right before its new place; after : who stands right behind it.
    """
    own = place_of(connection, lane, job_id)
    low, high = (before[0] if before else FIRST), (after[0] if after else LAST)
    priority = min(max(own[0], low), high)
    rank = _rank_between(before, after, priority, own[1])
    if rank is None:
        assert before is not None  # room is missing only between two
        spread_behind(connection, lane, before, job_id)
        rank = _rank_between(before, _again(connection, after), priority, own[1])
        assert rank is not None  # there is room now
    connection.execute(update(jobs).where(jobs.c.id == job_id).values(priority=priority, rank=rank))
    changed(connection, lane)


def _again(connection: Connection, place: Place | None) -> Place | None:
    if place is None:
        return None
    row = connection.execute(select(*PLACE).where(jobs.c.seq == place[2])).one()
    return (row[0], row[1], row[2])


def _rank_between(before: Place | None, after: Place | None, priority: int, own: int) -> int | None:
    """A rank that keeps the job between its neighbours, None if there is no room."""
    low = before[1] if before is not None and before[0] == priority else None
    high = after[1] if after is not None and after[0] == priority else None
    if low is None:
        return own if high is None else high - GAP
    if high is None:
        return low + GAP
    middle = (low + high) // 2
    return middle if low < middle < high else None


def spread_behind(connection: Connection, lane: Lane, place: Place, without: str) -> None:
    """Make room right behind a place: the jobs of its priority that follow are spread over the room that they have, as few as it takes."""
    behind = (_in(lane), jobs.c.priority == place[0], tuple_(jobs.c.rank, jobs.c.seq) > tuple_(place[1], place[2]), jobs.c.id != without)
    count = SPREAD_FIRST
    while True:
        query = select(jobs.c.seq, jobs.c.rank).where(*behind).order_by(jobs.c.rank, jobs.c.seq).limit(count + 1)
        found = connection.execute(query).all()
        moved = found[:count]
        room = found[count].rank - place[1] if len(found) > count else GAP * (len(moved) + 1)
        gap = room // (len(moved) + 1)
        if gap >= ROOM_LEAST or len(found) <= count:
            break
        count *= 4
    for number, row in enumerate(moved, 1):
        connection.execute(update(jobs).where(jobs.c.seq == row.seq).values(rank=place[1] + number * gap))


def set_priority(connection: Connection, job_id: str, priority: int) -> None:
    """Give a job in whatever state another priority; in a lane it keeps its rank among those of that priority."""
    state = JobState(connection.execute(select(jobs.c.state).where(jobs.c.id == job_id)).scalar_one())
    connection.execute(update(jobs).where(jobs.c.id == job_id).values(priority=priority))
    joined_or_left(connection, state)


def cursor_of(place: Place) -> str:
    """Opaque text for "what stands behind this place"."""
    return base64.urlsafe_b64encode("behind:{}:{}:{}".format(*place).encode()).decode().rstrip("=")


def place_in(cursor: str) -> Place:
    """The place in a cursor. Raises CursorError."""
    try:
        text = base64.b64decode(cursor + "=" * (-len(cursor) % 4), altchars=b"-_", validate=True).decode("ascii")
        word, priority, rank, seq = text.split(":")
        if word != "behind" or max(len(priority), len(rank), len(seq)) > 20:
            raise ValueError(text)
        place = (int(priority), int(rank), int(seq))
        if max(map(abs, place)) >= 2**63:
            raise ValueError(text)
        return place
    except (binascii.Error, ValueError):
        raise CursorError(f"{cursor[:40]!r} is no cursor of this list") from None
