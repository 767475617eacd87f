"""The cells on a store: one row each, one owner each while it is heard."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from cellctl.domain.fleet import LEASE_S
from cellctl.store import Store, fleet, open_store, upgrade
from cellctl.store.fleet import LeaseHeldError, Told
from cellctl.store.parts import NotFoundError

T = 1_800_000_000.0
OURS = Told("a", "ours", host_url="http://one:8000", facts={"materials": ["316L"]}, state="IDLE", doing={"alarms": 0})
THEIRS = Told("a", "theirs", host_url="http://two:8000")


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    upgrade(tmp_path / "store")
    opened = open_store(tmp_path / "store", lambda: T)
    yield opened
    opened.close()


def tell(store: Store, told: Told, at: float) -> None:
    with store.write() as rows:
        fleet.tell(rows, told, at)


def test_a_cell_reads_back_as_it_was_told_with_its_age(store: Store) -> None:
    tell(store, OURS, T)
    with store.read() as rows:
        (member,) = fleet.members(rows, T + 3.0)
        assert {name: getattr(member, name) for name in OURS.__dict__} == OURS.__dict__
        assert (member.heard_at, member.age_s) == (T, 3.0)
        with pytest.raises(NotFoundError, match="nobody"):
            fleet.member(rows, "nobody", T)


def test_the_same_service_tells_as_often_as_it_likes_and_another_one_is_refused_while_it_is_heard(store: Store) -> None:
    tell(store, OURS, T)
    tell(store, OURS, T + 1.0)
    with pytest.raises(LeaseHeldError) as refused:
        tell(store, THEIRS, T + 1.0 + LEASE_S - 0.1)
    assert refused.value.message == "the cell a is run by another service, at http://one:8000, heard 9.9 s ago"
    with store.read() as rows:
        assert fleet.is_owner(rows, "a", "ours") and not fleet.is_owner(rows, "a", "theirs")


def test_a_cell_that_is_not_heard_any_more_is_taken_over_and_its_late_owner_is_refused(store: Store) -> None:
    tell(store, OURS, T)
    tell(store, THEIRS, T + LEASE_S)
    with store.read() as rows:
        assert fleet.is_owner(rows, "a", "theirs") and not fleet.is_owner(rows, "a", "ours")
    with pytest.raises(LeaseHeldError, match="http://two:8000"):
        tell(store, OURS, T + LEASE_S + 1.0)


def test_a_service_that_ended_in_order_keeps_nobody_waiting(store: Store) -> None:
    tell(store, OURS, T)
    with store.write() as rows:
        fleet.leave(rows, "a", "theirs")  # not its own: nothing happens
        assert fleet.is_owner(rows, "a", "ours")
        fleet.leave(rows, "a", "ours")
    tell(store, THEIRS, T + 0.1)


def test_a_cell_of_another_name_is_nobody_elses_matter(store: Store) -> None:
    tell(store, OURS, T)
    tell(store, Told("b", "theirs"), T)
    with store.write() as rows:
        assert [one.cell for one in fleet.members(rows, T)] == ["a", "b"]
        fleet.forget(rows, "a")
        assert [one.cell for one in fleet.members(rows, T)] == ["b"]
