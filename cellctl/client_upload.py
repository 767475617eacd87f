"""The client's side of uploads in pieces (tus 1.0.0, see `cellctl.api.uploads`): goes on where an earlier try broke off."""

from __future__ import annotations

import base64
import hashlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, cast

if TYPE_CHECKING:
    from cellctl.client import Client
    from cellctl.client_documents import Part

PIECE_BYTES = 8 << 20
TRIES = 12  # of one piece; together they outlast a restart of the service
WAITS_S = (0.2, 0.5, 1.0, 2.0, 4.0)  # before the next try, the last one again and again
AGAIN = frozenset({0, 408, 409, 423, 460, 502, 503})  # statuses after which the offset is asked for and sending goes on; 0: no answer
FINISH_TIMEOUT_S = 1800.0  # of the check of a large mesh
TUS = {"Tus-Resumable": "1.0.0"}
Told = Callable[[int, int], None]


def _b64(data: bytes) -> str:
    return base64.b64encode(data).decode()


def in_pieces(client: Client, path: Path, units: str, progress: Told) -> Part:
    """Send a file; the Part. An upload of the same file that was begun earlier is gone on with, and one that is a part already is that
    part: whoever lost the answer may ask again. Raises ServiceError."""
    size = path.stat().st_size
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        same = [one for one in client.uploads() if (one["sha256"], one["bytes"], one["units"]) == (sha256, size, units)]
        begun = [one for one in same if one["part_id"] is None or one["filename"] == path.name]
        place = f"/api/v1/uploads/{begun[0]['id']}" if begun else announced(client, path.name, size, units, sha256)
        offset = begun[0]["received"] if begun else 0
        while offset < size:
            progress(offset, size)
            offset = sent(client, place, file, offset)
    progress(size, size)
    return cast("Part", client.request("POST", f"{place}/part", timeout=FINISH_TIMEOUT_S).json())


def announced(client: Client, name: str, size: int, units: str, sha256: str) -> str:
    """Begin an upload; its path. sha256 : hex digest of the whole file, or empty"""
    told = {"filename": name, "units": units, "sha256": sha256}
    metadata = ",".join(f"{key} {_b64(value.encode())}" for key, value in told.items() if value)
    headers = {**TUS, "Upload-Length": str(size), "Upload-Metadata": metadata}
    return str(client.request("POST", "/api/v1/uploads", headers=headers).headers["Location"])


def _offset(client: Client, place: str) -> int:
    return int(client.request("HEAD", place, headers=TUS).headers["Upload-Offset"])


def sent(client: Client, place: str, file: BinaryIO, offset: int) -> int:
    """Send one piece, again and again if need be; the offset behind it. Raises ServiceError."""
    from cellctl.client import ServiceError

    for attempt in range(TRIES):
        try:
            if attempt:
                offset = _offset(client, place)
            file.seek(offset)
            piece = file.read(PIECE_BYTES)
            headers = {
                **TUS,
                "Content-Type": "application/offset+octet-stream",
                "Upload-Offset": str(offset),
                "Upload-Checksum": f"sha256 {_b64(hashlib.sha256(piece).digest())}",
            }
            return int(client.request("PATCH", place, content=piece, headers=headers).headers["Upload-Offset"])
        except ServiceError as error:
            if error.status not in AGAIN or attempt == TRIES - 1:
                raise
            time.sleep(WAITS_S[min(attempt, len(WAITS_S) - 1)])
    raise AssertionError("the last try raises")
