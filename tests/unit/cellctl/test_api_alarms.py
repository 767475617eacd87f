"""Alarms over REST: incidents from the events of any version, filters and pages, and the word that one was seen."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from alembic import command
from alembic.config import Config
from sqlalchemy import insert

import cellctl.store
from cellctl.domain.messages import Reply
from cellctl.store import Store, alarms, open_store, trends, upgrade
from cellctl.store.engine import DATABASE, open_engine
from cellctl.store.schema import events
from tests.unit.cellctl.conftest import Web

START = 1_700_000_000.0


def tell(store: Store, at: float, kind: str, text: str = "", job: str = "", **data: Any) -> None:
    with store.write_cell() as rows:
        rows.execute(insert(events).values(at=START + at, kind=kind, text=text, job=job, data=json.dumps(data)))


def alarm(store: Store, at: float, code: str, job: str = "", **data: Any) -> None:
    tell(store, at, "alarm", f"cause {code}", job, code=code, detail="", remedy="", shown_remedy=f"mend {code}", **{"instead_of": [], **data})


@pytest.fixture
def told(web: Web) -> Web:
    """Three incidents: laser told before the door that explains it; a feeder; one that is latched and half seen."""
    store = web.service.store
    alarm(store, 1.0, "laser_lost", "job-1")
    alarm(store, 1.2, "door", "job-1", instead_of=["laser_lost"], line=41, layer=2)
    alarm(store, 3.0, "estop", "job-1")
    tell(store, 9.0, "reset", "op resets", who="op", codes=["door", "estop"], because="closed it")
    alarm(store, 20.0, "feeder_silent", "job-2")
    tell(store, 25.0, "reset", "op resets", who="op", codes=["feeder_silent"])  # as versions before wrote it
    tell(store, 25.0, "state", "RESETTING: cable", state="RESETTING", trigger="reset", because="cable")
    alarm(store, 40.0, "chiller")
    tell(store, 41.0, "acknowledge", "op has seen", who="op", codes=["chiller"])
    alarm(store, 42.0, "store")
    alarm(store, 43.0, "chiller")  # told again after a restart
    return web


async def test_incidents_are_told_newest_first_with_first_cause_what_followed_and_who_reset_them(told: Web) -> None:
    latched, feeder, door = (await told.viewer.get("/api/v1/cell/alarms")).json()["items"]
    assert (door["first"]["code"], door["first"]["instead_of"], door["at"]) == ("door", ["laser_lost"], START + 1.0)
    assert (door["first"]["line"], door["first"]["layer"], door["job"]) == (41, 2, "job-1")
    assert [one["code"] for one in door["followed"]] == ["estop"] and door["duration_s"] == pytest.approx(8.0)
    assert (door["reset_by"], door["because"]) == ("op", "closed it")
    assert (feeder["first"]["remedy"], feeder["because"], feeder["first"]["acknowledged_by"]) == ("mend feeder_silent", "cable", "")
    assert latched["ended_at"] is None and latched["first"]["code"] == "chiller" and latched["first"]["acknowledged_by"] == "op"
    assert [(one["code"], one["acknowledged_by"]) for one in latched["followed"]] == [("store", "")]


async def test_history_is_filtered_by_cause_job_and_time_and_comes_in_pages(told: Web) -> None:
    async def codes(**params: Any) -> list[str]:
        return [item["first"]["code"] for item in (await told.viewer.get("/api/v1/cell/alarms", params=params)).json()["items"]]

    assert await codes(code="estop") == ["door"] and await codes(job="job-2") == ["feeder_silent"]
    assert await codes(**{"from": START + 10.0, "to": START + 30.0}) == ["feeder_silent"]
    seen: list[int] = []
    params: dict[str, Any] = {"limit": 1}
    while True:
        page = (await told.viewer.get("/api/v1/cell/alarms", params=params)).json()
        seen += [item["id"] for item in page["items"]]
        if page["next"] is None:
            break
        params["cursor"] = page["next"]
    assert len(seen) == 3 == len(set(seen)) and seen == sorted(seen, reverse=True)


async def test_acknowledging_tells_the_cell_what_nobody_has_seen_and_is_audited(told: Web, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[Any] = []

    async def command_(verb: str, who: str, because: str, args: Any = None, *_: Any, **__: Any) -> Reply:
        sent.append((verb, args))
        tell(told.service.store, 50.0, "acknowledge", "seen", who=who, codes=args["codes"])
        return Reply("x", True)

    monkeypatch.setattr(told.service.link, "command", command_)
    ident = (await told.viewer.get("/api/v1/cell/alarms")).json()["items"][0]["id"]
    for _ in range(2):
        answer = await told.operator.post(f"/api/v1/cell/alarms/{ident}/acknowledge", json={"because": "I look at it"})
        assert answer.status_code == 200, answer.text
        assert answer.json()["followed"][0]["acknowledged_by"] == "the operator" and answer.json()["first"]["acknowledged_by"] == "op"
        assert answer.json()["ended_at"] is None
    assert sent == [("acknowledge", {"codes": ["store"]})]
    with told.service.store.read() as rows:
        outcomes = rows.exec_driver_sql("SELECT outcome FROM audit WHERE verb = 'acknowledge' ORDER BY seq").scalars().all()
    assert outcomes == ["ok", "was acknowledged already"]


@pytest.mark.parametrize(("ident", "status"), [("999", 404), ("4", 404), ("0", 422), ("x", 422)])
async def test_an_alarm_that_there_is_not_is_refused(told: Web, ident: str, status: int) -> None:
    assert (await told.operator.post(f"/api/v1/cell/alarms/{ident}/acknowledge", json={})).status_code == status


async def test_a_viewer_may_read_but_not_acknowledge_and_without_the_cell_it_is_said(told: Web) -> None:
    ident = (await told.viewer.get("/api/v1/cell/alarms")).json()["items"][0]["id"]
    assert (await told.viewer.get(f"/api/v1/cell/alarms/{ident}")).status_code == 200
    assert (await told.viewer.post(f"/api/v1/cell/alarms/{ident}/acknowledge", json={})).status_code == 403
    assert (await told.operator.post(f"/api/v1/cell/alarms/{ident}/acknowledge", json={})).status_code == 503


def test_a_store_of_an_earlier_version_shows_its_alarms_and_its_samples_after_the_upgrade(tmp_path: Path) -> None:
    upgrade(tmp_path)  # makes the folders
    (tmp_path / DATABASE).unlink()
    config = Config()
    config.set_main_option("script_location", str(Path(cellctl.store.__file__).parent / "migrations"))
    config.attributes["engine"] = engine = open_engine(tmp_path / DATABASE)
    command.upgrade(config, "0003")
    engine.dispose()
    data = json.dumps({"code": "door", "detail": "", "remedy": ""})
    with closing(sqlite3.connect(tmp_path / DATABASE)) as db, db:
        db.execute("INSERT INTO events (at, kind, text, job, data) VALUES (?, 'alarm', 'The door is open', 'j', ?)", (START, data))
        db.executemany("INSERT INTO journal (at, job, state, laser_readback_w) VALUES (?, 'j', 'RUNNING', 700.0)", [(START + k,) for k in range(30)])
    upgrade(tmp_path)
    store = open_store(tmp_path)
    try:
        with store.read_cell() as rows:
            (one,) = alarms.incidents(rows, None, 10)
            found = trends.trend(rows, START, START + 60.0, 100, ("laser_readback_w", "tip_speed_mm_s"))
    finally:
        store.close()
    assert (one.first.code, one.first.cause, one.first.line, one.job) == ("door", "The door is open", None, "j")
    assert (found.mean[:, 0] == 700.0).all() and len(found.at) == 30 and (found.mean[:, 1] != found.mean[:, 1]).all()
