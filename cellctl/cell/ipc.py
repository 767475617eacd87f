"""The unix socket of the cell process: commands request and reply, events in order, snapshots newest wins; a slow client delays nobody."""

from __future__ import annotations

import asyncio
import fcntl
import os
import socket
import struct
from collections import deque
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TextIO

import msgspec

from cellctl.domain.messages import PROTOCOL, Command, Event, Hello, Live, Message, Reply
from cellctl.domain.snapshot import Snapshot

FRAME_LIMIT = 1 << 20  # bytes
EVENTS_QUEUED_MAX = 10_000  # a client further behind is cut off; it reads the rest from the store
HELLO_TIMEOUT_S = 5.0
HEADER = struct.Struct(">I")

_encoder = msgspec.msgpack.Encoder()
_decoder: msgspec.msgpack.Decoder[Message] = msgspec.msgpack.Decoder(Message)


class FrameError(Exception):
    """The peer does not speak this protocol; the line says how."""


def encode(message: Message) -> bytes:
    """Length and struct."""
    body = _encoder.encode(message)
    return HEADER.pack(len(body)) + body


async def read_message(reader: asyncio.StreamReader) -> Message:
    """The next message. Raises FrameError, IncompleteReadError at the end of the stream."""
    (length,) = HEADER.unpack(await reader.readexactly(HEADER.size))
    if length > FRAME_LIMIT:
        raise FrameError(f"a frame of {length} bytes is above the limit of {FRAME_LIMIT}")
    try:
        return _decoder.decode(await reader.readexactly(length))
    except msgspec.MsgspecError as error:
        raise FrameError(f"a frame is not a known message: {error}") from None


class _Client:
    """One connection: replies and events in order, and at most one snapshot, the newest."""

    def __init__(self, writer: asyncio.StreamWriter) -> None:
        self.writer = writer
        self.queue: deque[Message] = deque()
        self.snapshot: Snapshot | None = None
        self.wake = asyncio.Event()
        self.is_greeted = False

    def put(self, message: Message) -> None:
        """Queue a reply or an event; a client that never reads is cut off."""
        if len(self.queue) >= EVENTS_QUEUED_MAX:
            self.writer.transport.abort()
            return
        self.queue.append(message)
        self.wake.set()

    async def send(self) -> None:
        """Write what is queued, for ever."""
        while True:
            await self.wake.wait()
            self.wake.clear()
            while self.queue:
                self.writer.write(encode(self.queue.popleft()))
                await self.writer.drain()
            if self.snapshot is not None:
                snapshot, self.snapshot = self.snapshot, None
                self.writer.write(encode(Live(snapshot)))
                await self.writer.drain()
            if self.queue or self.snapshot is not None:
                self.wake.set()


class IpcServer:
    """Serves the socket. `handle` carries a command out and returns its reply."""

    def __init__(self, handle: Callable[[Command], Awaitable[Reply]], name: str) -> None:
        self._handle = handle
        self._name = name
        self._clients: set[_Client] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._server: asyncio.Server | None = None
        self._path: Path | None = None
        self._lock: TextIO | None = None  # held as long as the process lives: of two that start at once one has the wires

    async def start(self, path: Path) -> None:
        """Listen on a socket that only this user can open. Raises OSError, FileExistsError if another cell process listens there."""
        self._lock = _locked(path.with_suffix(".lock"))
        if path.exists():
            if _is_listening(path):
                raise FileExistsError(f"{path}: another cell process listens there")
            path.unlink()
        mask = os.umask(0o177)
        try:
            self._server = await asyncio.start_unix_server(self._serve, path)
        finally:
            os.umask(mask)
        self._path = path

    async def close(self) -> None:
        """Close all connections and remove the socket. Harmless twice."""
        if self._server is None:
            return
        self._server.close()
        self._server = None
        for client in list(self._clients):
            client.writer.transport.abort()
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self._path is not None:
            self._path.unlink(missing_ok=True)
        if self._lock is not None:
            self._lock.close()

    def publish(self, snapshot: Snapshot) -> None:
        """Give every client the newest snapshot; one that it has not sent yet is replaced."""
        for client in self._clients:
            if client.is_greeted:
                client.snapshot = snapshot
                client.wake.set()

    def broadcast(self, events: list[Event]) -> None:
        """Give every client events that are durable."""
        for client in self._clients:
            if client.is_greeted:
                for event in events:
                    client.put(event)

    def _spawn(self, task: asyncio.Task[None]) -> None:
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        own = asyncio.current_task()
        if own is not None:
            self._spawn(own)
        client = _Client(writer)
        if not _is_same_user(writer):
            writer.close()
            return
        self._clients.add(client)
        sender = asyncio.get_running_loop().create_task(client.send())
        self._spawn(sender)
        try:
            await self._converse(client, reader)
        except (asyncio.IncompleteReadError, OSError, TimeoutError):
            pass
        except asyncio.CancelledError:
            if self._server is not None:  # at the end all of these tasks are cancelled, which is nothing to be told
                raise
        except FrameError as error:
            writer.write(encode(Reply("", False, str(error), "use the client of this version")))
        finally:
            self._clients.discard(client)
            sender.cancel()
            writer.close()

    async def _converse(self, client: _Client, reader: asyncio.StreamReader) -> None:
        async with asyncio.timeout(HELLO_TIMEOUT_S):
            hello = await read_message(reader)
        if not isinstance(hello, Hello):
            raise FrameError("the first message has to be Hello")
        if hello.protocol != PROTOCOL:
            raise FrameError(f"the cell process speaks protocol {PROTOCOL}, the client {hello.protocol}")
        client.put(Hello(PROTOCOL, self._name))
        client.is_greeted = True
        while True:
            message = await read_message(reader)
            if not isinstance(message, Command):
                raise FrameError(f"{type(message).__name__} is not for the cell process")
            # Each command is its own task: a start that reads a long Program never keeps a stop waiting.
            self._spawn(asyncio.get_running_loop().create_task(self._carry_out(client, message)))

    async def _carry_out(self, client: _Client, command: Command) -> None:
        client.put(await self._handle(command))


def _is_same_user(writer: asyncio.StreamWriter) -> bool:
    """Whether the peer runs as this user or as root (SO_PEERCRED)."""
    peer = writer.get_extra_info("socket")
    _, uid, _ = struct.unpack("3i", peer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i")))
    return uid in (os.getuid(), 0)


def _locked(path: Path) -> TextIO:
    """The file, locked for this process until it is closed. Raises FileExistsError if another process has it."""
    file = path.open("w")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        file.close()
        raise FileExistsError(f"{path}: another cell process runs here") from None
    return file


def _is_listening(path: Path) -> bool:
    """Whether somebody accepts connections on the socket file."""
    probe = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        probe.connect(str(path))
    except OSError:
        return False
    finally:
        probe.close()
    return True
