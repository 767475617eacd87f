"""TLS by file: what cannot be used is said in one line; STOP behind TLS; who may be reached in plain sight."""

from __future__ import annotations

import asyncio
import json
import threading
from pathlib import Path

import pytest

from cellctl import tls
from cellctl.api.security import is_known_host
from cellctl.cell.stop_thread import StopThread
from cellctl.first_start import ServeError
from cellctl.reach import Wire, check_wire
from cellctl.tls import TlsError
from tests.unit.cellctl import certificates


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    return certificates.make(tmp_path)


def refused(cert: Path | None, key: Path | None) -> str:
    with pytest.raises(TlsError) as caught:
        tls.check(cert, key)
    assert "\n" not in caught.value.message and caught.value.hint
    return caught.value.message


def test_certificate_and_key_that_belong_together_are_taken_and_one_that_ends_soon_is_warned_of(tmp_path: Path) -> None:
    assert tls.check(*certificates.make(tmp_path)) == ""
    assert "expires in 5 days" in tls.check(*certificates.make(tmp_path, days=6.5))


def test_what_is_missing_or_no_such_file_is_said(tmp_path: Path, files: tuple[Path, Path]) -> None:
    cert, key = files
    assert "--tls-cert is given without --tls-key" in refused(cert, None)
    assert "--tls-key is given without --tls-cert" in refused(None, key)
    assert "cannot be read: No such file" in refused(tmp_path / "none.pem", key)
    assert "cannot be read: No such file" in refused(cert, tmp_path / "none.key")
    (tmp_path / "text").write_text("hello")
    assert "holds no certificate" in refused(tmp_path / "text", key)
    assert "holds no private key" in refused(cert, tmp_path / "text")


def test_expired_future_foreign_and_locked_files_are_said(tmp_path: Path, files: tuple[Path, Path]) -> None:
    cert, _ = files
    assert "has expired on" in refused(*certificates.make(tmp_path, "old", days=3.0, starts=-5.0))
    assert "is valid from" in refused(*certificates.make(tmp_path, "next", starts=2.0))
    assert "is not the key of" in refused(cert, certificates.make(tmp_path, "other")[1])
    assert "wants a passphrase" in refused(*certificates.make(tmp_path, "locked", passphrase=b"secret"))


def test_other_machines_reach_it_by_tls_or_a_proxy_or_if_plain_is_said(files: tuple[Path, Path]) -> None:
    assert check_wire(Wire(), "127.0.0.1") == [] and check_wire(Wire(*files), "0.0.0.0") == []
    with pytest.raises(ServeError, match="without TLS passwords"):
        check_wire(Wire(), "0.0.0.0")
    assert "WITHOUT TLS" in check_wire(Wire(plain=True), "0.0.0.0")[0]
    assert "--stop-url" in check_wire(Wire(behind_proxy="10.0.0.1"), "127.0.0.1")[0]
    assert check_wire(Wire(behind_proxy="10.0.0.1", stop_url="https://cell.example:8001/stop"), "0.0.0.0") == []
    for url in ("javascript:alert(1)/stop", "https://x/other", "https://x; script-src */stop", "http://[/stop"):
        with pytest.raises(ServeError, match="no address of a STOP listener"):
            check_wire(Wire(behind_proxy="10.0.0.1", stop_url=url), "0.0.0.0")


def test_names_of_the_certificate_are_the_services_and_others_are_not(files: tuple[Path, Path]) -> None:
    names = tls.names_of(files[0])
    assert all(is_known_host(name, "0.0.0.0", names) for name in ("cell.example", "CELL.example", "one.shop.example", "192.0.2.7", "::1"))
    assert not any(is_known_host(name, "0.0.0.0", names) for name in ("evil.example", "a.b.shop.example", "", "shop.example"))
    assert not is_known_host("192.0.2.7", "127.0.0.1", names)


async def ask(port: int, cert: Path, text: bytes) -> tuple[int, dict[str, str]]:
    reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=tls.pinned_context(cert))
    writer.write(text)
    head, _, body = (await reader.read()).partition(b"\r\n\r\n")
    writer.close()
    return int(head.split()[1]), json.loads(body)


async def test_stop_behind_tls_is_carried_out_in_the_cells_own_loop_while_others_say_nothing(files: tuple[Path, Path]) -> None:
    stops: list[tuple[str, str, int]] = []

    async def stop(ident: str, _who: str, because: str) -> str:
        stops.append((ident, because, threading.get_ident()))
        return "STOPPED"

    listener = StopThread(stop, lambda: "IDLE", "127.0.0.1", tls.server_context(*files), lambda: None)
    port = await listener.start(0)
    silent = [await asyncio.open_connection("127.0.0.1", port) for _ in range(70)]  # no handshake
    plain_reader, plain_writer = await asyncio.open_connection("127.0.0.1", port)
    plain_writer.write(b"POST /stop HTTP/1.1\r\nContent-Length: 0\r\n\r\n")
    body = b'{"id": "s1", "because": "smoke"}'
    answer = await ask(port, files[0], b"POST /stop HTTP/1.1\r\nHost: x\r\nContent-Length: %d\r\n\r\n" % len(body) + body)
    assert answer == (200, {"state": "STOPPED"})
    assert stops == [("s1", "smoke", threading.get_ident())]
    assert b"STOPPED" not in await plain_reader.read(), "plain HTTP is not answered behind TLS"
    for _, writer in [*silent, (plain_reader, plain_writer)]:
        writer.close()
    await listener.close()
    await listener.close()
    assert not any(thread.name == "stop" for thread in threading.enumerate())
