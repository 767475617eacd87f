"""The Python client against the application at a port: its example, uploads over lines that break, events over lines that break."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import trimesh

from cellctl import client as client_module
from cellctl import client_documents, client_events, client_upload
from cellctl.client import Client, ServiceError
from tests.unit.cellctl.served_by_thread import AtPort, at_port
from tests.unit.cellctl.test_store import part_in

PIECE_BYTES = 4096


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory, empty_store: Path) -> Iterator[AtPort]:
    with at_port(tmp_path_factory.mktemp("client"), empty_store) as found:
        yield found


@pytest.fixture
def sphere(tmp_path: Path) -> Path:
    """A mesh of some tens of kilobytes."""
    path = tmp_path / "sphere.stl"
    trimesh.creation.icosphere(subdivisions=3, radius=5.0).export(path)
    return path


class Line(httpx.HTTPTransport):
    """A line that breaks. broken : PATCH requests, counted from 0, whose answer is lost; cut : before the request is sent"""

    def __init__(self, lost: set[int], cut: set[int]) -> None:
        super().__init__()
        self.lost, self.cut = lost, cut
        self.offsets: list[int] = []

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        if request.method != "PATCH":
            return super().handle_request(request)
        number = len(self.offsets)
        self.offsets.append(int(request.headers["upload-offset"]))
        if number in self.cut:
            raise httpx.ConnectError("the network is away")
        answer = super().handle_request(request)
        if number in self.lost:
            answer.close()
            raise httpx.ReadError("the answer was lost")
        return answer


class Broken(httpx.SyncByteStream):
    """A body whose line breaks after a message."""

    def __init__(self, body: Any, messages: int) -> None:
        self.body, self.left = body, messages

    def __iter__(self) -> Iterator[bytes]:
        for chunk in self.body:
            yield chunk
            self.left -= chunk.count(b"data: ")
            if self.left <= 0:
                raise httpx.ReadError("the line broke")

    def close(self) -> None:
        self.body.close()


class EventLine(httpx.HTTPTransport):
    """Breaks every stream of events after a message; places : from where each one was asked for"""

    def __init__(self) -> None:
        super().__init__()
        self.places: list[str] = []

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        answer = super().handle_request(request)
        if request.url.path == client_events.PATH:
            self.places.append(request.headers.get("last-event-id", ""))
            answer = httpx.Response(answer.status_code, headers=answer.headers, stream=Broken(answer.stream, 1))
        return answer


@pytest.fixture
def in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files of some kilobytes are sent as large ones are, without waiting."""
    monkeypatch.setattr(client_module, "LARGE_BYTES", PIECE_BYTES)
    monkeypatch.setattr(client_upload, "PIECE_BYTES", PIECE_BYTES)
    monkeypatch.setattr(client_upload, "WAITS_S", (0.0,))
    monkeypatch.setattr(client_upload, "TRIES", 3)


def test_example_of_the_docstring_runs(served: AtPort, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "block.stl"
    trimesh.creation.box((12.0, 8.0, 2.0)).export(path)
    text = inspect.getdoc(client_module) or ""
    example = textwrap.dedent(text[text.index("    from cellctl.client") :])
    scope: dict[str, Any] = {"url": served.url, "token": served.token, "path": path}
    exec(compile(example, "example", "exec"), scope)
    assert "submitted" in capsys.readouterr().out
    with Client(served.url, served.token) as client:
        assert client.job(scope["job"]["id"])["state"] == "cancelled"
        assert [one["id"] for one in client.jobs("cancelled")] == [scope["job"]["id"]]
        assert client.part(scope["part"]["id"])["volume_mm3"] == pytest.approx(192.0)
        assert scope["part"]["id"] in [one["id"] for one in client.parts("block")]


def test_upload_goes_on_where_the_line_broke_also_by_another_client(served: AtPort, sphere: Path, in_pieces: None) -> None:
    size = sphere.stat().st_size
    pieces = -(-size // PIECE_BYTES)
    line = Line(lost={1}, cut={3, *range(6, 30)})
    told: list[int] = []
    with Client(served.url, served.token, transport=line) as client, pytest.raises(ServiceError) as error:
        client.upload(sphere, progress=lambda done, _total: told.append(done))
    assert error.value.status == 0 and "does not answer" in error.value.message
    # The lost answer's piece was counted and is not sent again; the one that never left is.
    assert [offset // PIECE_BYTES for offset in line.offsets] == [0, 1, 2, 3, 3, 4, 5, 5, 5]
    reached = line.offsets[-1]
    assert 0 < reached < size and told == sorted(told)

    again = Line(lost=set(), cut=set())
    with Client(served.url, served.token, transport=again) as client:
        part = client.upload(sphere, progress=lambda done, total: told.append(done))
        assert again.offsets == [reached + PIECE_BYTES * number for number in range(pieces - reached // PIECE_BYTES)]
        assert told[-1] == size
        assert part["bytes"] == size and part["volume_mm3"] == pytest.approx(trimesh.load_mesh(sphere).volume, rel=1e-5)
        assert client.content(f"parts/{part['id']}/file") == sphere.read_bytes()
        assert client.upload(sphere)["id"] == part["id"]  # as if the last answer had been lost
        assert len(again.offsets) == pieces - reached // PIECE_BYTES


def test_events_miss_nothing_and_tell_nothing_twice_over_a_line_that_breaks(served: AtPort, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client_events, "AGAIN_S", 0.01)
    part_id = part_in(served.service.store)
    line = EventLine()
    with Client(served.url, served.token) as client, Client(served.url, served.token, transport=line) as reader:
        names = [f"job {number}" for number in range(3)]
        reading = reader.events(place="0-0")
        made = [client.submit(part_id, name=name) for name in names[:2]]
        heard: list[str] = []
        for message in reading:
            if message.kind == "job" and message.document["job"]["name"] in names:
                heard.append(message.document["job"]["name"])
            if len(heard) == 2 and len(made) == 2:
                made.append(client.submit(part_id, name=names[2]))  # while the line is away
            if len(heard) == 3:
                break
        reading.close()  # type: ignore[attr-defined]
    assert heard == names
    assert line.places[0] == "0-0" and len(line.places) >= 3


def test_material_that_somebody_else_changed_is_not_overwritten(served: AtPort) -> None:
    with Client(served.url, served.token) as client:
        seen = client.material("316L")
        mine = client.post("materials", {"name": "own-316L", "copy_of": "316L", "because": "a finer powder"}, key="once")
        assert client.post("materials", {"name": "own-316L", "copy_of": "316L", "because": "a finer powder"}, key="once") == mine
        own = client.material("own-316L")
        number = next(name for name, value in own["facts"].items() if isinstance(value, float))
        changed = client.change_material(own, {**own["facts"], number: own["facts"][number] * 1.01}, "measured")
        assert (changed["version"], changed["facts"][number]) == (own["version"] + 1, pytest.approx(own["facts"][number] * 1.01))
        with pytest.raises(ServiceError) as error:
            client.change_material(own, own["facts"], "did not see it")
        assert error.value.status == 412 and error.value.type == "urn:hybridcell:problem:changed-meanwhile"
        assert client.material("own-316L", 1)["facts"] == seen["facts"]
        assert {"316L", "own-316L"} <= {one["name"] for one in client.materials()}
        assert [one["running"] for one in client.cells()] == [True]


def test_refusals_are_the_words_of_the_problem_document(served: AtPort) -> None:
    with Client(served.url, served.token) as client, pytest.raises(ServiceError) as error:
        client.submit("part_none")
    assert (error.value.status, error.value.type, error.value.exit_code) == (404, "urn:hybridcell:problem:not-found", 2)
    with Client(served.url, "cell_wrong") as client, pytest.raises(ServiceError) as error:
        client.parts().__next__()
    assert error.value.status == 401
    with Client("http://127.0.0.1:9", "", transport=Line(set(), set())) as client, pytest.raises(ServiceError) as error:
        client.job("job_1")
    assert error.value.hint.startswith("start it with")


def test_typed_documents_have_the_fields_of_the_interface(served: AtPort) -> None:
    schemas = httpx.get(f"{served.url}/openapi.json", trust_env=False).json()["components"]["schemas"]
    for typed in client_documents.ALL:
        assert set(typed.__annotations__) == set(schemas[typed.__name__]["properties"]), typed.__name__


def test_stream_is_read_as_the_standard_says() -> None:
    lines = iter(["retry: 1000", "id: 3-4", "", ": a comment", "event: job", 'data: {"a":', "data:1}", "id: 3-5", "", "data: {}", ""])
    found = list(client_events.messages(lines, "0-0"))
    assert [(one.kind, one.document, one.place) for one in found] == [("", {}, "3-4"), ("job", {"a": 1}, "3-5"), ("", {}, "3-5")]
