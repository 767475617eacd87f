"""The far end of a serial line: a pseudo-terminal whose near end has a name in the file system."""

from __future__ import annotations

import asyncio
import contextlib
import os
import tty
from collections.abc import Callable
from pathlib import Path

READ_MAX = 65536
OUTBOX_MAX = 65536  # bytes kept for a host that does not read; more are lost, as on a wire


class TerminalError(Exception):
    """The name of the line cannot be made. `message` is one line, `hint` says what to do."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.message, self.hint = message, hint


class PseudoTerminal:
    """`path` becomes a link to the host's end. `on_data` is called in the event loop when bytes wait; None: the owner polls with `read`."""

    def __init__(self, path: Path, on_data: Callable[[], None] | None) -> None:
        self.path = path
        self._outbox = bytearray()
        self._is_waiting = False
        self._make_room()
        self._far, self._near = os.openpty()  # the near end stays open, so that a host that closes is no end of file
        tty.setraw(self._near)
        os.set_blocking(self._far, False)
        self.name = os.ttyname(self._near)
        path.symlink_to(self.name)
        self._loop = asyncio.get_running_loop()
        self._has_reader = on_data is not None
        if on_data is not None:
            self._loop.add_reader(self._far, on_data)

    def _make_room(self) -> None:
        if self.path.is_symlink():
            target = self.path.readlink()
            if not str(target).startswith("/dev/pts/"):
                raise TerminalError(f"{self.path}: is a link to {target}", "name another port in the cell file")
            self.path.unlink()
        elif self.path.exists():
            raise TerminalError(f"{self.path}: exists and is no simulated port", "name another port in the cell file")
        self.path.parent.mkdir(parents=True, exist_ok=True)

    def read(self, most: int = READ_MAX) -> bytes:
        """Bytes from the host that are there now, at most `most`."""
        try:
            return os.read(self._far, most)
        except (BlockingIOError, OSError):
            return b""

    def write(self, data: bytes) -> None:
        """Bytes to the host; what the terminal does not take at once follows later."""
        if len(self._outbox) + len(data) <= OUTBOX_MAX:
            self._outbox += data
        self._flush()

    def _flush(self) -> None:
        while self._outbox:
            try:
                count = os.write(self._far, self._outbox)
            except BlockingIOError:
                if not self._is_waiting:
                    self._is_waiting = True
                    self._loop.add_writer(self._far, self._flush)
                return
            del self._outbox[:count]
        if self._is_waiting:
            self._is_waiting = False
            self._loop.remove_writer(self._far)

    def close(self) -> None:
        """Give the terminal back and remove the link, if it still is ours."""
        if self._has_reader:
            self._loop.remove_reader(self._far)
        if self._is_waiting:
            self._loop.remove_writer(self._far)
        os.close(self._far)
        os.close(self._near)
        with contextlib.suppress(OSError):
            if str(self.path.readlink()) == self.name:
                self.path.unlink()
