from __future__ import annotations

from typing import Any

import pytest
import trimesh

from cellctl.api import conditional
from cellctl.api.parts import document
from cellctl.api.problems import type_of
from cellctl.store import parts
from cellctl.store.parts import Inspection, PartRow


@pytest.fixture
def part_id(web: Any) -> str:
    """A part whose mesh lies in the store, without a worker's help."""
    mesh = trimesh.creation.box((12.0, 8.0, 2.0)).export(file_type="stl")
    seen = Inspection("m" * 64, [[0.0, 0.0, 0.0], [12.0, 8.0, 2.0]], 12, 192.0, [])
    row = PartRow("part-1", "block", ".stl", "mm", "f" * 64, len(mesh), 1.0, "me", seen)
    web.service.store.blobs.mesh(seen.mesh_sha256).write_bytes(mesh)
    web.service.store.blobs.part(row.sha256, ".stl").write_bytes(mesh)
    with web.service.store.write() as rows:
        parts.add(rows, row)
    return row.id


@pytest.mark.parametrize("path", ["parts/part-1", "parts/part-1/mesh", "parts/part-1/file", "parts", "cell/facts", "materials/316L"])
async def test_who_has_it_already_gets_no_body_a_second_time(web: Any, part_id: str, path: str) -> None:
    first = await web.viewer.get(f"/api/v1/{path}")
    etag = first.headers["etag"]
    assert first.status_code == 200 and etag.startswith('"') and first.content
    for known in (etag, f'"other", W/{etag}', "*"):
        again = await web.viewer.get(f"/api/v1/{path}", headers={"If-None-Match": known})
        assert again.status_code == 304 and again.content == b"" and again.headers["etag"] == etag
    other = await web.viewer.get(f"/api/v1/{path}", headers={"If-None-Match": '"other"'})
    assert other.status_code == 200 and other.content == first.content
    head = await web.viewer.head(f"/api/v1/{path}")
    assert head.status_code == 200 and head.content == b"" and head.headers["etag"] == etag
    assert head.headers["content-length"] == str(len(first.content))


async def test_blobs_are_named_by_their_hash(web: Any, part_id: str) -> None:
    assert (await web.viewer.get(f"/api/v1/parts/{part_id}/mesh")).headers["etag"] == f'"{"m" * 64}"'
    assert (await web.viewer.get(f"/api/v1/parts/{part_id}/file")).headers["etag"] == f'"{"f" * 64}"'


async def test_validator_of_a_document_is_the_same_for_who_reads_and_who_changes(web: Any, part_id: str) -> None:
    with web.service.store.read() as rows:
        told = document(parts.get(rows, part_id))
    assert conditional.etag_of_document(told) == (await web.viewer.get(f"/api/v1/parts/{part_id}")).headers["etag"]


async def test_errors_have_no_validator_and_a_kind_that_stays(web: Any) -> None:
    missing = await web.viewer.get("/api/v1/parts/none", headers={"If-None-Match": "*"})
    assert missing.status_code == 404 and "etag" not in missing.headers
    assert missing.json()["type"] == type_of("Not found") == "urn:hybridcell:problem:not-found"


@pytest.mark.parametrize(
    ("method", "path", "allow"),
    [
        ("DELETE", "/api/v1/parts", "GET, HEAD, POST"),
        ("GET", "/api/v1/jobs/job-1/approve", "POST"),
        ("HEAD", "/api/v1/jobs/job-1/approve", "POST"),
        ("PUT", "/healthz", "GET, HEAD"),
        ("POST", "/index.html", "GET, HEAD"),
        ("PUT", "/api/v1/uploads/x", "DELETE, GET, HEAD, PATCH"),
    ],
)
async def test_method_that_is_not_there_is_answered_with_those_that_are(web: Any, method: str, path: str, allow: str) -> None:
    answer = await web.viewer.request(method, path)
    assert (answer.status_code, answer.headers["allow"]) == (405, allow)
    if method != "HEAD":
        assert answer.headers["content-type"] == "application/problem+json" and answer.json()["status"] == 405


@pytest.mark.parametrize("method", ["GET", "POST", "DELETE"])
async def test_path_that_is_not_there_is_not_found_whatever_is_asked_of_it(web: Any, method: str) -> None:
    answer = await web.viewer.request(method, "/api/v1/nothing")
    assert answer.status_code == 404 and answer.json()["type"] == type_of("Not found")
