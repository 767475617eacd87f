"""`--behind-proxy`: what the proxy says of who asks counts for tries, trail and cookie; what anybody else says of it does not."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx
import pytest

from cellctl.store import audit, tries
from cellctl.store.audit import Wanted
from tests.unit.cellctl.hostile import PASSWORD, cheap_hashes  # noqa: F401
from tests.unit.cellctl.served_by_thread import AtPort, at_port

PROXY, ANNA, BEN = "127.0.0.2", "127.0.0.3", "127.0.0.4"
FORGED = "9.9.9.9"
ANSWER_S = 60.0


class Proxy(BaseHTTPRequestHandler):
    """Passes a request on from its own address and says whose it is, behind what that one said itself, as proxies do."""

    to: str = ""

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        said = self.headers.get("X-Forwarded-For")
        told = ", ".join(filter(None, [said, str(self.client_address[0])]))
        headers = {"Content-Type": "application/json", "X-Forwarded-For": told, "X-Forwarded-Proto": "https"}
        with httpx.Client(transport=httpx.HTTPTransport(local_address=PROXY), timeout=ANSWER_S) as client:
            answer = client.post(self.to + self.path, content=body, headers=headers)
        self.send_response(answer.status_code)
        for name in ("set-cookie", "content-type", "retry-after"):
            if name in answer.headers:
                self.send_header(name, answer.headers[name])
        self.send_header("Content-Length", str(len(answer.content)))
        self.end_headers()
        self.wfile.write(answer.content)

    def log_message(self, *_args: Any) -> None:
        """Says nothing."""


@pytest.fixture
def served(tmp_path: Path, empty_store: Path) -> Iterator[AtPort]:
    with at_port(tmp_path, empty_store, behind_proxy=PROXY) as found:
        yield found


@pytest.fixture
def proxy(served: AtPort) -> Iterator[str]:
    """The address of the proxy."""
    with ThreadingHTTPServer(("127.0.0.1", 0), type("OfService", (Proxy,), {"to": served.url})) as server:
        thread = threading.Thread(target=server.serve_forever, name="proxy")
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


def signed_in(url: str, address: str, given: dict[str, str], **headers: str) -> httpx.Response:
    """The answer to somebody who signs in from an address of this machine."""
    with httpx.Client(transport=httpx.HTTPTransport(local_address=address), timeout=ANSWER_S) as client:
        return client.post(f"{url}/api/v1/session", json=given, headers=headers)


def origins(served: AtPort) -> list[str]:
    """Where sign-ins came from, as the trail tells, oldest first."""
    with served.service.store.read() as rows:
        return [row["origin"] for row in audit.find_page(rows, Wanted(None, "sign in", None, None, None), None, 100)[0]][::-1]


def test_who_comes_by_the_proxy_is_told_by_it_and_a_strangers_word_counts_nowhere(served: AtPort, proxy: str) -> None:
    given = {"token": served.token}
    by_proxy = signed_in(proxy, ANNA, given, **{"X-Forwarded-For": FORGED})
    stranger = signed_in(served.url, BEN, given, **{"X-Forwarded-For": FORGED, "X-Forwarded-Proto": "https"})
    assert (by_proxy.status_code, stranger.status_code) == (200, 200)
    assert origins(served) == [ANNA, BEN]
    assert "Secure" in by_proxy.headers["set-cookie"] and "Secure" not in stranger.headers["set-cookie"]


def test_tries_are_counted_for_who_made_them_whatever_they_say(served: AtPort, proxy: str) -> None:
    wrong = {"user": "anna", "password": PASSWORD}
    now = served.service.store.clock()
    object.__setattr__(served.service.store, "clock", lambda: now)  # no wait passes
    for number in range(tries.PLACE.free):
        assert signed_in(proxy, ANNA, wrong, **{"X-Forwarded-For": f"9.9.9.{number}"}).status_code == 401
    slowed = signed_in(proxy, ANNA, wrong, **{"X-Forwarded-For": FORGED})
    assert slowed.status_code == 429 and int(slowed.headers["retry-after"]) >= 1
    assert signed_in(proxy, BEN, wrong).status_code == 401
    other = {"user": "eve", "password": PASSWORD}
    direct = [signed_in(served.url, BEN, other, **{"X-Forwarded-For": f"8.8.8.{one}"}) for one in range(tries.PLACE.free + 1)]
    assert [answer.status_code for answer in direct] == [401] * tries.PLACE.free + [429]
    assert {FORGED, PROXY}.isdisjoint(origins(served))
