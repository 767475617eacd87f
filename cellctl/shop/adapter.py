"""The adapter's TCP side: tells every agent that connects everything once, then what changes, and answers its heartbeat."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from xml.etree import ElementTree as ET

from cellctl.shop import shdr
from cellctl.shop.mirror import Change, Mirror
from cellctl.shop.mtconnect_xml import tool_assets, tool_element

BEHIND_BYTES = 1 << 20  # an agent that has read less is cut off; it comes back and is told everything
LINE_MAX = 4096
AGENTS_MAX = 16


class Adapter:
    """Holds the connections. wall : clock, Unix time (s)"""

    def __init__(self, mirror: Mirror, wall: Callable[[], float]) -> None:
        self.mirror, self.wall = mirror, wall
        self._agents: set[asyncio.StreamWriter] = set()

    def tell(self, changes: dict[str, Change]) -> None:
        """Tell all agents what changed."""
        if changes and self._agents:
            data = self._data(shdr.lines(self.wall(), changes, self.mirror.conditions, self.mirror.messages))
            for writer in tuple(self._agents):
                if writer.transport.get_write_buffer_size() > BEHIND_BYTES:
                    self._agents.discard(writer)
                    writer.transport.abort()
                else:
                    writer.write(data)

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """One agent, until it leaves."""
        if len(self._agents) >= AGENTS_MAX:
            writer.close()
            return
        try:
            writer.write(self._greeting())
            self._agents.add(writer)
            while line := await reader.readline():
                said = shdr.answer(line.decode("utf-8", "replace"))
                if said is not None:
                    writer.write(self._data([said]))
        except (OSError, ValueError):
            pass  # it went away, or sent a line without an end
        finally:
            self._agents.discard(writer)
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()

    def close(self) -> None:
        """Let all agents go."""
        for writer in tuple(self._agents):
            writer.close()

    def _greeting(self) -> bytes:
        at = self.wall()
        told = ["* shdrVersion: 2", f"* device: {self.mirror.cell.name}"]
        for asset_id in tool_assets(self.mirror.cell):
            node = tool_element(self.mirror.cell, asset_id, self.mirror.instance)
            ET.indent(node)
            told += shdr.asset_lines(at, asset_id, "CuttingTool", ET.tostring(node, encoding="unicode"))
        told += shdr.lines(at, self.mirror.everything(), self.mirror.conditions, self.mirror.messages)
        return self._data(told)

    @staticmethod
    def _data(lines: list[str]) -> bytes:
        return "".join(f"{line}\n" for line in lines).encode()
