"""A job's life over REST: order, what it waits for, the table, re-runs, notes, attachments, tags and search."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import httpx
import pytest
import tomli_w

from cellctl.api.app import build_service
from cellctl.domain.jobs import ENDED, STEP_WORDS, STEPS, JobState
from cellctl.store import audit, dependencies, jobs, lanes, upgrade
from cellctl.store.ids import new_id
from cellctl.store.jobs import JobRow
from cellctl.store.lanes import Lane
from planner.recipe import Recipe
from tests.unit.cellctl.far_cell import FarCell
from tests.unit.cellctl.idle_planner import plan_at_once
from tests.unit.cellctl.test_store import part_in

J = JobState
RECIPE = {"process": "deposit", "tolerance_mm": 0.5, "cusp_mm": 0.2}
PNG = b"\x89PNG\r\n\x1a\n" + b"\0" * 40


def problem(answer: httpx.Response, status: int) -> str:
    assert answer.status_code == status, answer.text
    document = answer.json()
    assert document["title"] and document["hint"] and "\n" not in document["detail"]
    return str(document["detail"])


def job_of(store: Any, part_id: str, name: str, state: JobState = J.QUEUED, **fields: Any) -> str:
    """A job in the store that no worker touches."""
    toml = tomli_w.dumps(Recipe(**RECIPE).model_dump(mode="json", exclude_none=True))
    now = store.clock()
    with store.write() as rows:
        row = JobRow(new_id("job", now), name, part_id, "trunnion-tcp", toml, "316L", now, "me", state=state, **fields)
        return jobs.add(rows, row).id


@pytest.fixture
def still(web: Any) -> Any:
    """The web without a planner: what is submitted stays so."""
    plan_at_once(web.service, 0)
    return web


@pytest.fixture
def part_id(web: Any) -> str:
    return part_in(web.service.store)


@pytest.fixture
def abc(still: Any, part_id: str) -> list[str]:
    """Three queued jobs, in this order."""
    return [job_of(still.service.store, part_id, name, program_sha256="0" * 64) for name in "abc"]


@pytest.fixture
async def far(still: Any, tmp_path: Path) -> AsyncIterator[FarCell]:
    """A cell at the other end of the socket, IDLE."""
    cell = FarCell(still.service.settings.store, still.service.store.clock)
    await cell.open(tmp_path / "run" / "cell.sock")
    yield cell
    await cell.close()


async def order(web: Any, lane: str = "cell") -> list[str]:
    return [job["name"] for job in (await web.viewer.get("/api/v1/queue", params={"lane": lane})).json()["items"]]


async def move(web: Any, **body: Any) -> httpx.Response:
    answer: httpx.Response = await web.operator.post("/api/v1/queue/move", json=body)
    return answer


async def turn(web: Any, far: FarCell) -> None:
    """The cell shows itself, and the service follows and starts what may start."""
    link = web.service.link
    await far.show(lambda seq: link.snapshot is not None and link.snapshot.seq >= seq)
    await web.service.runs.follow()
    await web.service.runs._start_next()


async def starts(web: Any, far: FarCell, *expected: str) -> None:
    """The cell is given these jobs, in this order, and no other."""
    async with asyncio.timeout(20.0):
        while [one for one, *_ in far.started] != list(expected):
            assert len(far.started) < len(expected), far.started
            await turn(web, far)
    await turn(web, far)
    assert [one for one, *_ in far.started] == list(expected)


async def job(web: Any, job_id: str) -> dict[str, Any]:
    found: dict[str, Any] = (await web.viewer.get(f"/api/v1/jobs/{job_id}")).json()
    return found


def test_every_step_of_the_table_has_its_words() -> None:
    assert set(STEP_WORDS) == STEPS


@pytest.mark.parametrize(
    ("body", "after"),
    [
        ({"to": "up"}, "cab"), ({"to": "first"}, "cab"), ({"before": 0}, "cab"), ({"behind": 0}, "acb"), ({"position": 0}, "cab"),
        ({"position": 1}, "acb"), ({"to": "last"}, "abc"), ({"to": "down"}, "abc"), ({"position": 99}, "abc"),
    ],
)  # fmt: skip
async def test_the_last_of_three_is_moved_where_it_was_told(still: Any, abc: list[str], body: dict[str, Any], after: str) -> None:
    given = {name: abc[value] if name in ("before", "behind") else value for name, value in body.items()}
    assert (await move(still, job=abc[2], **given)).status_code == 200
    expected = "acb" if body == {"to": "up"} else after
    assert "".join(await order(still)) == expected


async def test_two_people_who_reorder_do_not_undo_one_another(still: Any, abc: list[str]) -> None:
    seen = (await still.viewer.get("/api/v1/queue")).json()["version"]
    first = await still.operator.post("/api/v1/queue/move", json={"job": abc[2], "to": "first", "version": seen})
    assert first.status_code == 200 and first.json()["version"] != seen
    body = {"job": abc[0], "to": "last"}
    assert "not as you saw it" in problem(await still.engineer.post("/api/v1/queue/move", json={**body, "version": seen}), 412)
    assert await order(still) == ["c", "a", "b"]
    again = await still.engineer.post("/api/v1/queue/move", json={**body, "version": first.json()["version"]})
    assert again.status_code == 200 and await order(still) == ["c", "b", "a"]


async def test_a_job_moved_among_those_of_another_priority_takes_theirs_on(still: Any, abc: list[str]) -> None:
    await still.operator.patch(f"/api/v1/jobs/{abc[2]}", json={"priority": 1})
    assert await order(still) == ["c", "a", "b"]
    await move(still, job=abc[1], to="first")
    assert await order(still) == ["b", "c", "a"] and (await job(still, abc[1]))["priority"] == 1


def test_ranks_are_spread_anew_where_no_room_is_left(web: Any, part_id: str) -> None:
    plan_at_once(web.service, 0)
    store = web.service.store
    made = [job_of(store, part_id, str(number)) for number in range(4)]
    with store.write() as rows:
        for turn_ in range(60):  # always into the same gap
            moved = made[turn_ % 2 + 1]
            stays = made[2 - turn_ % 2]
            lanes.insert_between(rows, Lane.CELL, moved, lanes.place_of(rows, Lane.CELL, made[0]), lanes.place_of(rows, Lane.CELL, stays))
            expected = [made[0], moved, stays, made[3]]
            assert [one.id for one in jobs.first_in(rows, J.QUEUED, 9)] == expected


async def test_a_move_of_what_does_not_stand_there_is_refused(still: Any, abc: list[str], part_id: str) -> None:
    waiting = job_of(still.service.store, part_id, "w", J.WAITING_FOR_APPROVAL)
    assert "does not stand in the queue of the cell" in problem(await move(still, job=waiting, to="up"), 409)
    assert "one of" in problem(await move(still, job=abc[0]), 422)
    assert "beside itself" in problem(await move(still, job=abc[0], before=abc[0]), 422)
    assert (await still.viewer.post("/api/v1/queue/move", json={"job": abc[0], "to": "up"})).status_code == 403


async def test_the_planner_takes_jobs_in_the_order_of_its_queue(still: Any, part_id: str) -> None:
    made = [job_of(still.service.store, part_id, name, J.SUBMITTED) for name in "xyz"]
    await still.operator.post("/api/v1/queue/move", params={"lane": "planning"}, json={"job": made[2], "to": "first"})
    assert await order(still, "planning") == ["z", "x", "y"]
    plan_at_once(still.service, 1)
    assert still.service.queue._waiting()[0].id == made[2]
    plan_at_once(still.service, 0)


async def test_what_a_queued_job_waits_for_is_told_in_words_and_as_data(still: Any, abc: list[str]) -> None:
    now = still.service.store.clock()
    edit = {"after": [{"job": abc[0]}, {"job": abc[1], "until": "cleared"}], "not_before": now + 3600.0}
    told = (await still.operator.patch(f"/api/v1/jobs/{abc[2]}", json=edit)).json()
    assert [wait["kind"] for wait in told["waits_for"]] == ["job", "job", "time", "table"]
    assert told["why"] == f"waits until a ({abc[0]}) is completed (it is queued)"
    assert "is cleared from the table" in told["waits_for"][1]["text"] and told["waits_for"][2]["at"] == pytest.approx(now + 3600.0)
    assert [(one["job"], one["met"]) for one in told["after"]] == [(abc[0], False), (abc[1], False)]
    await still.operator.post(f"/api/v1/jobs/{abc[0]}/cancel", json={"because": "wrong part"})
    blocked = (await job(still, abc[2]))["waits_for"][0]
    assert blocked["blocked"] and "will not be completed" in blocked["text"]
    free = (await still.operator.patch(f"/api/v1/jobs/{abc[2]}", json={"after": [], "not_before": None})).json()
    assert [wait["kind"] for wait in free["waits_for"]] == ["table"]


async def test_a_circle_of_dependencies_is_refused_and_named(still: Any, abc: list[str]) -> None:
    for here, on in ((0, 1), (1, 2)):
        await still.operator.patch(f"/api/v1/jobs/{abc[here]}", json={"after": [{"job": abc[on]}]})
    detail = problem(await still.operator.patch(f"/api/v1/jobs/{abc[2]}", json={"after": [{"job": abc[0]}]}), 409)
    assert "c waits for a waits for b waits for c" in detail
    assert "c waits for c" in problem(await still.operator.patch(f"/api/v1/jobs/{abc[2]}", json={"after": [{"job": abc[2]}]}), 409)
    assert (await job(still, abc[2]))["after"] == []


async def test_nothing_starts_on_a_table_that_nobody_confirmed(still: Any, abc: list[str], far: FarCell) -> None:
    for _ in range(3):
        await turn(still, far)
    assert far.started == []
    for one in abc:
        assert "a person confirms that the table is clear" in (await job(still, one))["why"]


async def test_the_second_job_waits_for_the_table_to_be_looked_at_again_after_the_first(still: Any, abc: list[str], far: FarCell) -> None:
    for one in abc[:2]:
        await still.operator.post(f"/api/v1/jobs/{one}/approve", json={"table_clear": True})
    await starts(still, far, abc[0])
    table = (await still.viewer.get("/api/v1/table")).json()
    assert table["job"] == abc[0] and "is being made on it" in table["text"]
    early = await still.operator.post(f"/api/v1/jobs/{abc[1]}/approve", json={"table_clear": True})
    assert "its part is on the table" in problem(early, 409)
    assert "on the cell" in problem(await still.operator.post("/api/v1/table/clear", json={}), 409)
    far.end("completed")
    for _ in range(3):
        await turn(still, far)
    assert len(far.started) == 1
    table = (await still.viewer.get("/api/v1/table")).json()
    assert table["job"] == abc[0] and table["next"] == abc[1] and "lies on it (completed)" in table["text"]
    cleared = (await still.operator.post("/api/v1/table/clear", json={"because": "part taken off", "start": abc[1]})).json()
    assert cleared["job"] is None and cleared["cleared_by"] == "the operator"
    await starts(still, far, *abc[:2])
    assert (await job(still, abc[0]))["cleared_at"] is not None


async def test_a_table_cleared_without_a_start_starts_nothing(still: Any, abc: list[str], far: FarCell) -> None:
    await still.operator.post("/api/v1/table/clear", json={"because": "swept"})
    for _ in range(2):
        await turn(still, far)
    assert far.started == []


async def test_a_job_waits_until_another_is_completed_and_its_part_is_cleared(still: Any, abc: list[str], far: FarCell) -> None:
    a, b, _ = abc
    await still.operator.patch(f"/api/v1/jobs/{a}", json={"after": [{"job": b, "until": "completed"}, {"job": b, "until": "cleared"}]})
    await still.operator.post(f"/api/v1/jobs/{a}/approve", json={"table_clear": True})
    await turn(still, far)
    assert far.started == [] and (await job(still, a))["table_clear"]
    by_hand = await still.operator.post("/api/v1/cell/start", json={"job": a, "table_clear": True})
    assert "waits until b" in problem(by_hand, 409)
    await still.operator.post("/api/v1/table/clear", json={"start": b})
    await starts(still, far, b)
    far.end("completed")
    await turn(still, far)
    assert [wait["until"] for wait in (await job(still, a))["waits_for"] if wait["kind"] == "job"] == ["cleared"]
    await still.operator.post("/api/v1/table/clear", json={"start": a})
    await starts(still, far, b, a)


@pytest.mark.parametrize("what", ["cell", "service"])
async def test_a_restart_starts_nothing_on_a_table_that_was_seen_before_it(still: Any, abc: list[str], far: FarCell, what: str) -> None:
    far.state = "UNHOMED"
    await still.operator.post(f"/api/v1/jobs/{abc[0]}/approve", json={"table_clear": True})
    await turn(still, far)
    if what == "cell":
        far.restart()
        far.state = "IDLE"
        await turn(still, far)
        assert far.started == [] and "the cell process was not there" in (await job(still, abc[0]))["why"]
        return
    with still.service.store.write() as rows:  # the service was away while a run of which it never heard was made and ended
        jobs.move(rows, abc[1], J.RUNNING, at=still.service.store.clock())
        jobs.move(rows, abc[1], J.COMPLETED, at=still.service.store.clock())
    far.state = "IDLE"
    again = build_service(still.service.settings)
    link = asyncio.create_task(again.link.run())
    try:
        await far.show(lambda seq: again.link.snapshot is not None and again.link.snapshot.seq >= seq)
        await again.runs._start_next()
        with again.store.read() as rows:
            after = jobs.get(rows, abc[0])
    finally:
        link.cancel()
        await asyncio.gather(link, return_exceptions=True)
        again.store.close()
    assert far.started == [] and not after.table_clear and "another part was made on it" in after.why


async def test_a_job_is_not_started_before_its_time(still: Any, abc: list[str], far: FarCell) -> None:
    now = still.service.store.clock()
    await still.operator.patch(f"/api/v1/jobs/{abc[0]}", json={"not_before": now + 600.0})
    await still.operator.post(f"/api/v1/jobs/{abc[0]}/approve", json={"table_clear": True})
    await turn(still, far)
    assert far.started == []
    await still.operator.patch(f"/api/v1/jobs/{abc[0]}", json={"not_before": now - 1.0})
    await starts(still, far, abc[0])


async def test_life_tells_every_step_with_its_reason_and_whose_doing_it_was(still: Any, part_id: str, far: FarCell) -> None:
    one = job_of(still.service.store, part_id, "a", J.WAITING_FOR_APPROVAL, proof={"passed": True}, program_sha256="0" * 64)
    await still.operator.post(f"/api/v1/jobs/{one}/approve", json={"because": "looks good", "table_clear": True})
    await starts(still, far, one)
    for state in ("HELD", "RUNNING", "HELD"):
        far.state = state
        await turn(still, far)
    told = await job(still, one)
    assert told["state"] == "held" and told["waits_for"][0] == {**told["waits_for"][0], "kind": "person", "text": "a person pressed hold"}
    far.end("aborted")
    await turn(still, far)
    steps = (await still.viewer.get(f"/api/v1/jobs/{one}/life")).json()["items"]
    states = [step["state"] for step in steps]
    assert states == ["waiting_for_approval", "queued", "running", "held", "running", "held", "aborted"]
    assert steps[1]["who"] == "the operator" and "looks good" in steps[1]["why"]
    assert [step["why"] for step in steps if step["state"] == "held"] == ["a person pressed hold"] * 2
    assert all(step["why"] for step in steps) and steps[-1]["lasted_s"] is None and all(step["lasted_s"] >= 0.0 for step in steps[:-1])
    assert all(before["state"] == after["left"] for before, after in pairwise(steps))


async def test_rerun_is_a_new_job_of_the_same_recipe_once_for_each_key(still: Any, part_id: str) -> None:
    first = job_of(still.service.store, part_id, "a", J.COMPLETED)
    answers = [await still.operator.post(f"/api/v1/jobs/{first}/rerun", json={}, headers={"Idempotency-Key": "k"}) for _ in range(2)]
    made = answers[0].json()
    assert [answer.status_code for answer in answers] == [201, 201] and answers[1].json()["id"] == made["id"] != first
    assert (made["state"], made["made_from"], made["made_how"]) == ("submitted", first, "rerun")
    assert made["recipe"] == (await job(still, first))["recipe"] and not made["table_clear"] and made["approved_by"] == ""
    with still.service.store.read() as rows:
        assert [deed["verb"] for deed in audit.of_target(rows, made["id"])] == ["rerun"]


async def test_clone_tells_what_differs_before_and_after_it_is_made(still: Any, part_id: str) -> None:
    first = job_of(still.service.store, part_id, "a", J.COMPLETED)
    body = {"recipe": {"tolerance_mm": 0.3, "cusp_mm": None}, "tags": ["trial"], "name": "finer"}
    shown = (await still.viewer.post(f"/api/v1/jobs/{first}/clone/changes", json=body)).json()
    made = (await still.operator.post(f"/api/v1/jobs/{first}/clone", json=body)).json()
    assert [(one["field"], one["before"], one["after"]) for one in shown["changes"]] == [("cusp_mm", 0.2, 0.04), ("tolerance_mm", 0.5, 0.3)]
    assert made["changes"] == shown["changes"] and made["recipe"] == shown["recipe"] and made["tags"] == ["trial"] and made["name"] == "finer"
    for bad in ({"tolerance_mm": -1}, {"tolerance": 1}, {"material": "../x"}, {"material": "unobtainium"}):
        assert next(iter(bad)) in problem(await still.operator.post(f"/api/v1/jobs/{first}/clone", json={"recipe": bad}), 422)


async def test_retry_takes_the_place_of_the_failed_job_and_not_of_one_that_ran(still: Any, part_id: str, abc: list[str]) -> None:
    store = still.service.store
    failed = job_of(store, part_id, "f", J.PROVING)
    with store.write() as rows:
        dependencies.replace(rows, abc[0], [(failed, dependencies.Until.COMPLETED)])
        jobs.move(rows, failed, J.FAILED, at=store.clock(), error={"title": "t", "detail": "d", "hint": ""}, why="")
    made = (await still.operator.post(f"/api/v1/jobs/{failed}/retry", json={})).json()
    assert (made["made_from"], made["made_how"], made["state"]) == (failed, "retry", "submitted")
    assert [one["job"] for one in (await job(still, abc[0]))["after"]] == [made["id"]]
    assert "not failed" in problem(await still.operator.post(f"/api/v1/jobs/{abc[0]}/retry", json={}), 409)


async def test_rest_of_an_interrupted_part_is_not_made_by_itself(still: Any, part_id: str) -> None:
    first = job_of(still.service.store, part_id, "a", J.INTERRUPTED)
    rest = job_of(still.service.store, part_id, "rest", J.COMPLETED, continues_job=first)
    for verb in ("rerun", "clone"):
        assert "cannot be made by itself" in problem(await still.operator.post(f"/api/v1/jobs/{rest}/{verb}", json={}), 409)


async def test_notes_are_added_in_order_and_never_changed(still: Any, abc: list[str]) -> None:
    url = f"/api/v1/jobs/{abc[0]}/notes"
    for person, text in ((still.operator, " new nozzle "), (still.engineer, "<b>ok</b>\nsecond line")):
        assert (await person.post(url, json={"text": text})).status_code == 201
    found = (await still.viewer.get(url)).json()["items"]
    assert [(note["who"], note["text"]) for note in found] == [("the operator", "new nozzle"), ("the engineer", "<b>ok</b>\nsecond line")]
    for text in ("", "  ", "a\0b", "x" * 4001):
        assert (await still.operator.post(url, json={"text": text})).status_code == 422
    assert (await still.viewer.post(url, json={"text": "x"})).status_code == 403
    assert (await still.operator.delete(url)).status_code == 405


@pytest.mark.parametrize(
    ("name", "data", "kind", "kept"),
    [
        ("melt pool.png", PNG, "image/png", "melt pool.png"),
        ("../../etc/passwd", b"root", "application/octet-stream", "passwd"),
        ("..\\..\\boot.ini", b"x", "application/octet-stream", "boot.ini"),
        ("page.html", b"<script>alert(1)</script>", "application/octet-stream", "page.html"),
        ("picture.png", b"<svg onload=alert(1)>", "application/octet-stream", "picture.png"),
        ('a"\r\nX: y.svg', b"<svg/>", "application/octet-stream", None),
        (".hidden", b"x", "application/octet-stream", "hidden"),
    ],
)
async def test_attachment_is_kept_under_its_hash_and_never_served_as_a_page(
    still: Any, abc: list[str], name: str, data: bytes, kind: str, kept: str | None
) -> None:
    url = f"/api/v1/jobs/{abc[0]}/attachments"
    made = await still.operator.post(url, files={"file": (name, data, "text/html")})
    assert made.status_code == 201, made.text
    one = made.json()
    assert one["kind"] == kind and one["bytes"] == len(data) and (kept is None or one["name"] == kept)
    assert not set('/\\"\r\n<>') & set(one["name"]) and still.service.store.blobs.attachment(one["sha256"]).read_bytes() == data
    for show in (False, True):
        got = await still.viewer.get(f"{url}/{one['id']}", params={"show": show})
        disposition = got.headers["content-disposition"]
        assert got.content == data and got.headers["content-type"] == kind and got.headers["x-content-type-options"] == "nosniff"
        assert disposition.startswith("inline" if show and kind == "image/png" else "attachment")
        assert "sandbox" in got.headers["content-security-policy"]


async def test_attachments_have_their_limits(still: Any, abc: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    url = f"/api/v1/jobs/{abc[0]}/attachments"
    monkeypatch.setattr("cellctl.api.job_threads.BYTES_MAX", 1000)
    monkeypatch.setattr("cellctl.api.job_threads.ATTACHMENTS_MAX", 1)
    assert "at most" in problem(await still.operator.post(url, files={"file": ("a", b"x" * 1001)}), 413)
    assert "empty" in problem(await still.operator.post(url, files={"file": ("a", b"")}), 422)
    assert (await still.operator.post(url, files={"file": ("a", b"x")})).status_code == 201
    assert "has 1" in problem(await still.operator.post(url, files={"file": ("b", b"y")}), 409)
    assert (await still.viewer.post(url, files={"file": ("a", b"x")})).status_code == 403
    assert (await still.operator.get(f"{url}/file-unknown")).status_code == 404
    assert list((still.service.store.blobs.folder / "staging").iterdir()) == []


async def test_search_and_filters_find_what_they_are_asked_for(still: Any, part_id: str) -> None:
    store = still.service.store
    bracket = job_of(store, part_id, "Bracket 100%", J.COMPLETED)
    gear = job_of(store, part_id, "Zahnrad_ä", J.QUEUED)
    await still.operator.patch(f"/api/v1/jobs/{gear}", json={"tags": ["  rush   order ", "größe", "rush order"]})
    await still.operator.post(f"/api/v1/jobs/{bracket}/notes", json={"text": "powder lot 4711"})

    async def found(**params: Any) -> list[str]:
        return [one["id"] for one in (await still.viewer.get("/api/v1/jobs", params=params)).json()["items"]]

    assert (await job(still, gear))["tags"] == ["größe", "rush order"]
    assert await found() == [gear, bracket]
    words = ({"text": "zahnrad"}, {"text": "RUSH"}, {"text": "größe"})
    for params in ({"tag": "rush order"}, {"state": "queued"}, {"tag": ["größe", "rush order"]}, *words):
        assert await found(**params) == [gear], params
    for params in ({"text": "4711"}, {"text": "100% bracket"}, {"state": "completed"}, {"created_to": store.clock(), "text": "bracket"}):
        assert await found(**params) == [bracket], params
    later = {"created_from": store.clock() + 9.0}
    for params in ({"text": "100_"}, {"tag": "rush"}, {"material": "Ti"}, {"part": "part-x"}, {"by": "nobody"}, later):
        assert await found(**params) == [], params
    assert await found(part=part_id, by="me", material="316L") == [gear, bracket]
    assert (await still.viewer.get("/api/v1/tags")).json()["items"] == {"größe": 1, "rush order": 1}


async def test_pages_in_queue_order_hold_every_job_once_while_others_come_and_go(still: Any, part_id: str) -> None:
    made = [job_of(still.service.store, part_id, f"j{number}") for number in range(7)]
    seen: list[str] = []
    cursor: str | None = None
    while True:
        params = {"sort": "queue", "state": "queued", "limit": 3} | ({"cursor": cursor} if cursor else {})
        page = (await still.viewer.get("/api/v1/jobs", params=params)).json()
        seen += [one["id"] for one in page["items"]]
        cursor = page["next"]
        job_of(still.service.store, part_id, "late")
        await still.operator.post(f"/api/v1/jobs/{seen[0]}/cancel", json={})
        if cursor is None or len(seen) >= 7:
            break
    assert seen[:7] == made


async def test_counts_by_state_follow_the_jobs(still: Any, part_id: str, abc: list[str]) -> None:
    await still.operator.post(f"/api/v1/jobs/{abc[0]}/cancel", json={})
    text = (await still.nobody.get("/metrics")).text
    if "cellctl_jobs" not in text:  # metrics may ask who is there
        text = (await still.viewer.get("/metrics")).text
    assert 'cellctl_jobs{state="queued"} 2.0' in text and 'cellctl_jobs{state="cancelled"} 1.0' in text


async def test_the_order_of_a_job_that_has_ended_cannot_be_changed_but_its_tags_can(still: Any, part_id: str) -> None:
    one = job_of(still.service.store, part_id, "a", J.COMPLETED)
    assert J.COMPLETED in ENDED
    assert "when it starts is decided" in problem(await still.operator.patch(f"/api/v1/jobs/{one}", json={"priority": 1}), 409)
    assert (await still.operator.patch(f"/api/v1/jobs/{one}", json={"tags": ["kept"]})).json()["tags"] == ["kept"]


def test_order_dependencies_notes_and_tags_are_there_when_the_store_is_opened_again(web: Any, part_id: str) -> None:
    from cellctl.store import open_store, threads

    store = web.service.store
    made = [job_of(store, part_id, name) for name in "ab"]
    with store.write() as rows:
        lanes.insert_between(rows, Lane.CELL, made[1], None, lanes.place_of(rows, Lane.CELL, made[0]))
        dependencies.replace(rows, made[0], [(made[1], dependencies.Until.CLEARED)])
        threads.add_note(rows, made[0], 1.0, "me", "kept")
        threads.set_tags(rows, made[0], ["x"])
        version = lanes.version(rows, Lane.CELL)
    upgrade(store.folder)
    other = open_store(store.folder)
    with other.read() as rows:
        assert [one.id for one in jobs.first_in(rows, J.QUEUED, 9)] == made[::-1]
        assert dependencies.of_jobs(rows, made)[made[0]][0].on_job == made[1]
        assert threads.notes_of(rows, made[0])[0].text == "kept" and jobs.get(rows, made[0]).tags == ["x"]
        assert lanes.version(rows, Lane.CELL) == version
    other.close()


async def test_no_job_is_ever_deleted_and_none_is_submitted_to_wait_for_what_will_not_come(still: Any, part_id: str) -> None:
    gone = job_of(still.service.store, part_id, "a", J.CANCELLED)
    assert (await still.admin.delete(f"/api/v1/jobs/{gone}")).status_code == 405
    body = {"part_id": part_id, "recipe": RECIPE, "after": [{"job": gone}]}
    assert "will not be completed" in problem(await still.operator.post("/api/v1/jobs", json=body), 409)
    assert [one["id"] for one in (await still.viewer.get("/api/v1/jobs")).json()["items"]] == [gone]
