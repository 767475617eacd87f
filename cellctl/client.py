"""A small typed client of the REST interface: parts, uploads, jobs, materials, the cell and its events.

Documents are dicts with the fields that /openapi.json describes, typed in `cellctl.client_documents`. Every call raises ServiceError:
`message` says what is wrong, `hint` what to do, `type` names the kind for programs. A file above LARGE_BYTES is sent in pieces and goes
on where it broke off, also in another process and after a restart of the service.

    from cellctl.client import Client, ServiceError

    with Client(url, token) as client:
        part = client.upload(path, units="mm", progress=lambda done, total: print(f"{done} of {total} bytes"))
        steel = client.material("316L")
        try:
            job = client.submit(part["id"], recipe={"material": steel["name"]}, name="one block")
        except ServiceError as error:
            raise SystemExit(f"{error.message}; {error.hint}")
        for message in client.events(place="0-0"):
            if message.kind == "job" and message.document["job"]["id"] == job["id"]:
                print(message.document["job"]["state"])
                break
        client.cancel(job["id"], because="only an example")
"""

from __future__ import annotations

import getpass
import json
import re
import secrets
import socket
import ssl
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast

import httpx

from cellctl.client_documents import (
    CellDocument,
    CommandAnswer,
    EventItem,
    Fleet,
    Job,
    MaterialDocument,
    Part,
    ProgramHead,
    Upload,
)
from cellctl.client_events import LiveMessage, read_stream
from cellctl.client_upload import in_pieces

TIMEOUT_S = 30.0
LARGE_BYTES = 16 << 20  # a file above it is sent in pieces
UPLOAD_TIMEOUT_S = 600.0

Document = dict[str, Any]
NO_NAME = re.compile(r"[^A-Za-z0-9._@-]")


class ServiceError(Exception):
    """The service refused or does not answer. `message`, `hint` : one line each; status : of HTTP, 0 without an answer

    type : kind of the problem (RFC 9457), empty without one; errors : field by field
    exit_code : 2 if what was asked is at fault, 1 otherwise
    """

    def __init__(
        self, message: str, hint: str = "", status: int = 0, kind: str = "", errors: list[dict[str, str]] | None = None
    ) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.status = status
        self.type = kind
        self.errors = errors or []
        self.exit_code = 2 if status in (400, 404, 413, 422) else 1


class Client:
    """Talks to one service. Every call raises ServiceError with the words of the problem document."""

    def __init__(
        self, url: str, token: str, transport: httpx.BaseTransport | None = None, name: str = "", verify: ssl.SSLContext | bool = True
    ) -> None:
        """name : by which the cell tells this client from others of the same person; default: user and machine    verify : of TLS"""
        self.url = url.rstrip("/")
        self.verify = verify
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        headers["X-Client-Id"] = name or own_name()
        self._http = httpx.Client(
            base_url=self.url, headers=headers, timeout=TIMEOUT_S, trust_env=False, transport=transport, verify=verify
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection."""
        self._http.close()

    def request(self, method: str, path: str, **options: Any) -> httpx.Response:
        """One request; its answer if it is not an error."""
        try:
            answer = self._http.request(method, path, **options)
        except httpx.HTTPError as error:
            why = (
                "nothing listens there" if isinstance(error, httpx.ConnectError) else f"{type(error).__name__}: {error}"
            )
            raise ServiceError(
                f"{self.url}: the service does not answer: {why}",
                "start it with `cellctl serve`, or name it with --url",
            ) from None
        self.check(answer)
        return answer

    @staticmethod
    def check(answer: httpx.Response) -> None:
        """Raise the ServiceError that an answer tells of, if it does."""
        if answer.is_error:
            raise _refusal(answer)

    def get(self, path: str, **params: Any) -> Document:
        """A document under /api/v1."""
        given = {name: value for name, value in params.items() if value is not None}
        return dict(self.request("GET", f"/api/v1/{path}", params=given).json())

    def post(self, path: str, document: Document, key: str | None = None) -> Document:
        """Post a document under /api/v1, with an Idempotency-Key if given."""
        headers = {"Idempotency-Key": key} if key else {}
        return dict(self.request("POST", f"/api/v1/{path}", json=document, headers=headers).json())

    def upload(self, path: Path, units: str = "mm", progress: Callable[[int, int], None] | None = None) -> Part:
        """Upload a mesh; the Part. Sent again after a lost answer it is the same one. progress : told (bytes sent, bytes)"""
        if path.stat().st_size > LARGE_BYTES:
            return in_pieces(self, path, units, progress or (lambda _done, _total: None))
        with path.open("rb") as file:
            answer = self.request(
                "POST",
                "/api/v1/parts",
                files={"file": (path.name, file, "application/octet-stream")},
                data={"units": units},
                headers={"Idempotency-Key": secrets.token_hex(16)},
                timeout=UPLOAD_TIMEOUT_S,
            )
        return cast("Part", dict(answer.json()))

    def every(self, path: str, **params: Any) -> Iterator[Document]:
        """All items of a list under /api/v1, newest first, page by page."""
        cursor: str | None = None
        while True:
            page = self.get(path, cursor=cursor, limit=100, **params)
            yield from page["items"]
            cursor = page["next"]
            if cursor is None:
                return

    def parts(self, text: str | None = None) -> Iterator[Part]:
        """All Parts, newest first; text : in their name."""
        return cast("Iterator[Part]", self.every("parts", text=text))

    def part(self, part_id: str) -> Part:
        """One Part."""
        return cast("Part", self.get(f"parts/{part_id}"))

    def materials(self) -> list[MaterialDocument]:
        """The newest version of every material."""
        return cast("list[MaterialDocument]", list(self.get("materials")["items"]))

    def material(self, name: str, version: int | None = None) -> MaterialDocument:
        """A material: its newest version, or that one."""
        return cast("MaterialDocument", self.get(f"materials/{name}" if version is None else f"materials/{name}/versions/{version}"))

    def change_material(self, seen: MaterialDocument, facts: Document, because: str) -> MaterialDocument:
        """The next version of a material that was read (`seen`). Raises ServiceError 412 if somebody else changed it since."""
        headers = {"If-Match": f'"{seen["sha256"]}-{seen["version"]}"'}
        body = {"facts": facts, "because": because}
        return cast("MaterialDocument", dict(self.request("PUT", f"/api/v1/materials/{seen['name']}", json=body, headers=headers).json()))

    def cells(self) -> list[CellDocument]:
        """The cell files that services on this store ran."""
        return cast("list[CellDocument]", list(self.get("cells")["items"]))

    def fleet(self) -> Fleet:
        """The cells of the house: what each does, and how old that news is."""
        return cast("Fleet", self.get("fleet"))

    def uploads(self) -> list[Upload]:
        """One's own uploads that came in pieces."""
        return cast("list[Upload]", list(self.get("uploads")["items"]))

    def past_events(self, job_id: str | None = None) -> Iterator[EventItem]:
        """What happened at the cell, newest first."""
        return cast("Iterator[EventItem]", self.every("cell/events", job=job_id))

    def events(self, place: str = "", snapshots: bool = False) -> Iterator[LiveMessage]:
        """What happens, for ever; comes back by itself and misses nothing.

        place : of the last message seen (`LiveMessage.place`), "0-0" for all that ever was; empty: from now on
        """
        return read_stream(self._http, place, snapshots, self.check)

    def submit(
        self,
        part_id: str,
        *,
        recipe: Document | None = None,
        recipe_toml: str | None = None,
        name: str | None = None,
        cell: str | None = None,
        key: str | None = None,
    ) -> Job:
        """Submit a job; the Job. cell: its name, or any: the fitting one with the least work; default: the one that the service runs"""
        body = {"part_id": part_id, "recipe": recipe, "recipe_toml": recipe_toml, "name": name, "cell": cell}
        given = {field: value for field, value in body.items() if value is not None}
        return cast("Job", self.post("jobs", given, key or secrets.token_hex(16)))

    def job(self, job_id: str) -> Job:
        """One Job."""
        return cast("Job", self.get(f"jobs/{job_id}"))

    def jobs(self, state: str | None = None, **asked: str | None) -> Iterator[Job]:
        """All jobs, newest first, page by page. asked: tag, material, part, cell, text, by, as GET /api/v1/jobs takes them"""
        return cast("Iterator[Job]", self.every("jobs", state=state, **asked))

    def approve(
        self,
        job_id: str,
        *,
        because: str = "",
        override_reason: str = "",
        table_clear: bool = False,
        part_untouched: bool = False,
    ) -> Job:
        """Approve a job; the Job. table_clear, or of a job that continues another part_untouched: a person looked"""
        found = {"table_clear": table_clear, "part_untouched": part_untouched}
        return cast("Job", self.post(f"jobs/{job_id}/approve", {"because": because, "override_reason": override_reason, **found}))

    def rerun(self, job_id: str, because: str = "", key: str | None = None) -> Job:
        """The same once more; the new Job."""
        return cast("Job", self.post(f"jobs/{job_id}/rerun", {"because": because}, key or secrets.token_hex(16)))

    def retry(self, job_id: str, because: str = "", key: str | None = None) -> Job:
        """A failed job again from the step that failed; the new Job."""
        return cast("Job", self.post(f"jobs/{job_id}/retry", {"because": because}, key or secrets.token_hex(16)))

    def resumption_point(self, job_id: str) -> Document:
        """Where metal ended in a job that was interrupted, and what one may go on from."""
        return self.get(f"jobs/{job_id}/resumption-point")

    def go_on(
        self,
        job_id: str,
        *,
        layer: int | None = None,
        operation: int | None = None,
        overlap_mm: float | None = None,
        because: str = "",
        key: str | None = None,
    ) -> Job:
        """Go on with the part of an interrupted job, from where metal ended or the begin of a layer or operation; the new Job."""
        start = "layer" if layer is not None else "operation" if operation is not None else "metal_end"
        body = {"from": start, "layer": layer, "operation": operation, "overlap_mm": overlap_mm, "because": because}
        return cast("Job", self.post(f"jobs/{job_id}/resume", body, key or secrets.token_hex(16)))

    def program_head(self, job_id: str) -> ProgramHead:
        """The first lines of a job's program, to be read."""
        return cast("ProgramHead", self.get(f"jobs/{job_id}/program/head"))

    def cancel(self, job_id: str, because: str = "") -> Job:
        """Cancel a job; the Job."""
        return cast("Job", self.post(f"jobs/{job_id}/cancel", {"because": because}))

    def command(self, verb: str, because: str = "", **fields: Any) -> CommandAnswer:
        """Command the cell: start, hold, resume, abort, stop, reset, home, unlock, confirm_position, jog, override."""
        return cast("CommandAnswer", self.post(f"cell/{verb}", {"because": because, **fields}))

    def take_control(self, because: str = "") -> CommandAnswer:
        """Take control of the cell; taking it over from another client needs a reason."""
        return cast("CommandAnswer", self.post("cell/control", {"action": "take", "because": because}))

    def release_control(self) -> CommandAnswer:
        """Give control of the cell back."""
        return cast("CommandAnswer", self.post("cell/control", {"action": "release"}))

    def keep_jogging(self) -> CommandAnswer:
        """The button of a continuous jog is still held; said several times within the cell file's jog_repeat_s."""
        return cast("CommandAnswer", self.post("cell/jog/keep", {}))

    def end_jog(self) -> CommandAnswer:
        """The button of a continuous jog was let go."""
        return cast("CommandAnswer", self.post("cell/jog/end", {}))

    def snapshot(self) -> Document:
        """The cell's newest snapshot."""
        return self.get("cell")

    def record(self, job_id: str) -> Document:
        """A job's record."""
        return self.get(f"jobs/{job_id}/record")

    def content(self, path: str, **params: Any) -> bytes:
        """The bytes of a file under /api/v1."""
        return self.request("GET", f"/api/v1/{path}", params=params).content


def own_name() -> str:
    """A client's name where it is told none: user and machine, the same for every call of the command line."""
    try:
        user = getpass.getuser()
    except (OSError, KeyError):
        user = "user"
    return NO_NAME.sub("-", f"{user}@{socket.gethostname()}")[:64]


def _refusal(answer: httpx.Response) -> ServiceError:
    """The error in a problem document, or what can be said of another answer."""
    try:
        problem = answer.json()
        return ServiceError(
            str(problem["detail"] or problem["title"]),
            str(problem.get("hint", "")),
            answer.status_code,
            str(problem.get("type", "")),
            problem.get("errors"),
        )
    except (json.JSONDecodeError, KeyError, TypeError, UnicodeDecodeError):
        return ServiceError(
            f"the service answered {answer.status_code} {answer.reason_phrase}", "look at its log", answer.status_code
        )
