"""The web process's end of the cell process's socket: reconnects for ever, keeps the newest snapshot, sends commands."""

from __future__ import annotations

import asyncio
import secrets
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import structlog

from cellctl.cell.ipc import FrameError, encode, read_message
from cellctl.domain.messages import PROTOCOL, Command, Event, Hello, Live, Message, Reply
from cellctl.domain.snapshot import Snapshot

RECONNECT_S = 0.5
REPLY_TIMEOUT_S = 10.0
FRESH_S = 1.0  # a snapshot older than this says nothing about now
log = structlog.get_logger(__name__)


class CellAbsentError(Exception):
    """The cell process does not answer. was_asked : it may have heard what it was asked"""

    def __init__(self, message: str, was_asked: bool = True) -> None:
        super().__init__(message)
        self.was_asked = was_asked


class CellLink:
    """Call `run` as one task. on_snapshot, on_event : told as they come, in the loop; on_connect : told at each connection"""

    def __init__(
        self,
        path: Path,
        on_snapshot: Callable[[Snapshot], None],
        on_event: Callable[[Event], None],
        on_connect: Callable[[], None],
    ) -> None:
        self._path = path
        self._on_snapshot = on_snapshot
        self._on_event = on_event
        self._on_connect = on_connect
        self._writer: asyncio.StreamWriter | None = None
        self._replies: dict[str, asyncio.Future[Reply]] = {}
        self._received_at = float("-inf")
        self.snapshot: Snapshot | None = None

    @property
    def is_connected(self) -> bool:
        """Whether the cell process is at the other end."""
        return self._writer is not None

    @property
    def age_s(self) -> float:
        """Seconds since the newest snapshot came."""
        return time.monotonic() - self._received_at

    @property
    def fresh(self) -> Snapshot | None:
        """The newest snapshot, if it tells about now."""
        return self.snapshot if self.is_connected and self.age_s < FRESH_S else None

    async def run(self) -> None:
        """Connect, read, reconnect, for ever."""
        while True:
            try:
                await self._converse()
            except (OSError, asyncio.IncompleteReadError, FrameError, TimeoutError) as error:
                if not isinstance(error, FileNotFoundError | ConnectionRefusedError):
                    log.warning("cell process gone", error=str(error))
            except Exception:
                log.exception("link to the cell process")
            await asyncio.sleep(RECONNECT_S)

    async def _converse(self) -> None:
        reader, writer = await asyncio.open_unix_connection(str(self._path))
        try:
            writer.write(encode(Hello(PROTOCOL, "web")))
            async with asyncio.timeout(REPLY_TIMEOUT_S):
                hello = await read_message(reader)
            if not isinstance(hello, Hello):
                raise FrameError(getattr(hello, "error", "the cell process did not say hello"))
            self._writer = writer
            self._on_connect()
            while True:
                self._take(await read_message(reader))
        finally:
            self._writer = None
            writer.close()
            for waiting in self._replies.values():
                if not waiting.done():
                    waiting.set_exception(CellAbsentError("the cell process went away while it was asked"))

    def _take(self, message: Message) -> None:
        if isinstance(message, Live):
            self.snapshot = message.snapshot
            self._received_at = time.monotonic()
            self._on_snapshot(message.snapshot)
        elif isinstance(message, Event):
            self._on_event(message)
        elif isinstance(message, Reply):
            waiting = self._replies.get(message.id)
            if waiting is not None and not waiting.done():
                waiting.set_result(message)

    async def command(
        self,
        verb: str,
        who: str,
        because: str,
        args: dict[str, Any] | None = None,
        ident: str | None = None,
        timeout_s: float = REPLY_TIMEOUT_S,
        client: str = "",
    ) -> Reply:
        """Send a command of a client and wait for its reply. Raises CellAbsentError."""
        writer = self._writer
        if writer is None:
            raise CellAbsentError("the cell process is not connected", was_asked=False)
        ident = ident or secrets.token_hex(8)
        waiting: asyncio.Future[Reply] = asyncio.get_running_loop().create_future()
        self._replies[ident] = waiting
        try:
            writer.write(encode(Command(id=ident, verb=verb, who=who, because=because, args=args or {}, client=client)))
            async with asyncio.timeout(timeout_s):
                return await waiting
        except TimeoutError:
            raise CellAbsentError(f"the cell process did not answer within {timeout_s:.0f} s") from None
        except OSError as error:
            raise CellAbsentError(f"the cell process is not connected: {error}") from None
        finally:
            self._replies.pop(ident, None)
