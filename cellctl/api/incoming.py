"""What comes in of an upload that can be resumed: written to its file in pieces of bounded size, made durable, then counted."""

from __future__ import annotations

import asyncio
import hashlib
import os
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from pathlib import Path

from starlette.requests import ClientDisconnect

from cellctl.api.problems import ApiError
from cellctl.store import Store, uploads
from cellctl.store.uploads import UploadRow

AT_ONCE_MAX = 4  # uploads that are being received: more of them only make each slower
BUFFER_BYTES = 1 << 20  # written at once
DURABLE_BYTES = 32 << 20  # received between two counts: what a crash of the machine may cost the sender
SILENCE_S = 60.0  # without a byte: the connection is given up, what came is kept
RETRY_S = "2"


class Receiving:
    """Which uploads are being received now; one sender each, AT_ONCE_MAX in all."""

    def __init__(self) -> None:
        self._ids: set[str] = set()

    def is_under_way(self, upload_id: str) -> bool:
        """Whether it is being received now."""
        return upload_id in self._ids

    @contextmanager
    def one(self, upload_id: str) -> Iterator[None]:
        """A place among them. Raises ApiError 423, 503."""
        if upload_id in self._ids:
            raise ApiError(423, "Being received", "another request sends this upload", "wait for it, then ask for the offset by HEAD")
        if len(self._ids) >= AT_ONCE_MAX:
            raise ApiError(
                503, "Too many uploads at once", f"{AT_ONCE_MAX} uploads are being received", "try again", {"Retry-After": RETRY_S}
            )
        self._ids.add(upload_id)
        try:
            yield
        finally:
            self._ids.discard(upload_id)


class Incoming:
    """The file of one upload, open for what comes next.

    checksum : SHA-256 of what this request brings, None if it says none. With one, all of it counts or nothing does.
    """

    def __init__(self, store: Store, row: UploadRow, checksum: bytes | None) -> None:
        self._store = store
        self._row = row
        self._checksum = checksum
        self._digest = hashlib.sha256()
        self._file = path_of(store, row.id).open("r+b", buffering=0)
        self._file.truncate(row.received)  # what was written and not counted is not trusted
        self._file.seek(row.received)
        self._written = self._counted = row.received

    def write(self, data: bytes | bytearray) -> None:
        """Append; counts what is durable every DURABLE_BYTES. Raises OSError, ApiError 413 for more than was announced."""
        if self._written + len(data) > self._row.bytes:
            raise ApiError(
                413, "Too large", f"more than the {self._row.bytes} bytes that were announced", "announce the file's size in Upload-Length"
            )
        if self._checksum is not None:
            self._digest.update(data)
        view = memoryview(data)
        while view:
            view = view[self._file.write(view) :]
        self._written += len(data)
        if self._checksum is None and self._written - self._counted >= DURABLE_BYTES:
            self.count()

    def count(self) -> int:
        """Make durable what was written and say so in the store; the new offset."""
        os.fdatasync(self._file.fileno())
        with self._store.write() as rows:
            uploads.advance(rows, self._row.id, self._written, self._store.clock())
        self._counted = self._written
        return self._counted

    def check(self) -> None:
        """Raise ApiError 460 if what came is not what was sent; it is dropped then."""
        if self._checksum is not None and self._digest.digest() != self._checksum:
            self.drop()
            raise ApiError(
                460, "Checksum mismatch", "what arrived is not what Upload-Checksum says", "send this piece again from the same offset"
            )

    @property
    def is_whole_or_nothing(self) -> bool:
        """Whether this request has a checksum."""
        return self._checksum is not None

    def drop(self) -> None:
        """Take back what is not counted."""
        self._file.truncate(self._counted)
        self._written = self._counted

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def path_of(store: Store, upload_id: str) -> Path:
    """The file of an upload whose row exists: ids of rows are our own, never a sender's."""
    return store.blobs.uploads / upload_id


async def receive(incoming: Incoming, body: AsyncIterator[bytes]) -> int:
    """Take a request's body; the new offset. A sender that goes away leaves what came of it, unless a checksum was to cover it.

    Raises ApiError 408 (silent sender), 413, 460, OSError (the disk).
    """
    buffer = bytearray()
    gone = silent = False
    try:
        while True:
            try:
                async with asyncio.timeout(SILENCE_S):
                    piece = await anext(body, None)
            except (ClientDisconnect, TimeoutError) as error:
                gone, silent = True, isinstance(error, TimeoutError)
                break
            if piece is None:
                break
            buffer += piece
            if len(buffer) >= BUFFER_BYTES:
                await asyncio.to_thread(incoming.write, buffer)
                buffer = bytearray()
        offset = await asyncio.to_thread(_settle, incoming, buffer, gone)
    finally:
        await asyncio.to_thread(incoming.close)
    if silent:
        raise ApiError(408, "Too slow", f"nothing came for {SILENCE_S:.0f} s", "ask for the offset by HEAD and go on from there")
    return offset


def _settle(incoming: Incoming, rest: bytearray, gone: bool) -> int:
    if gone and incoming.is_whole_or_nothing:
        incoming.drop()
    else:
        incoming.write(rest)
        incoming.check()
    return incoming.count()
