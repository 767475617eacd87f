"""Other hosts of the house at which pages for this cell are open: the STOP listener is told, and lets them read its answers."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from contextlib import suppress

from cellctl.api.cell_link import CellAbsentError, CellLink
from cellctl.api.security import host_of

MOST = 32  # the oldest is forgotten; its pages learn that a STOP was done by way of the web process


class PageHosts:
    """Call `run` as one task."""

    def __init__(self, link: CellLink) -> None:
        self._link = link
        self._hosts: OrderedDict[str, None] = OrderedDict()
        self._wake = asyncio.Event()

    def seen(self, header: str) -> None:
        """A page under this Host header asked for something."""
        name = host_of(header).lower()
        if name not in self._hosts:
            self._hosts[name] = None
            if len(self._hosts) > MOST:
                self._hosts.popitem(last=False)
            self._wake.set()

    def tell_again(self) -> None:
        """The cell process is another one."""
        self._wake.set()

    async def run(self) -> None:
        """Tell the cell process, for ever."""
        while True:
            await self._wake.wait()
            self._wake.clear()
            if self._hosts:
                with suppress(CellAbsentError):  # it is told when it is there again
                    await self._link.command("pages", "the web process", "", {"hosts": list(self._hosts)})
