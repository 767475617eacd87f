"""A cell asked for through another cell's host: the same answers, the same refusals, the person's own address written down."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator

import pytest
from sqlalchemy import insert
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from cellctl.cli.app import app
from cellctl.domain.messages import Event
from cellctl.store.schema import events
from cellctl.store.tokens import Role
from tests.postgres import Cluster
from tests.unit.cellctl.house_of_two import PERSON, House, house_of_two, once, stores_on

EVENTS = 5
PIECES, PIECE = 24, 1 << 20


@pytest.fixture(scope="module")
def shared_house(tmp_path_factory: pytest.TempPathFactory, postgres: Cluster) -> Iterator[House]:
    folder = tmp_path_factory.mktemp("house")
    with house_of_two(folder, stores_on(postgres.url(postgres.fresh()), folder)) as house:
        with house.far.service.store.write_cell() as rows:
            for number in range(1, EVENTS + 1):
                rows.execute(insert(events).values(at=float(number), kind="state", text=f"event {number}"))
        yield house


@pytest.fixture
def house(shared_house: House) -> House:
    for name, host in shared_house.hosts.items():
        shared_house.tell(name)
        host.stops.clear()
    return shared_house


def test_a_cell_answers_through_another_host_as_at_its_own(house: House) -> None:
    person, at_far = house.person(), house.person(at="far")
    through, direct = person.get("/cells/far/api/v1/cell/facts"), at_far.get("/api/v1/cell/facts")
    assert through.status_code == 200 and through.json()["name"] == "far"
    assert through.content == direct.content and through.headers["etag"] == direct.headers["etag"]
    assert person.get("/api/v1/cell/facts").json()["name"] == "near" == person.get("/cells/near/api/v1/cell/facts").json()["name"]
    known = person.get("/cells/far/api/v1/cell/facts", headers={"If-None-Match": direct.headers["etag"]})
    assert known.status_code == 304 and not known.content
    assert person.head("/cells/far/api/v1/cell/facts").headers["etag"] == direct.headers["etag"]
    refused = person.get("/cells/far/api/v1/nothing")
    assert refused.status_code == 404 and refused.json()["type"] == "urn:hybridcell:problem:not-found"
    assert house.person(None).get("/cells/far/api/v1/parts").status_code == 401


def test_what_is_done_through_another_host_is_written_down_with_the_persons_own_address(house: House) -> None:
    answer = house.person().post("/cells/far/api/v1/cell/stop", json={"because": "smoke", "id": once()})
    assert answer.status_code == 200, answer.text
    deed = house.audited()[0]
    assert (deed["verb"], deed["target"], deed["origin"], deed["who"], deed["outcome"]) == ("stop", "far", PERSON, "the operator", "ok")
    wrong = house.person(None).post("/cells/far/api/v1/session", json={"token": "no such token"})
    assert wrong.status_code == 401
    assert house.audited()[0]["origin"] == PERSON


def test_a_session_counts_at_every_host_and_keeps_its_page_word_and_its_site(house: House) -> None:
    browser = house.person(None)
    session = browser.post("/api/v1/session", json={"token": house.tokens[Role.OPERATOR]}).json()
    page = {"Origin": house.near.url, "Sec-Fetch-Site": "same-origin"}
    word = {"X-CSRF-Token": session["csrf"]}
    hold = "/cells/far/api/v1/cell/hold"
    assert browser.post(hold, json={}, headers={**page, **word}).status_code == 200
    assert browser.post(hold, json={}, headers=page).status_code == 403
    for origin in ("http://evil.example", house.far.url, "null"):
        assert browser.post(hold, json={}, headers={**word, "Origin": origin}).status_code == 401
    assert browser.post(hold, json={}, headers={**page, **word, "Sec-Fetch-Site": "cross-site"}).status_code == 401
    opened = browser.post("/cells/far/api/v1/session", json={"token": house.tokens[Role.VIEWER]}, headers=page)
    assert opened.status_code == 200 and "HttpOnly" in opened.headers["set-cookie"]
    assert opened.json()["stop_url"] == house.far.stop_url
    assert browser.get("/api/v1/session").json()["role"] == "viewer"
    assert house.person(None, address="127.0.0.3").get("/cells/far/api/v1/session").status_code == 401, "no cookie is kept for the next"


def test_a_file_in_pieces_arrives_whole_through_another_host_and_its_place_is_told_there(house: House) -> None:
    person = house.person()
    body = bytes(range(256)) * (PIECES * PIECE // 256)
    version = {"Tus-Resumable": "1.0.0"}
    made = person.post("/cells/far/api/v1/uploads", headers={**version, "Upload-Length": str(len(body)), "Upload-Metadata": "filename YS5zdGw="})
    assert made.status_code == 201 and made.headers["location"].startswith("/cells/far/api/v1/uploads/")
    piece = {**version, "Upload-Offset": "0", "Content-Type": "application/offset+octet-stream"}

    def pieces() -> Iterator[bytes]:
        for start in range(0, len(body), PIECE):
            yield body[start : start + PIECE]

    sent = person.patch(made.headers["location"], headers={**piece, "Content-Length": str(len(body))}, content=pieces())
    assert sent.status_code == 204 and sent.headers["upload-offset"] == str(len(body))
    kept = house.near.service.store.blobs.uploads / made.headers["location"].rpartition("/")[2]
    assert hashlib.sha256(kept.read_bytes()).digest() == hashlib.sha256(body).digest()
    large = person.post("/cells/far/api/v1/jobs", content=pieces(), headers={"Content-Type": "application/json"})
    assert large.status_code == 413
    assert person.delete(made.headers["location"], headers=version).status_code == 204


def test_server_sent_events_flow_through_and_end_at_the_far_host_when_the_reader_leaves(house: House) -> None:
    person = house.person(Role.VIEWER)
    with person.stream("GET", "/cells/far/api/v1/events/stream", params={"from": 0}) as stream:
        lines = (line for line in stream.iter_lines() if line.startswith("data: "))
        seen = [json.loads(next(lines).removeprefix("data: ")) for _ in range(EVENTS)]
        assert [one["event"]["seq"] for one in seen] == list(range(1, EVENTS + 1))
        assert len(house.far.service.feed) == 1
    house.until(lambda: len(house.far.service.feed) == 0)


def test_the_live_feed_flows_through_and_the_end_of_either_side_ends_the_other(house: House) -> None:
    url = house.near.url.replace("http", "ws") + "/cells/far/api/v1/live"
    signed = {"Authorization": f"Bearer {house.tokens[Role.VIEWER]}"}
    with connect(f"{url}?from=2", additional_headers=signed, proxy=None) as socket:
        assert [json.loads(socket.recv())["event"]["seq"] for _ in range(EVENTS - 2)] == list(range(3, EVENTS + 1))
        event = Event(seq=EVENTS + 1, at=1.0, kind="state", text="ü" * 40_000)
        house.loop.call_soon_threadsafe(house.far.service.feed.take_event, event)
        assert json.loads(socket.recv())["event"]["text"] == event.text
        assert len(house.near.service.feed) == 0 and len(house.far.service.feed) == 1
    house.until(lambda: len(house.far.service.feed) == 0)
    with connect(url, additional_headers=signed, proxy=None) as socket:
        house.until(lambda: len(house.far.service.feed) == 1)
        viewer = next(iter(house.far.service.feed._viewers))
        viewer.is_behind = True
        house.loop.call_soon_threadsafe(viewer.wake.set)
        with pytest.raises(ConnectionClosed) as ended:
            socket.recv()
        assert ended.value.rcvd is not None and ended.value.rcvd.code == 4408


@pytest.mark.parametrize("headers", [{}, {"Authorization": "Bearer wrong"}, {"Origin": "http://evil.example"}])
def test_the_live_feed_is_refused_through_another_host_to_whom_it_is_refused_at_its_own(house: House, headers: dict[str, str]) -> None:
    url = house.near.url.replace("http", "ws") + "/cells/far/api/v1/live"
    signed = {"Authorization": f"Bearer {house.tokens[Role.VIEWER]}"} if "Origin" in headers else {}
    with pytest.raises(InvalidStatus) as refused, connect(url, additional_headers={**signed, **headers}, proxy=None):
        pass
    assert refused.value.response.status_code == 403


def test_the_page_of_a_cell_reaches_its_stop_listener_and_no_other(house: House) -> None:
    person = house.person(None)
    policy = person.get("/cells/far/").headers["content-security-policy"]
    listener, own = (host.stop_url.removesuffix("/stop") for host in (house.far, house.near))
    connections = next(part for part in policy.split("; ") if part.startswith("connect-src")).split()
    assert listener in connections and own not in connections
    assert f'<meta name="stop-url" content="{house.far.stop_url}">' in person.get("/cells/far/").text
    own_policy = person.get("/").headers["content-security-policy"]
    assert listener not in own_policy
    assert person.get("/cells/far").headers["location"] == "/cells/far/" and person.get("/cells/near/").headers["location"] == "/"
    about = person.get("/cells/far/api/v1/cell/about").json()
    assert (about["cell"], about["stop_url"]) == ("far", house.far.stop_url)
    house.until(lambda: any(one.verb == "pages" and one.args["hosts"] == ["127.0.0.1"] for one in house.far.far.commands))


def test_the_fleet_is_told_with_its_ages_and_by_its_etag_only_when_it_changed(house: House, capsys: pytest.CaptureFixture[str]) -> None:
    person = house.person(Role.VIEWER)
    assert house.person(None).get("/api/v1/fleet").status_code == 401
    told = person.get("/api/v1/fleet")
    found = told.json()
    assert told.headers["etag"] and found["shared"] and found["here"] == "near"
    assert [(one["cell"], one["here"], one["path"], one["heard"]) for one in found["cells"]] == [
        ("far", False, "/cells/far/", "living"), ("near", True, "/", "living"),
    ]  # fmt: skip
    assert 0.0 <= found["cells"][0]["age_s"] < 10.0 and found["cells"][0]["because"] == "far waits"
    house.age("far", 100.0)
    later = person.get("/api/v1/fleet").json()["cells"][0]
    assert later["heard"] == "dead" and 100.0 <= later["age_s"] < 160.0

    for words in (["fleet"], ["fleet", "--json"]):
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("CELLCTL_TOKEN", house.tokens[Role.VIEWER])
            app([*words, "--url", house.near.url], standalone_mode=False)
    said = capsys.readouterr().out
    table_said, _, document = said.partition("{")
    assert "near (here)" in table_said and "dead" in table_said
    assert json.loads("{" + document)["here"] == "near"


def test_a_header_of_one_connection_stays_there_and_others_go_on(house: House) -> None:
    person = house.person()
    named = person.get("/cells/far/api/v1/cell/facts", headers={"Connection": "X-Client-Id", "X-Client-Id": "not a name !"})
    assert named.status_code == 200
    assert person.get("/cells/far/api/v1/cell/facts", headers={"X-Client-Id": "not a name !"}).status_code == 422
