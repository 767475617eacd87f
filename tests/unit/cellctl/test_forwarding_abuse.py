"""Forwarding as a stranger, a broken host or a wrong row would use it."""

from __future__ import annotations

import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import msgspec
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from cellctl.api import forward_http, forward_stop, forwarding
from cellctl.api.forwarding import PER_ADDRESS
from cellctl.domain import forwarded
from cellctl.domain.forwarded import HEADER, MAX_AGE_S, Word
from cellctl.store.tokens import Role
from cellctl.tls import server_context
from tests.unit.cellctl import certificates
from tests.unit.cellctl.house_of_two import PERSON, House, house_of_two, once, stores_in_one_file

STRANGER = "127.0.0.9"
QUICK = {"connect": 1.0, "read": 0.3, "write": 1.0, "pool": 0.3}
FACTS = "/api/v1/cell/facts"
OK_HEAD = f"HTTP/1.1 200 OK\r\n{HEADER}: taken\r\n".encode()


@pytest.fixture(scope="module")
def shared_house(tmp_path_factory: pytest.TempPathFactory, empty_store: Path) -> Iterator[House]:
    with house_of_two(folder := tmp_path_factory.mktemp("house"), stores_in_one_file(folder, empty_store)) as house:
        yield house


@pytest.fixture
def house(shared_house: House) -> House:
    for name, host in shared_house.hosts.items():
        shared_house.tell(name)
        host.stops.clear()
    return shared_house


@contextmanager
def odd_host(answer: Callable[[socket.socket], None], tls: ssl.SSLContext | None = None) -> Iterator[str]:
    """A host that takes a connection, reads a request's head and then does as it likes."""
    listening = socket.create_server(("127.0.0.1", 0))
    taken: list[socket.socket] = []

    def one(wire: socket.socket) -> None:
        try:
            wire.settimeout(20.0)
            wire = wire if tls is None else tls.wrap_socket(wire, server_side=True)
            head = b""
            while b"\r\n\r\n" not in head:
                if not (piece := wire.recv(65536)):
                    return
                head += piece
            answer(wire)
        except OSError:
            pass
        finally:
            wire.close()

    def work() -> None:
        while True:
            try:
                wire, _ = listening.accept()
            except OSError:
                return
            taken.append(wire)
            threading.Thread(target=one, args=(wire,), daemon=True).start()

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield f"{'http' if tls is None else 'https'}://127.0.0.1:{listening.getsockname()[1]}"
    finally:
        listening.shutdown(socket.SHUT_RDWR)
        listening.close()
        thread.join(20.0)
        for wire in taken:
            wire.close()


def word(house: House, **other: object) -> Word:
    """A word of near's host for a request of somebody at an address that nobody has."""
    at = house.far.service.store.clock()
    said = Word(at, once(), "near", "far", "10.9.9.9", "near.example", "http", "GET", "/api/v1/session", "")
    return msgspec.structs.replace(said, **other)


def signed(house: House, said: Word) -> str:
    return forwarded.signed(said, bytes.fromhex(house.near.service.neighbours.secret))


def failed_sign_in(house: House, header: str) -> httpx.Response:
    return house.person(None, at="far", address=STRANGER).post("/api/v1/session", json={"token": once()}, headers={HEADER: header})


def test_a_strangers_forwarding_header_is_passed_over_and_the_deed_is_written_down_with_the_strangers_own_address(house: House) -> None:
    said = word(house, method="POST")
    lies = [forwarded.signed(said, b"x" * 32), forwarded.signed(word(house, sender="nobody", method="POST"), b"x" * 32), "rubbish", "", "a.b"]
    for lie in lies:
        answer = failed_sign_in(house, lie)
        assert answer.status_code == 401 and HEADER not in answer.headers
        assert house.audited()[0]["origin"] == STRANGER
    genuine = failed_sign_in(house, signed(house, word(house, method="POST")))
    assert genuine.status_code == 401 and genuine.headers[HEADER] == "taken"
    assert house.audited()[0]["origin"] == "10.9.9.9", "the same header counts where near's host signed it"


def test_two_forwarding_headers_and_headers_of_proxies_are_believed_by_nobody(house: House) -> None:
    pair = [(HEADER, signed(house, word(house, method="POST"))), (HEADER, signed(house, word(house, method="POST")))]
    answer = house.person(None, at="far", address=STRANGER).post("/api/v1/session", json={"token": once()}, headers=pair)
    assert answer.status_code == 401 and house.audited()[0]["origin"] == STRANGER
    proxied = {"X-Forwarded-For": "10.1.1.1", "X-Real-IP": "10.1.1.1", "Forwarded": "for=10.1.1.1"}
    house.person(None).post("/cells/far/api/v1/session", json={"token": once()}, headers=proxied)
    assert house.audited()[0]["origin"] == PERSON


@pytest.mark.parametrize(
    ("other", "status", "says"),
    [
        ({"at": MAX_AGE_S + 2.0}, 403, "old"),
        ({"at": -MAX_AGE_S - 600.0}, 403, "old"),
        ({"method": "POST"}, 403, "another request"),
        ({"target": "/api/v1/session?x=1"}, 403, "another request"),
        ({"cell": "west"}, 421, "not of west"),
    ],
)
def test_a_word_that_is_late_or_of_something_else_is_refused_in_one_line(house: House, other: dict[str, object], status: int, says: str) -> None:
    now = house.far.service.store.clock()
    said = word(house, **{name: now - float(value) if name == "at" else value for name, value in other.items()})  # type: ignore[arg-type]
    answer = house.person(at="far").get("/api/v1/session", headers={HEADER: signed(house, said)})
    assert answer.status_code == status and says in answer.json()["detail"]


def test_a_word_counts_once_and_a_late_one_still_stops(house: House) -> None:
    header = {HEADER: signed(house, word(house))}
    person = house.person(at="far")
    assert [person.get("/api/v1/session", headers=header).status_code for _ in range(2)] == [200, 403]
    late = word(house, method="POST", target="/api/v1/cell/stop", at=1.0)
    assert person.post("/api/v1/cell/stop", json={}, headers={HEADER: signed(house, late)}).status_code == 200


def test_a_host_that_starts_again_signs_with_another_secret_and_the_old_one_counts_no_more(house: House) -> None:
    before = signed(house, word(house, method="POST"))
    neighbours = house.near.service.neighbours
    old, neighbours.secret = neighbours.secret, "ab" * 32
    try:
        house.tell("near")
        assert house.person().get(f"/cells/far{FACTS}").status_code == 200
        failed_sign_in(house, before)
        assert house.audited()[0]["origin"] == STRANGER
    finally:
        neighbours.secret = old


@pytest.mark.parametrize("path", [f"/cells/west{FACTS}", "/cells/west/", "/cells/", "/cells", "/cells/far/metrics", "/cells/far/openapi.json",
                                  f"/cells/far//{FACTS}", "/cells/far/api/v1/%2e%2e/%2e%2e/metrics", "/cells/far/api/v1/a%2fb",
                                  "/cells/far/api/v1/../../metrics", f"/cells/far/cells/near{FACTS}", "/cells/../api/v1/session",
                                  "//cells/far/api/v1/session", "/%63ells/far/api/v1/session", "http://127.0.0.1/cells/far/api/v1/session",
                                  "http://evil.example/cells/far/api/v1/session", "/cells/evil.example:80/api/v1/x",
                                  "/cells/far@evil/api/v1/x"])  # fmt: skip
def test_a_path_that_names_no_cell_or_leads_elsewhere_is_not_found(house: House, path: str) -> None:
    host, _, port = house.near.url.removeprefix("http://").partition(":")
    with socket.create_connection((host, int(port))) as wire:
        head = f"GET {path} HTTP/1.1\r\nHost: {host}:{port}\r\nAuthorization: Bearer {house.tokens[Role.ADMIN]}\r\nConnection: close\r\n\r\n"
        wire.sendall(head.encode())
        answer = b""
        while piece := wire.recv(65536):
            answer += piece
    assert answer.startswith(b"HTTP/1.1 404 "), answer[:200]


def test_a_row_that_leads_back_to_the_asking_host_is_refused_there_and_nothing_goes_round(house: House) -> None:
    house.tell("far", url=house.near.url)
    answer = house.person().get(f"/cells/far{FACTS}")
    assert answer.status_code == 421 and "near, not of far" in answer.json()["detail"]
    said = word(house, sender="far", cell="near", target=f"/cells/far{FACTS}")
    by_far = forwarded.signed(said, bytes.fromhex(house.far.service.neighbours.secret))
    assert house.person().get(f"/cells/far{FACTS}", headers={HEADER: by_far}).status_code == 508


@pytest.mark.parametrize(
    "url", ["ftp://127.0.0.1/", "http://user:secret@127.0.0.1:1", "http://127.0.0.1:1/x", "http://", "javascript:1", "http://a b", ""]
)
def test_a_row_without_a_plain_address_is_forwarded_to_by_nobody(house: House, url: str) -> None:
    house.tell("far", url=url)
    assert house.person().get(f"/cells/far{FACTS}").status_code == 404
    shown = house.person().get("/api/v1/fleet").json()["cells"][0]
    assert (shown["cell"], shown["path"]) == ("far", "")


def test_a_host_that_is_gone_is_named_with_what_to_do(house: House) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    house.tell("far", url=f"http://127.0.0.1:{port}")
    answer = house.person().get(f"/cells/far{FACTS}")
    problem = answer.json()
    assert answer.status_code == 502 and answer.headers["content-type"] == "application/problem+json"
    assert "far at http://127.0.0.1" in problem["detail"] and "nothing listens there" in problem["detail"]
    assert f"open http://127.0.0.1:{port} itself" in problem["hint"] and "E-stop" in problem["hint"]


def test_a_host_that_says_nothing_is_given_up_in_time(house: House, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forward_http, "TIMES", QUICK)
    with odd_host(lambda wire: wire.recv(1) and None) as url:
        house.tell("far", url=url)
        answer = house.person().get(f"/cells/far{FACTS}")
    assert answer.status_code == 504 and answer.json()["detail"].startswith("far at ")


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}", "does not take this host's word"),
        (b"HTTP/1.1 302 Found\r\nLocation: http://evil.example/\r\n" + HEADER.encode() + b": taken\r\nContent-Length: 0\r\n\r\n", "redirects"),
        (b"HTTP/1.1 307 Found\r\nLocation: /api/v1/session\r\n" + HEADER.encode() + b": taken\r\nContent-Length: 0\r\n\r\n", "redirects"),
        (OK_HEAD + b"X-Long: " + b"y" * 40_000 + b"\r\n\r\n", "bytes of headers"),
        (OK_HEAD + b"X-Longer: " + b"y" * 400_000 + b"\r\n\r\n", "the connection broke"),
        (b"rubbish\r\n\r\n", "the connection broke"),
        (b"", "the connection broke"),
    ],
)
def test_an_answer_that_is_none_of_a_host_is_passed_on_to_nobody(house: House, answer: bytes, says: str) -> None:
    def say(wire: socket.socket) -> None:
        wire.sendall(answer)
        wire.shutdown(socket.SHUT_RDWR)

    with odd_host(say) as url:
        house.tell("far", url=url)
        got = house.person().get(f"/cells/far{FACTS}", follow_redirects=False)
    assert got.status_code == 502 and says in got.json()["detail"]


def test_an_answer_without_end_takes_no_memory_and_ends_with_its_reader_and_one_that_breaks_off_is_not_taken_for_whole(
    house: House, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent, is_over = [0], threading.Event()

    def pour(wire: socket.socket) -> None:
        wire.sendall(OK_HEAD + b"Content-Type: application/octet-stream\r\nTransfer-Encoding: chunked\r\n\r\n")
        try:
            while True:
                wire.sendall(b"10000\r\n" + b"z" * 65536 + b"\r\n")
                sent[0] += 65536
        finally:
            is_over.set()

    with odd_host(pour) as url:
        house.tell("far", url=url)
        with house.person().stream("GET", f"/cells/far{FACTS}") as answer:
            next(answer.iter_raw(1000))
            house.until(lambda: _stands_still(lambda: sent[0]))
            assert sent[0] < 32 << 20, "what nobody reads is asked for no further"
        assert is_over.wait(20.0)
        monkeypatch.setattr(forward_http, "ANSWER_LIMIT_BYTES", 1 << 20)
        with pytest.raises(httpx.RemoteProtocolError):
            house.person().get(f"/cells/far{FACTS}")


def _stands_still(value: Callable[[], int]) -> bool:
    before = value()
    time.sleep(0.2)
    return value() == before


def test_a_slow_host_keeps_nobody_from_this_one_nor_others_from_it_and_stop_has_its_own_way(house: House) -> None:
    is_over = threading.Event()
    with odd_host(lambda wire: is_over.wait(20.0) and None) as url:
        house.tell("far", url=url)
        held = [threading.Thread(target=lambda: house.person().get(f"/cells/far{FACTS}")) for _ in range(PER_ADDRESS)]
        for thread in held:
            thread.start()
        under_way = _forwarding(house)._under_way
        house.until(lambda: under_way["far", PERSON] == PER_ADDRESS)
        refused = house.person().get(f"/cells/far{FACTS}")
        assert refused.status_code == 503 and "far" in refused.json()["detail"]
        assert house.person().get(FACTS).status_code == 200, "the own cell is asked as before"
        begun = time.monotonic()
        stopped = house.person().post("/cells/far/api/v1/cell/stop", json={"because": "smoke"})
        assert stopped.json()["state"] == "STOPPED" and time.monotonic() - begun < forward_stop.GIVEN_UP_S
        is_over.set()
        for thread in held:
            thread.join()
    house.until(lambda: not under_way)


def _forwarding(house: House) -> forwarding.Forwarding:
    app = house.near.server.config.app  # type: ignore[union-attr]
    return next(route.app for route in app.router.routes if isinstance(getattr(route, "app", None), forwarding.Forwarding))


def test_stop_goes_past_a_dead_web_process_to_the_listener_for_those_who_may_stop_and_is_written_down(house: House) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        gone = f"http://127.0.0.1:{free.getsockname()[1]}"
    house.tell("far", url=gone)
    stop = "/cells/far/api/v1/cell/stop"
    assert house.person(None).post(stop, json={}).status_code == 502
    assert house.person(Role.VIEWER).post(stop, json={}).status_code == 502
    assert not house.far.stops
    answer = house.person().post(stop, json={"because": "smoke", "id": "s1"})
    assert answer.status_code == 200 and answer.json()["state"] == "STOPPED"
    assert house.far.stops == [("stop listener 127.0.0.1", "the operator: smoke")] and not house.near.stops
    deed = house.audited()[0]
    assert (deed["verb"], deed["target"], deed["origin"]) == ("stop", "far", PERSON) and deed["outcome"].startswith("ok: by its STOP listener")
    assert house.person().post(stop, content=b"\xff" * 10_000, headers={"Content-Type": "application/json"}).status_code == 200
    house.tell("far", url=gone, stop_url="")
    assert house.person().post(stop, json={}).status_code == 502


def test_a_live_feed_of_a_host_that_is_gone_or_none_of_the_house_is_refused_with_a_problem(house: House) -> None:
    def plain(wire: socket.socket) -> None:
        wire.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n")

    with odd_host(plain) as url:
        for place in (url, "http://127.0.0.1:9"):
            house.tell("far", url=place)
            with pytest.raises(InvalidStatus) as refused, connect(f"{house.near.url.replace('http', 'ws')}/cells/far/api/v1/live", proxy=None):
                pass
            assert refused.value.response.status_code in (403, 502)


def test_a_host_behind_tls_is_believed_by_the_very_certificate_that_it_told_and_by_no_other(house: House, tmp_path: Path) -> None:
    own, key = certificates.make(tmp_path, "own")
    other, _ = certificates.make(tmp_path, "other")
    context = server_context(own, key)

    def behind_tls(wire: socket.socket) -> None:
        wire.sendall(OK_HEAD + b"Content-Length: 2\r\n\r\n{}")

    with odd_host(behind_tls, context) as url:
        for told, status in ((own.read_text(), 200), (other.read_text(), 502), ("", 502), ("rubbish", 502)):
            house.tell("far", url=url, certificate=told)
            answer = house.person().get(f"/cells/far{FACTS}")
            assert answer.status_code == status, answer.text
            assert status == 200 or "certificate is not believed" in answer.json()["detail"]
