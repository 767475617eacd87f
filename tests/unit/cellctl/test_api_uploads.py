from __future__ import annotations

import asyncio
import base64
import errno
import hashlib
import os
import shutil
from collections.abc import AsyncIterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import numpy as np
import pytest
import trimesh
from starlette.requests import ClientDisconnect

from cellctl.api import incoming, uploads
from cellctl.api.app import build_service, make_app
from cellctl.api.incoming import Incoming
from cellctl.store import uploads as store_uploads
from tests.unit.cellctl.conftest import URL

TUS = {"Tus-Resumable": "1.0.0"}
PIECE = {**TUS, "Content-Type": "application/offset+octet-stream"}
BOX = bytes(trimesh.creation.box((12.0, 8.0, 2.0)).export(file_type="stl"))


def assert_problem(answer: httpx.Response, status: int) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem: dict[str, Any] = answer.json()
    assert problem["title"] and problem["detail"] and "\n" not in problem["detail"]
    return problem


def b64(data: bytes | str) -> str:
    return base64.b64encode(data.encode() if isinstance(data, str) else data).decode()


async def announce(client: httpx.AsyncClient, data: bytes, name: str = "block.stl", length: int | None = None, **told: str) -> httpx.Response:
    metadata = ",".join(f"{key} {b64(value)}" for key, value in {"filename": name, **told}.items())
    headers = {**TUS, "Upload-Length": str(len(data) if length is None else length), "Upload-Metadata": metadata}
    return await client.post("/api/v1/uploads", headers=headers)


async def send(client: httpx.AsyncClient, place: str, data: Any, offset: int, **headers: str) -> httpx.Response:
    return await client.patch(place, content=data, headers={**PIECE, "Upload-Offset": str(offset), **headers}, timeout=60)


async def offset_of(client: httpx.AsyncClient, place: str) -> int:
    answer = await client.head(place, headers=TUS)
    assert answer.status_code == 200 and answer.headers["cache-control"] == "no-store"
    return int(answer.headers["upload-offset"])


async def test_file_sent_in_pieces_becomes_the_part_that_one_request_would_make(web: Any) -> None:
    spoken = await web.nobody.options("/api/v1/uploads")
    assert spoken.status_code == 204 and spoken.headers["tus-version"] == "1.0.0" and "checksum" in spoken.headers["tus-extension"]
    made = await announce(web.operator, BOX, units="inch", sha256=hashlib.sha256(BOX).hexdigest())
    assert made.status_code == 201
    place = made.headers["location"]
    assert_problem(await web.operator.post(f"{place}/part"), 409)
    for start in range(0, len(BOX), 200):
        piece = BOX[start : start + 200]
        answer = await send(web.operator, place, piece, start, **{"Upload-Checksum": f"sha256 {b64(hashlib.sha256(piece).digest())}"})
        assert answer.status_code == 204 and int(answer.headers["upload-offset"]) == start + len(piece)
    part = await web.operator.post(f"{place}/part", timeout=60)
    assert part.status_code == 201
    assert part.json()["volume_mm3"] == pytest.approx(192.0 * 25.4**3) and part.json()["bytes"] == len(BOX)
    again = await web.operator.post(f"{place}/part")
    assert again.json() == part.json()
    assert (await web.operator.get(place)).json()["part_id"] == part.json()["id"]
    assert list((web.service.store.blobs.uploads).iterdir()) == [], "what came is kept once"
    files = {"file": ("block.stl", BOX)}
    whole = (await web.operator.post("/api/v1/parts", files=files, data={"units": "inch"}, timeout=60)).json()
    same = ("sha256", "bbox_mm", "facets", "volume_mm3", "findings", "name", "units")
    assert {key: whole[key] for key in same} == {key: part.json()[key] for key in same}


async def test_upload_goes_on_after_a_restart_of_the_service_from_what_was_counted(web: Any) -> None:
    place = (await announce(web.operator, BOX)).headers["location"]
    assert (await send(web.operator, place, BOX[:300], 0)).status_code == 204
    file = web.service.store.blobs.uploads / place.rpartition("/")[2]
    with file.open("ab") as torn:
        torn.write(b"written, but never counted")
    service = build_service(web.service.settings)
    app = make_app(service, "127.0.0.1")
    headers = dict(web.operator.headers)
    async with (
        app.router.lifespan_context(app),
        httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url=URL, headers=headers) as client,
    ):
        assert await offset_of(client, place) == 300
        listed = (await client.get("/api/v1/uploads")).json()["items"]
        assert [(item["received"], item["bytes"], item["filename"]) for item in listed] == [(300, len(BOX), "block.stl")]
        assert_problem(await send(client, place, BOX[200:], 200), 409)
        assert (await send(client, place, BOX[300:], 300)).status_code == 204
        part = await client.post(f"{place}/part", timeout=60)
        assert part.status_code == 201 and part.json()["sha256"] == hashlib.sha256(BOX).hexdigest()


async def test_sender_that_goes_away_leaves_what_came_unless_a_checksum_covers_it(web: Any) -> None:
    place = (await announce(web.operator, BOX)).headers["location"]
    with web.service.store.read() as rows:
        upload = store_uploads.get(rows, place.rpartition("/")[2])

    async def torn() -> AsyncIterator[bytes]:
        yield BOX[:250]
        raise ClientDisconnect

    assert await incoming.receive(Incoming(web.service.store, upload, hashlib.sha256(BOX).digest()), torn()) == 0
    assert await incoming.receive(Incoming(web.service.store, upload, None), torn()) == 250
    assert await offset_of(web.operator, place) == 250


async def test_damaged_piece_is_dropped_and_may_be_sent_again(web: Any) -> None:
    place = (await announce(web.operator, BOX)).headers["location"]
    right = f"sha256 {b64(hashlib.sha256(BOX).digest())}"
    assert_problem(await send(web.operator, place, BOX[:-1] + b"x", 0, **{"Upload-Checksum": right}), 460)
    assert await offset_of(web.operator, place) == 0
    assert_problem(await send(web.operator, place, BOX, 0, **{"Upload-Checksum": "md5 abc"}), 400)
    assert (await send(web.operator, place, BOX, 0, **{"Upload-Checksum": right})).status_code == 204


async def test_file_that_arrives_other_than_announced_is_no_part(web: Any) -> None:
    place = (await announce(web.operator, BOX, sha256="0" * 64)).headers["location"]
    assert (await send(web.operator, place, BOX, 0)).status_code == 204
    assert "SHA-256" in assert_problem(await web.operator.post(f"{place}/part"), 422)["detail"]
    junk = (await announce(web.operator, b"solid nothing")).headers["location"]
    assert (await send(web.operator, junk, b"solid nothing", 0)).status_code == 204
    assert_problem(await web.operator.post(f"{junk}/part", timeout=60), 422)
    assert (await web.viewer.get("/api/v1/parts")).json()["items"] == []
    for left in (place, junk):
        assert (await web.operator.delete(left, headers=TUS)).status_code == 204
    assert list(web.service.store.blobs.uploads.iterdir()) == []


async def test_what_breaks_the_protocol_is_refused_in_words(web: Any) -> None:
    assert "1.0.0" in assert_problem(await web.operator.post("/api/v1/uploads", headers={"Upload-Length": "3"}), 412)["detail"]
    assert_problem(await announce(web.viewer, BOX), 403)
    assert_problem(await announce(web.operator, BOX, name="x.exe"), 422)
    assert_problem(await announce(web.operator, BOX, units="furlong"), 422)
    for length in ("-1", "1e3", "", "9" * 16):
        answer = await web.operator.post("/api/v1/uploads", headers={**TUS, "Upload-Length": length})
        assert_problem(answer, 400)
    assert_problem(await web.operator.post("/api/v1/uploads", headers={**TUS, "Upload-Length": "3", "Upload-Metadata": "filename ?"}), 400)
    place = (await announce(web.operator, BOX)).headers["location"]
    assert_problem(await web.operator.patch(place, content=BOX, headers={**TUS, "Upload-Offset": "0"}), 415)
    assert_problem(await send(web.operator, place, BOX + b"more", 0), 413)
    assert await offset_of(web.operator, place) == 0
    for answer in (await web.engineer.get(place), await send(web.engineer, place, BOX, 0), await web.engineer.delete(place, headers=TUS)):
        assert_problem(answer, 404)
    assert (await web.engineer.head(place, headers=TUS)).status_code == 404


async def test_one_request_sends_an_upload_and_a_few_at_once(web: Any) -> None:
    place = (await announce(web.operator, BOX)).headers["location"]
    begun = asyncio.Event()
    go_on = asyncio.Event()

    async def slow() -> AsyncIterator[bytes]:
        begun.set()
        yield BOX[:100]
        await go_on.wait()
        yield BOX[100:]

    sender = asyncio.create_task(send(web.operator, place, slow(), 0))
    await begun.wait()
    while not web.service.receiving.is_under_way(place.rpartition("/")[2]):
        await asyncio.sleep(0)
    assert_problem(await send(web.operator, place, BOX, 0), 423)
    with web.service.receiving.one("a"), web.service.receiving.one("b"), web.service.receiving.one("c"):
        other = (await announce(web.operator, BOX)).headers["location"]
        refused = await send(web.operator, other, BOX, 0)
        assert_problem(refused, 503)
        assert int(refused.headers["retry-after"]) > 0
    go_on.set()
    assert (await sender).headers["upload-offset"] == str(len(BOX))


async def test_silent_sender_is_given_up_and_what_came_is_kept(web: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(incoming, "SILENCE_S", 0.05)
    place = (await announce(web.operator, BOX)).headers["location"]

    async def silent() -> AsyncIterator[bytes]:
        yield BOX[:100]
        await asyncio.sleep(5.0)

    assert_problem(await send(web.operator, place, silent(), 0), 408)
    assert await offset_of(web.operator, place) == 100


async def test_limits_of_size_of_person_and_of_the_disk_are_told_in_numbers(web: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    limit = web.service.settings.resumable_limit_bytes
    assert str(limit) in assert_problem(await announce(web.operator, b"", length=limit + 1), 413)["detail"]
    usage = shutil.disk_usage(web.service.store.blobs.uploads)
    with monkeypatch.context() as tight:
        nearly_full = SimpleNamespace(disk_usage=lambda _path: usage._replace(free=uploads.ROOM_KEPT_BYTES + 1000))
        tight.setattr(uploads, "shutil", nearly_full)
        assert (await announce(web.operator, b"", length=900)).status_code == 201
        assert "free" in assert_problem(await announce(web.operator, b"", length=900), 507)["detail"]
    for _ in range(uploads.OF_PERSON_MAX - 1):
        assert (await announce(web.operator, BOX)).status_code == 201
    assert_problem(await announce(web.operator, BOX), 429)
    assert (await announce(web.engineer, BOX)).status_code == 201


async def test_disk_that_fills_while_receiving_is_told_and_the_offset_stays(web: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    place = (await announce(web.operator, BOX)).headers["location"]

    def full(_self: Incoming, _data: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as disk:
        disk.setattr(Incoming, "write", full)
        assert assert_problem(await send(web.operator, place, BOX, 0), 507)["title"] == "The disk is full"
    assert await offset_of(web.operator, place) == 0
    assert (await send(web.operator, place, BOX, 0)).status_code == 204


async def test_same_key_announces_one_upload(web: Any) -> None:
    headers = {**TUS, "Upload-Length": "10", "Upload-Metadata": f"filename {b64('a.stl')}", "Idempotency-Key": "once"}
    first, second = [await web.operator.post("/api/v1/uploads", headers=headers) for _ in range(2)]
    assert first.headers["location"] == second.headers["location"]
    assert_problem(await web.operator.post("/api/v1/uploads", headers={**headers, "Upload-Length": "11"}), 422)


async def test_abandoned_uploads_expire_with_their_files(web: Any) -> None:
    place = (await announce(web.operator, BOX)).headers["location"]
    await send(web.operator, place, BOX[:100], 0)
    (web.service.store.blobs.uploads / "of-nobody").write_bytes(b"x")
    assert uploads.sweep(web.service) == []
    now = web.service.store.clock()
    object.__setattr__(web.service.store, "clock", lambda: now + uploads.KEPT_S + 1.0)
    assert uploads.sweep(web.service) == [place.rpartition("/")[2]]
    assert list(web.service.store.blobs.uploads.iterdir()) == []
    with web.service.store.read() as rows:
        assert store_uploads.every_id(rows) == set()


async def test_large_file_is_written_in_pieces_of_bounded_size(web: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = np.random.default_rng(1).integers(0, 256, 5_000_000, dtype=np.uint8).tobytes()
    sizes: list[int] = []
    write = Incoming.write

    def seen(self: Incoming, piece: bytes) -> None:
        sizes.append(len(piece))
        write(self, piece)

    monkeypatch.setattr(Incoming, "write", seen)

    async def pieces() -> AsyncIterator[bytes]:
        for start in range(0, len(data), 50_000):
            yield data[start : start + 50_000]

    place = (await announce(web.operator, data)).headers["location"]
    assert (await send(web.operator, place, pieces(), 0)).status_code == 204
    assert max(sizes) < 2 * incoming.BUFFER_BYTES and len(sizes) >= 4
    assert (web.service.store.blobs.uploads / place.rpartition("/")[2]).read_bytes() == data
