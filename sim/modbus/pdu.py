"""Requests to answers, without wires: function codes 1 to 6, 15 and 16, strictly (Modbus Application Protocol 1.1b3, chapter 6)."""

from __future__ import annotations

import struct

from sim.modbus.registers import ILLEGAL_FUNCTION, ILLEGAL_VALUE, ModbusFault, RegisterBank
from sim.modbus.wire import Wire

READ_TABLES = {1: ("coil", 2000), 2: ("discrete", 2000), 3: ("holding", 125), 4: ("input", 125)}
COIL_ON, COIL_OFF = 0xFF00, 0x0000
WRITE_COILS_MAX, WRITE_REGISTERS_MAX = 1968, 123


def answer(request: bytes, bank: RegisterBank, wire: Wire) -> bytes:
    """Answer to a request, both without address and checksum; an exception answer where the device refuses."""
    code = request[0]
    try:
        if wire.exception:
            raise ModbusFault(wire.exception)
        if code in READ_TABLES:
            return _read(request, bank, wire.extra_count)
        if code in (5, 6):
            return _write_one(request, bank)
        if code in (15, 16):
            return _write_many(request, bank)
        raise ModbusFault(ILLEGAL_FUNCTION)
    except ModbusFault as fault:
        return bytes([code | 0x80, fault.code])


def _read(request: bytes, bank: RegisterBank, extra: int) -> bytes:
    if len(request) != 5:
        raise ModbusFault(ILLEGAL_VALUE)
    code, address, count = struct.unpack(">BHH", request)
    table, most = READ_TABLES[code]
    if not 1 <= count <= most:
        raise ModbusFault(ILLEGAL_VALUE)
    values = bank.read(table, address, count)
    values = [*values, *[0] * extra] if extra >= 0 else values[:extra]
    body = _pack_bits(values) if code in (1, 2) else struct.pack(f">{len(values)}H", *values)
    return bytes([code, len(body)]) + body


def _pack_bits(values: list[int]) -> bytes:
    packed = bytearray((len(values) + 7) // 8)
    for k, value in enumerate(values):
        packed[k // 8] |= (value & 1) << (k % 8)
    return bytes(packed)


def _write_one(request: bytes, bank: RegisterBank) -> bytes:
    if len(request) != 5:
        raise ModbusFault(ILLEGAL_VALUE)
    code, address, value = struct.unpack(">BHH", request)
    if code == 5:
        if value not in (COIL_ON, COIL_OFF):
            raise ModbusFault(ILLEGAL_VALUE)
        bank.write("coil", address, [int(value == COIL_ON)])
    else:
        bank.write("holding", address, [value])
    return request


def _write_many(request: bytes, bank: RegisterBank) -> bytes:
    if len(request) < 6:
        raise ModbusFault(ILLEGAL_VALUE)
    code, address, count, size = struct.unpack(">BHHB", request[:6])
    body = request[6:]
    most = WRITE_COILS_MAX if code == 15 else WRITE_REGISTERS_MAX
    needed = (count + 7) // 8 if code == 15 else 2 * count
    if not 1 <= count <= most or size != needed or len(body) != needed:
        raise ModbusFault(ILLEGAL_VALUE)
    if code == 15:
        bank.write("coil", address, [body[k // 8] >> (k % 8) & 1 for k in range(count)])
    else:
        bank.write("holding", address, struct.unpack(f">{count}H", body))
    return request[:5]
