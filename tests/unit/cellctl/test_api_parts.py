from __future__ import annotations

import asyncio
import io
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import trimesh

from cellctl.api.parts import safe_name
from cellctl.api.problems import ApiError


def assert_problem(answer: httpx.Response, status: int) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem: dict[str, Any] = answer.json()
    assert problem["title"] and problem["detail"] and "\n" not in problem["detail"] and "Traceback" not in answer.text
    return problem


def box_bytes() -> bytes:
    return bytes(trimesh.creation.box((12.0, 8.0, 2.0)).export(file_type="stl"))


async def upload(
    client: httpx.AsyncClient, data: bytes, name: str = "block.stl", key: str = "", **fields: str
) -> httpx.Response:
    headers = {"Idempotency-Key": key} if key else {}
    return await client.post("/api/v1/parts", files={"file": (name, data)}, data=fields, headers=headers, timeout=60)


async def test_uploaded_part_is_measured_and_given_back(web: Any) -> None:
    assert_problem(await upload(web.operator, box_bytes(), units="furlong"), 422)
    answer = await upload(web.operator, box_bytes(), units="inch")
    assert answer.status_code == 201
    part = answer.json()
    assert part["facets"] == 12 and part["units"] == "inch" and part["volume_mm3"] == pytest.approx(192.0 * 25.4**3)
    assert np.allclose(part["bbox_mm"], np.multiply(25.4, [[-6, -4, -1], [6, 4, 1]]))
    assert (await web.viewer.get(f"/api/v1/parts/{part['id']}")).json() == part
    stl = await web.viewer.get(f"/api/v1/parts/{part['id']}/mesh")
    assert stl.headers["content-type"] == "model/stl"
    assert trimesh.load(io.BytesIO(stl.content), file_type="stl").volume == pytest.approx(192.0 * 25.4**3)


async def test_same_key_and_part_are_answered_alike_and_kept_once(web: Any) -> None:
    first, second = await asyncio.gather(*(upload(web.operator, box_bytes(), key="k") for _ in range(2)))
    assert first.status_code == second.status_code == 201 and first.json() == second.json()
    assert len((await web.viewer.get("/api/v1/parts")).json()["items"]) == 1
    problem = assert_problem(await upload(web.operator, box_bytes(), key="k", units="inch"), 422)
    assert "Idempotency-Key" in problem["title"]


BROKEN = {
    "empty": b"",
    "truncated": box_bytes()[:300],
    "not a number": box_bytes()[:96] + np.float32(np.nan).tobytes() + box_bytes()[100:],
}


@pytest.mark.parametrize("kind", BROKEN)
async def test_broken_file_is_refused_in_one_line_and_leaves_nothing(web: Any, kind: str) -> None:
    assert_problem(await upload(web.operator, BROKEN[kind]), 422)
    assert (await web.viewer.get("/api/v1/parts")).json()["items"] == []
    blobs = web.service.settings.store / "blobs"
    assert not [path for path in blobs.rglob("*") if path.is_file()]


async def test_file_above_the_limit_is_refused_whether_its_size_is_told_or_not(web: Any) -> None:
    assert_problem(await upload(web.operator, b"\0" * 3_000_000), 413)

    async def chunks() -> Any:
        yield b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.stl"\r\n\r\n'
        for _ in range(30):
            yield b"\0" * 100_000
        yield b"\r\n--b--\r\n"

    headers = {"Content-Type": "multipart/form-data; boundary=b"}
    assert_problem(await web.operator.post("/api/v1/parts", content=chunks(), headers=headers), 413)


async def test_who_may_not_upload_gets_no_room_on_the_disk(web: Any) -> None:
    body = b"\0" * 1_500_000
    assert_problem(await upload(web.nobody, body), 413)
    assert_problem(await upload(web.viewer, body), 413)
    assert_problem(await upload(web.nobody, b"solid a"), 401)
    assert_problem(await upload(web.operator, body), 422)


@pytest.mark.parametrize(
    ("filename", "stem"),
    [
        ("../../etc/passwd.stl", "passwd"),
        ("C:\\parts\\pipe.STL", "pipe"),
        ("<img src=x onerror=alert(1)>.stl", "img_src_x_onerror_alert_1"),
        ("..stl", "part"),
        ("été.stl", "t"),
        ("a" * 500 + ".3mf", "a" * 100),
    ],
)
def test_name_of_a_file_keeps_plain_characters_only(filename: str, stem: str) -> None:
    assert safe_name(filename)[0] == stem


@pytest.mark.parametrize("filename", [None, "", "part", "part.exe", "part.stl.exe", "/", "part.stl/.."])
def test_file_of_another_kind_is_refused(filename: str | None) -> None:
    with pytest.raises(ApiError):
        safe_name(filename)


async def test_no_part_is_a_problem(web: Any, block: Path) -> None:
    assert_problem(await web.viewer.get("/api/v1/parts/part-none"), 404)
    assert_problem(await web.viewer.get("/api/v1/parts/part-none/mesh"), 404)
    assert_problem(await web.operator.post("/api/v1/parts", data={"units": "mm"}), 422)
    assert_problem(await web.viewer.post("/api/v1/parts", files={"file": ("block.stl", block.read_bytes())}), 403)
