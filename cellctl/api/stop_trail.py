"""STOPs that came to the cell's own listener, taken over from its events into the audit trail: each once, however often either side restarts.

The cell writes its event and waits for nobody. The row of the trail names the number of the event, and both are as durable as the
trail: what was taken over is read from there.
"""

from __future__ import annotations

import asyncio
import re

import structlog
from sqlalchemy import Connection, select
from sqlalchemy.exc import DBAPIError

from cellctl.domain.messages import Event
from cellctl.store import Store, audit, history
from cellctl.store.audit import Deed
from cellctl.store.schema import audit as trail
from cellctl.store.schema import events

LISTENER = "stop listener"  # who, in the cell's events; no client of a person is named with it
PERIOD_S = 5.0
BATCH = 200
TAKEN = re.compile(r"ok: event ([0-9]+)")
log = structlog.get_logger(__name__)


def is_from_listener(event: Event) -> bool:
    """Whether an event of the cell tells a STOP that came without the web process."""
    data = event.data
    is_stop = event.kind == "command" and data.get("verb") == "stop"
    return is_stop and not data.get("client") and str(data.get("who", "")).startswith(LISTENER)


class StopTrail:
    """Call `run` as one task; `take` for each event as it comes. cell : name of the cell whose events lie in the store"""

    def __init__(self, store: Store, cell: str) -> None:
        self._store = store
        self._cell = cell
        self._wake = asyncio.Event()

    def take(self, event: Event) -> None:
        """The cell told an event."""
        if is_from_listener(event):
            self._wake.set()

    async def run(self) -> None:
        """Take over, for ever; a store that refuses is asked again."""
        while True:
            self._wake.clear()
            try:
                while await asyncio.to_thread(self.take_over) == BATCH:
                    pass
            except (DBAPIError, OSError) as error:
                log.warning("STOPs wait to be written into the trail", error=str(getattr(error, "orig", error)))
            except Exception:
                log.exception("stop trail")
            try:
                async with asyncio.timeout(PERIOD_S):
                    await self._wake.wait()
            except TimeoutError:
                pass

    def take_over(self) -> int:
        """Write down the next STOPs; how many there were."""
        with self._store.read() as rows:
            last = self._last(rows)
        with self._store.read_cell() as rows:
            found = _after(rows, last)
        if not found:
            return 0
        with self._store.write() as rows:
            if self._last(rows) != last:  # another wrote some of them meanwhile
                return BATCH
            for event in found:
                origin = str(event.data["who"]).removeprefix(LISTENER).strip()
                deed = Deed(LISTENER, "", origin, "stop", self._cell, str(event.data.get("because") or ""))
                audit.add(rows, deed, event.at, f"ok: event {event.seq}")
        return len(found)

    def _last(self, rows: Connection) -> int:
        """Number of the last event that was taken over; 0 where none was."""
        mine = (trail.c.target == self._cell, trail.c.who == LISTENER, trail.c.verb == "stop")
        told = rows.execute(select(trail.c.outcome).where(*mine).order_by(trail.c.seq.desc()).limit(1)).scalar()
        found = TAKEN.fullmatch(told or "")
        return int(found[1]) if found is not None else 0


def _after(rows: Connection, last: int) -> list[Event]:
    """The first STOPs of the listener after an event, in order; from the begin where the cell's events began anew."""
    begin = last if last <= history.last_seq(rows) else 0
    query = select(events).where(events.c.kind == "command", events.c.seq > begin, events.c.data.contains(LISTENER, autoescape=True))
    found: list[Event] = []
    for row in rows.execution_options(yield_per=BATCH).execute(query.order_by(events.c.seq)).mappings():
        event = history.event_of(row)
        if is_from_listener(event):
            found.append(event)
        if len(found) == BATCH:
            break
    return found
