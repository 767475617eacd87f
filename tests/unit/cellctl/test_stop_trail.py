"""A STOP at the cell's own listener is in the audit trail once, by whom as far as that is known and from where, and waited for nothing."""

from __future__ import annotations

import json
from typing import Any

from sqlalchemy import insert

from cellctl.api.stop_trail import BATCH, LISTENER, StopTrail
from cellctl.store import Store, audit
from cellctl.store.audit import Wanted
from cellctl.store.schema import events


def told(store: Store, who: str, verb: str = "stop", client: str = "", because: str = "STOP pressed") -> None:
    """The cell process writes an event of a command, as `Commands._note` does."""
    data = {"id": "1", "verb": verb, "who": who, "client": client, "because": because}
    with store.write_cell() as rows:
        rows.execute(insert(events).values(at=store.clock(), kind="command", text=f"{who}: {verb}", data=json.dumps(data)))


def rows_of(store: Store) -> list[Any]:
    with store.read() as rows:
        found = audit.find_page(rows, Wanted(LISTENER, "stop", None, None, None), None, 1000)[0]
        assert not audit.verify(rows).fault
        return list(reversed(found))


def test_a_stop_of_the_listener_is_taken_over_once_also_after_a_restart_of_either_side(store: Store) -> None:
    told(store, f"{LISTENER} 10.0.0.7", because="smoke")
    told(store, "anna", client="anna/desk")
    told(store, "anna", verb="hold", client="anna/desk", because=f"{LISTENER} was pressed")
    told(store, f"{LISTENER} ben", client="ben/desk")  # whoever calls himself so is a person, and has his own row already
    trail = StopTrail(store, "c")
    assert (trail.take_over(), trail.take_over()) == (1, 0)
    assert StopTrail(store, "c").take_over() == 0, "the web process was restarted"
    told(store, f"{LISTENER} 10.0.0.8")
    assert StopTrail(store, "c").take_over() == 1, "the cell stopped while the web process was away"
    found = rows_of(store)
    assert [(row["origin"], row["because"], row["target"]) for row in found] == [("10.0.0.7", "smoke", "c"), ("10.0.0.8", "STOP pressed", "c")]


def test_many_stops_are_all_taken_over_in_order(store: Store) -> None:
    for number in range(BATCH + 3):
        told(store, f"{LISTENER} 10.0.0.{number}")
    trail = StopTrail(store, "c")
    assert (trail.take_over(), trail.take_over(), trail.take_over()) == (BATCH, 3, 0)
    assert [row["origin"] for row in rows_of(store)] == [f"10.0.0.{number}" for number in range(BATCH + 3)]


def test_events_that_begin_anew_are_taken_over_from_their_begin(store: Store) -> None:
    for number in range(3):
        told(store, f"{LISTENER} 10.0.0.{number}")
    StopTrail(store, "c").take_over()
    with store.write_cell() as rows:
        rows.exec_driver_sql("DELETE FROM events")
        rows.exec_driver_sql("DELETE FROM sqlite_sequence WHERE name = 'events'")
    told(store, f"{LISTENER} 10.0.0.9")
    assert StopTrail(store, "c").take_over() == 1 and rows_of(store)[-1]["origin"] == "10.0.0.9"
