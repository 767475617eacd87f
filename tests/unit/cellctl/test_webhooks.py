"""Webhooks against a receiver that checks what it gets: signed, in order, none left out, again until it is taken."""

from __future__ import annotations

import base64
import hmac
import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy import insert

from cellctl.api.webhook_delivery import GIVEN_UP_S, Deliveries, signature
from cellctl.store import Store, history, jobs, open_store, parts, webhooks
from cellctl.store.backup import back_up, restore
from cellctl.store.ids import new_id
from cellctl.store.jobs import JobRow
from cellctl.store.parts import Inspection, PartRow
from cellctl.store.schema import events
from tests.unit.cellctl.conftest import Web
from tests.unit.cellctl.test_api_parts import assert_problem

PATH = "/api/v1/webhooks"
NOW = 1_800_000_000.0


@dataclass
class Receiver:
    """What listens outside. It checks every signature by itself. status : that it answers with, one after the other, then the last one"""

    secret: str = ""
    status: list[int] = field(default_factory=lambda: [204])
    got: list[dict[str, Any]] = field(default_factory=list)
    ids: list[str] = field(default_factory=list)

    def answer(self, request: httpx.Request) -> httpx.Response:
        ident, at = request.headers["webhook-id"], request.headers["webhook-timestamp"]
        mac = hmac.new(base64.b64decode(self.secret[6:]), ident.encode() + b"." + at.encode() + b"." + request.content, "sha256")
        assert request.headers["webhook-signature"] == "v1," + base64.b64encode(mac.digest()).decode()
        status = self.status.pop(0) if len(self.status) > 1 else self.status[0]
        if status == 0:
            raise httpx.ConnectError("nobody listens", request=request)
        self.ids.append(ident)
        if status < 300:
            self.got.append(json.loads(request.content))
        return httpx.Response(status, headers={"Location": "http://elsewhere/"})


def happen(store: Store, *texts: str, kind: str = "alarm") -> None:
    with store.write_cell() as rows:
        for text in texts:
            rows.execute(insert(events).values(at=NOW, kind=kind, text=text, job="", data="{}"))


def hooked(store: Store, receiver: Receiver, *topics: str) -> str:
    with store.read_cell() as rows:
        newest = history.last_seq(rows)
    with store.write() as rows:
        hook, receiver.secret = webhooks.create(rows, "http://receiver/path", topics, NOW, "ada", newest)
    return hook.id


def look(store: Store, hook: str) -> webhooks.Hook:
    with store.read() as rows:
        return webhooks.get(rows, hook)


def deliveries(store: Store, receiver: Receiver, at: float = NOW) -> Deliveries:
    return Deliveries(replace(store, clock=lambda: at), transport=lambda: httpx.MockTransport(receiver.answer))


def test_the_signature_is_that_of_the_specifications_own_example() -> None:
    secret = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"
    assert signature(secret, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1614265330, b'{"test": 2432232314}') == "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="


async def test_a_receiver_is_told_what_it_wants_in_order_from_its_begin_on(store: Store) -> None:
    receiver = Receiver()
    happen(store, "before it was added")
    hook = hooked(store, receiver, "cell.alarm")
    happen(store, *(f"alarm {k}" for k in range(120)))
    happen(store, "not wanted", kind="layer")
    happen(store, "the last one")
    await deliveries(store, receiver).tell_all()
    assert [letter["data"]["text"] for letter in receiver.got] == [*(f"alarm {k}" for k in range(120)), "the last one"]
    assert {letter["type"] for letter in receiver.got} == {"cell.alarm"}
    await deliveries(store, receiver).tell_all()
    assert len(receiver.got) == 121 and look(store, hook).failing_since is None


@pytest.mark.parametrize("refusal", [500, 404, 301, 0])
async def test_what_was_refused_is_told_again_before_anything_newer(store: Store, refusal: int) -> None:
    receiver = Receiver(status=[204, refusal, refusal, 204])
    hook = hooked(store, receiver, "cell.*")
    happen(store, "first", "second", "third")
    await deliveries(store, receiver).tell_all()
    assert [letter["data"]["text"] for letter in receiver.got] == ["first"]
    told = look(store, hook)
    assert told.failures == 1 and told.last_error and told.next_at > NOW
    await deliveries(store, receiver, NOW + 0.1).tell_all()  # too early: nobody is pestered
    assert look(store, hook).failures == 1
    await deliveries(store, receiver, NOW + 3.0).tell_all()
    later = look(store, hook)
    assert later.failures == 2 and later.next_at - (NOW + 3.0) == pytest.approx(2.0 * (told.next_at - NOW))
    await deliveries(store, receiver, NOW + 60.0).tell_all()
    assert [letter["data"]["text"] for letter in receiver.got] == ["first", "second", "third"]
    assert (look(store, hook).failures, look(store, hook).last_error) == (0, "")


async def test_one_that_takes_nothing_for_days_is_paused(store: Store) -> None:
    receiver = Receiver(status=[500])
    hook = hooked(store, receiver, "cell.alarm")
    happen(store, "first")
    for at in (0.0, GIVEN_UP_S + 1.0):
        await deliveries(store, receiver, NOW + at).tell_all()
    assert "took nothing for 3 days" in look(store, hook).paused
    receiver.status = [204]
    await deliveries(store, receiver, NOW + 2 * GIVEN_UP_S).tell_all()
    assert receiver.got == []
    with store.write() as rows:
        webhooks.resume(rows, hook)
    await deliveries(store, receiver, NOW + 2 * GIVEN_UP_S).tell_all()
    assert [letter["data"]["text"] for letter in receiver.got] == ["first"]


async def test_gone_means_nothing_more(store: Store) -> None:
    receiver = Receiver(status=[410])
    hook = hooked(store, receiver, "cell.alarm")
    happen(store, "first")
    await deliveries(store, receiver).tell_all()
    assert "410" in look(store, hook).paused


async def test_a_jobs_steps_are_told_with_who_and_why(web: Web, tmp_path: Path) -> None:
    job = submitted(web.service.store)
    back_up(web.service.store.folder, tmp_path / "b.tar", NOW)  # a store of its own: the service's task leaves it alone
    restore(tmp_path / "b.tar", tmp_path / "other")
    store, receiver = open_store(tmp_path / "other"), Receiver()
    try:
        hook = hooked(store, receiver, "job.submitted")
        with store.write() as rows:
            webhooks.change(rows, hook, step_seq=0)
        await deliveries(store, receiver).tell_all()
    finally:
        store.close()
    (letter,) = receiver.got
    assert letter["type"] == "job.submitted" and letter["data"]["job"] == job and letter["data"]["name"] == "block"


def submitted(store: Store) -> str:
    inspection = Inspection("b" * 64, [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]], 12, 1.0, [])
    part = PartRow(new_id("part", NOW), "block", ".stl", "mm", "a" * 64, 684, NOW, "erin", inspection)
    job = JobRow(new_id("job", NOW), "block", part.id, "trunnion-tcp", "", "316L", NOW, "erin")
    with store.write() as rows:
        parts.add(rows, part)
        return jobs.add(rows, job).id


async def test_only_admins_add_receivers_and_the_secret_is_shown_once(web: Web) -> None:
    body = {"url": "https://receiver/x", "topics": ["job.*", "job.*"]}
    assert_problem(await web.engineer.post(PATH, json=body), 403)
    made = (await web.admin.post(PATH, json=body)).json()
    assert made["secret"].startswith("whsec_") and made["topics"] == ["job.*"]
    shown = (await web.admin.get(f"{PATH}/{made['id']}")).json()
    listed = (await web.admin.get(PATH)).text
    assert "secret" not in shown and made["secret"] not in listed
    for bad in ("ftp://x/", "javascript:alert(1)", "https://me:secret@x/", "https://", "no address", "http://[::1"):
        assert_problem(await web.admin.post(PATH, json={**body, "url": bad}), 422)
    assert_problem(await web.admin.post(PATH, json={**body, "topics": ["job.everything"]}), 422)
    assert (await web.admin.post(f"{PATH}/{made['id']}/resume")).json()["paused"] == ""
    assert (await web.admin.delete(f"{PATH}/{made['id']}")).status_code == 204
    assert_problem(await web.admin.delete(f"{PATH}/{made['id']}"), 404)
