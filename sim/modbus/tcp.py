"""Modbus TCP: one listener per device, MBAP framing (Modbus Messaging on TCP/IP 1.0b, 3.1.3), requests of one connection in order."""

from __future__ import annotations

import asyncio
import contextlib
import struct

from sim.modbus.pdu import answer
from sim.modbus.registers import RegisterBank
from sim.modbus.wire import Wire

GATEWAY_TARGET_SILENT = 11
PDU_MAX = 253
ANY_DEVICE = (0, 255)  # ids that a device on its own address answers to besides its own


class TcpDevice:
    """A device on a port of its own. A request for another device id gets exception 11, as from a gateway."""

    def __init__(self, bank: RegisterBank, wire: Wire, device_id: int) -> None:
        self._bank, self._wire, self._id = bank, wire, device_id
        self._server: asyncio.Server | None = None
        self._place = ("", 0)
        self._breaks = wire.breaks
        self._connections: dict[asyncio.StreamWriter, asyncio.Task[None] | None] = {}

    async def listen(self, host: str, port: int) -> int:
        """Open the port (0: any free one) and return its number. Raises OSError when it is taken."""
        self._server = await asyncio.start_server(self._serve, host, port)
        self._place = host, int(self._server.sockets[0].getsockname()[1])
        return self._place[1]

    async def tend(self) -> None:
        """Refuse connections while the device is gone, listen again when it is back; close those that it has dropped."""
        if self._wire.breaks != self._breaks:
            self._breaks = self._wire.breaks
            await self._drop()
        if self._wire.is_gone and self._server is not None:
            await self.close()
        elif not self._wire.is_gone and self._server is None:
            with contextlib.suppress(OSError):  # somebody else has the port for a moment: tried again at the next call
                await self.listen(*self._place)

    async def _drop(self) -> None:
        tasks = [task for task in self._connections.values() if task is not None]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._connections[writer] = asyncio.current_task()
        try:
            while True:
                head = await reader.readexactly(7)
                transaction, protocol, length, device_id = struct.unpack(">HHHB", head)
                if protocol != 0 or not 2 <= length <= PDU_MAX + 1:
                    return
                request = await reader.readexactly(length - 1)
                if self._wire.is_silent:
                    continue
                if (delay_s := self._wire.take_delay_s()) > 0.0:
                    await asyncio.sleep(delay_s)
                if device_id in (self._id, *ANY_DEVICE):
                    reply = answer(request, self._bank, self._wire)
                else:
                    reply = bytes([request[0] | 0x80, GATEWAY_TARGET_SILENT])
                writer.write(struct.pack(">HHHB", transaction, 0, len(reply) + 1, device_id) + reply)
                await writer.drain()
        except (asyncio.IncompleteReadError, ConnectionError, asyncio.CancelledError):
            return  # cancelled by `close` alone; a stream's task that ends as cancelled is logged as an error by asyncio
        finally:
            self._connections.pop(writer, None)
            writer.close()

    async def close(self) -> None:
        """Close the port and every connection. Harmless twice."""
        if self._server is None:
            return
        server, self._server = self._server, None
        server.close()
        await self._drop()
        await server.wait_closed()
