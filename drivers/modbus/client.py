"""A Modbus line over pymodbus, TCP or RTU: one request at a time, never cancelled in flight, every answer checked.

On RTU nothing tells a late answer from the one that is waited for. So a request that timed out is waited out before the
next one goes, and function, address and count of every answer are compared with the question.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from pathlib import Path

from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusException
from pymodbus.pdu import ExceptionResponse, ModbusPDU

from config.cell import Link
from config.device import Table
from drivers.errors import DeviceFault, DeviceSilent, LinkLost, PortAbsent, WrongAnswer
from drivers.interfaces import Clock
from drivers.transport.serial_port import SerialPort

# what goes wrong on the wire is raised to the caller, who tells it once; pymodbus would print it at every attempt
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)

Client = AsyncModbusTcpClient | AsyncModbusSerialClient
Send = Callable[[Client], Awaitable[ModbusPDU]]

EXCEPTIONS = {
    1: "illegal function", 2: "illegal data address", 3: "illegal data value", 4: "device failure", 5: "acknowledge",
    6: "device busy", 8: "memory parity error", 10: "gateway path unavailable", 11: "gateway target does not respond",
}  # fmt: skip  # Modbus Application Protocol 1.1b3, chapter 7
READ_FUNCTIONS: dict[Table, int] = {"coil": 1, "discrete": 2, "holding": 3, "input": 4}
EXCEPTION_BIT = 0x80  # set in the function code of an exception
FRAME_GAP_CHARACTERS = 3.5  # silence between RTU frames (Modbus over serial line 1.02, 2.5.1.1)
FRAME_GAP_MIN_S = 0.00175  # the same above 19200 baud
BITS_PER_CHARACTER = 11  # the same, 2.5.1: start, 8 data, parity or a second stop, stop
WRITE_ANSWER_CHARACTERS = 8  # answers to functions 5, 6, 15 and 16
WAIT_OUT_FACTOR = 1.0  # a device that missed its time-out is given as long again
CHECK_MAP = "compare the register map with the device's document"


class PymodbusLink:
    """One TCP connection, or one serial line for all devices on it.

    facts : how the line is reached (device_id is not used). timeout_s : per request, the longest of the line's devices
    folder : where relative serial ports are
    """

    def __init__(self, facts: Link, timeout_s: float, clock: Clock, folder: Path = Path(".")) -> None:
        self._facts = facts
        self._timeout_s = timeout_s
        self._clock = clock
        self._is_rtu = facts.transport == "rtu"
        self._path = str(folder / facts.serial_port) if self._is_rtu else ""
        self.name = self._path if self._is_rtu else f"{facts.host}:{facts.tcp_port}"
        self._client: Client | None = None
        self._lock = asyncio.Lock()
        self._requests: set[asyncio.Task[ModbusPDU]] = set()
        self._gap_s = max(FRAME_GAP_MIN_S, FRAME_GAP_CHARACTERS * BITS_PER_CHARACTER / facts.baud) if self._is_rtu else 0.0
        self._heard_at = 0.0
        self._missed_at: float | None = None

    @property
    def connected(self) -> bool:
        """Whether the line is open."""
        return self._client is not None and bool(self._client.connected)

    @property
    def write_answer_s(self) -> float:
        """Time that an answer to a write is on the line itself (s); on TCP nothing worth the name."""
        return WRITE_ANSWER_CHARACTERS * BITS_PER_CHARACTER / self._facts.baud if self._is_rtu else 0.0

    async def connect(self) -> None:
        """Open the line; harmless when open. Raises PortAbsent, PortBusy, PortDenied."""
        async with self._lock:
            if self.connected:
                return
            if self._client is not None:
                self._client.close()
            self._missed_at = None
            self._client = self._new_client()
            if not await self._client.connect():
                self._client.close()
                self._client = None
                self._raise_absent()

    async def read(self, device_id: int, table: Table, address: int, count: int) -> list[int]:
        """`count` words or bits. Raises LinkLost, DeviceSilent, DeviceFault, WrongAnswer."""
        what = f"device {device_id}, {table} {address}..{address + count - 1}"
        function = READ_FUNCTIONS[table]
        answer = await self._request(lambda client: self._send_read(client, device_id, table, address, count), function, what)
        if table in ("coil", "discrete"):
            if len(answer.bits) != (count + 7) // 8 * 8:
                raise self._wrong(what, f"{len(answer.bits) // 8} bytes of bits where {(count + 7) // 8} were asked")
            return [int(bit) for bit in answer.bits[:count]]
        if len(answer.registers) != count:
            raise self._wrong(what, f"{len(answer.registers)} registers where {count} were asked")
        return list(answer.registers)

    async def write(
        self, device_id: int, table: Table, address: int, values: list[int], sending: Callable[[], None] | None = None
    ) -> None:
        """Write words (holding) or bits (coil). sending : called as the request goes out. Raises LinkLost, DeviceSilent, DeviceFault, WrongAnswer."""
        what = f"device {device_id}, writing {table} {address}..{address + len(values) - 1}"
        is_one = len(values) == 1
        function = (5 if is_one else 15) if table == "coil" else (6 if is_one else 16)

        def send(client: Client) -> Awaitable[ModbusPDU]:
            if sending is not None:
                sending()
            return self._send_write(client, device_id, table, address, values)

        answer = await self._request(send, function, what)
        if answer.address != address:
            raise self._wrong(what, f"an answer for address {answer.address}")
        echoed = [int(bit) for bit in answer.bits] if table == "coil" else answer.registers
        if is_one and list(echoed[:1]) != values:
            raise self._wrong(what, f"{echoed[:1]} echoed where {values} was written")
        if not is_one and answer.count != len(values):
            raise self._wrong(what, f"{answer.count} values taken where {len(values)} were written")

    async def close(self) -> None:
        """Let requests in flight end, then close the line."""
        if self._requests:
            await asyncio.wait(self._requests)
        if self._client is not None:
            self._client.close()
            self._client = None

    def _new_client(self) -> Client:
        if self._is_rtu:
            return AsyncModbusSerialClient(
                self._path, baudrate=self._facts.baud, parity=self._facts.parity, timeout=self._timeout_s,
                retries=0, reconnect_delay=0, trace_packet=self._trace,
            )  # fmt: skip
        return AsyncModbusTcpClient(
            self._facts.host, port=self._facts.tcp_port, timeout=self._timeout_s,
            retries=0, reconnect_delay=0, trace_packet=self._trace,
        )  # fmt: skip

    def _trace(self, sending: bool, data: bytes) -> bytes:
        if not sending:
            self._heard_at = self._clock.now()
        return data

    def _raise_absent(self) -> None:
        if self._is_rtu:
            SerialPort(self._path, self._facts.baud).close()  # says by its error why it cannot be opened
            raise PortAbsent(f"Modbus line {self.name} cannot be opened", "check port and baud rate in the cell file")
        raise PortAbsent(f"nothing answers at Modbus TCP {self.name}", "check the device's power, network, host and tcp_port")

    async def _request(self, send: Send, function: int, what: str) -> ModbusPDU:
        """Carry out one request even if the caller goes away meanwhile; its answer, if it is one to this function."""
        task = asyncio.ensure_future(self._transact(send, what))
        self._requests.add(task)
        task.add_done_callback(self._ended)
        answer = await asyncio.shield(task)
        if answer.function_code & ~EXCEPTION_BIT != function:
            raise self._wrong(what, f"an answer to function {answer.function_code} where {function} was asked")
        if isinstance(answer, ExceptionResponse) or answer.isError():
            code = answer.exception_code
            name = EXCEPTIONS.get(code, "unknown exception")
            raise DeviceFault(f"Modbus {self.name} answered exception {code} ({name}) to {what}", CHECK_MAP, code)
        return answer

    def _ended(self, task: asyncio.Task[ModbusPDU]) -> None:
        self._requests.discard(task)
        if not task.cancelled():
            task.exception()  # seen here as well, in case that nobody waits for it any more

    async def _transact(self, send: Send, what: str) -> ModbusPDU:
        async with self._lock:
            client = self._client
            if client is None or not client.connected:
                raise LinkLost(f"Modbus {self.name} is not connected", "it is opened again by itself; check cable and power")
            if self._is_rtu:
                await self._keep_silence()
            try:
                return await send(client)
            except (ModbusException, OSError) as error:
                self._missed_at = self._clock.now()
                if isinstance(error, (ConnectionException, OSError)) or not client.connected:
                    raise LinkLost(f"Modbus {self.name} was closed during a request ({what})", "check the device's power and cable") from None
                limit_ms = self._timeout_s * 1000
                raise DeviceSilent(
                    f"no answer within {limit_ms:.0f} ms on Modbus {self.name} ({what})", "check the device's power, cable, id and baud rate"
                ) from None

    async def _keep_silence(self) -> None:
        """Wait for the gap between frames; after a time-out until the late answer has come or cannot come any more."""
        if self._missed_at is not None:
            until = self._missed_at + self._timeout_s * WAIT_OUT_FACTOR
            await self._clock.sleep(self._gap_s)  # takes in what came while this process did not run
            while self._clock.now() < until and self._heard_at <= self._missed_at:
                await self._clock.sleep(self._gap_s)
            self._missed_at = None
        while (wait_s := self._heard_at + self._gap_s - self._clock.now()) > 0:
            await self._clock.sleep(wait_s)

    def _wrong(self, what: str, got: str) -> WrongAnswer:
        self._missed_at = self._clock.now()
        return WrongAnswer(f"Modbus {self.name}, {what}: {got}", "if it stays: " + CHECK_MAP)

    @staticmethod
    def _send_read(client: Client, device_id: int, table: Table, address: int, count: int) -> Awaitable[ModbusPDU]:
        match table:
            case "coil":
                return client.read_coils(address, count=count, device_id=device_id)
            case "discrete":
                return client.read_discrete_inputs(address, count=count, device_id=device_id)
            case "input":
                return client.read_input_registers(address, count=count, device_id=device_id)
            case _:
                return client.read_holding_registers(address, count=count, device_id=device_id)

    @staticmethod
    def _send_write(client: Client, device_id: int, table: Table, address: int, values: list[int]) -> Awaitable[ModbusPDU]:
        if table == "coil" and len(values) == 1:
            return client.write_coil(address, bool(values[0]), device_id=device_id)
        if table == "coil":
            return client.write_coils(address, [bool(value) for value in values], device_id=device_id)
        if len(values) == 1:
            return client.write_register(address, values[0], device_id=device_id)
        return client.write_registers(address, values, device_id=device_id)
