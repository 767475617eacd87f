"""A Modbus server that is libmodbus (C, Debian's libmodbus5), run as a process: `python libmodbus_server.py tcp PORT | rtu PATH [ID]`.

Holding register 0 shows in input register 4 and 1 in 3, as the generic laser's set-point and heartbeat do; input register 0 tells 7000 + 500 * id.
Lines on its standard input are knobs: `late SECONDS` (the next answer comes so late), `exception CODE` (all answers until `exception 0`).
"""

from __future__ import annotations

import ctypes
import os
import select
import sys
import time

FRAME_BYTES_MAX = 260


class Mapping(ctypes.Structure):
    """modbus_mapping_t of libmodbus 3.1 (modbus.h)."""

    _fields_ = [
        *[(name, ctypes.c_int) for name in ("nb_bits", "start_bits", "nb_input_bits", "start_input_bits")],
        *[(name, ctypes.c_int) for name in ("nb_input_registers", "start_input_registers", "nb_registers", "start_registers")],
        ("tab_bits", ctypes.POINTER(ctypes.c_uint8)),
        ("tab_input_bits", ctypes.POINTER(ctypes.c_uint8)),
        ("tab_input_registers", ctypes.POINTER(ctypes.c_uint16)),
        ("tab_registers", ctypes.POINTER(ctypes.c_uint16)),
    ]


def load() -> ctypes.CDLL:
    """The library, with the types of what is used. Raises OSError where it is not installed."""
    library = ctypes.CDLL("libmodbus.so.5", use_errno=True)
    library.modbus_new_tcp.restype = library.modbus_new_rtu.restype = ctypes.c_void_p
    library.modbus_new_tcp.argtypes = [ctypes.c_char_p, ctypes.c_int]
    library.modbus_new_rtu.argtypes = [ctypes.c_char_p, ctypes.c_int, ctypes.c_char, ctypes.c_int, ctypes.c_int]
    library.modbus_mapping_new.restype = ctypes.POINTER(Mapping)
    for name in ("modbus_connect", "modbus_close", "modbus_free"):
        getattr(library, name).argtypes = [ctypes.c_void_p]
    library.modbus_set_slave.argtypes = [ctypes.c_void_p, ctypes.c_int]
    library.modbus_tcp_listen.argtypes = [ctypes.c_void_p, ctypes.c_int]
    library.modbus_tcp_accept.argtypes = [ctypes.c_void_p, ctypes.POINTER(ctypes.c_int)]
    library.modbus_receive.argtypes = [ctypes.c_void_p, ctypes.c_char_p]
    library.modbus_reply_exception.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_uint]
    library.modbus_reply.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.POINTER(Mapping)]
    return library


class Knobs:
    """What was asked for on standard input."""

    def __init__(self) -> None:
        self.late_s = 0.0
        self.exception = 0

    def look(self) -> None:
        """Take in the lines that have come."""
        while select.select([0], [], [], 0.0)[0]:
            text = os.read(0, 256).decode()
            if not text:
                return
            for name, value in (line.split() for line in text.splitlines()):
                if name == "late":
                    self.late_s = float(value)
                else:
                    self.exception = int(value)


def listen(library: ctypes.CDLL, kind: str, where: str, device_id: int) -> int:
    """An open context; says `ready` when a client may come."""
    if kind == "tcp":
        context = library.modbus_new_tcp(b"127.0.0.1", int(where))
        listening = ctypes.c_int(library.modbus_tcp_listen(context, 1))
        print("ready", flush=True)
        library.modbus_tcp_accept(context, ctypes.byref(listening))
    else:
        context = library.modbus_new_rtu(where.encode(), 115200, b"N", 8, 1)
        library.modbus_set_slave(context, device_id)
        library.modbus_connect(context)
        print("ready", flush=True)
    return int(context)


def serve(kind: str, where: str, device_id: int) -> None:
    """Answer until the client goes (TCP) or the process is ended (RTU)."""
    library = load()
    mapping: ctypes._Pointer[Mapping] = library.modbus_mapping_new(8, 8, 16, 16)
    mapping.contents.tab_input_registers[0] = 7000 + 500 * device_id
    context, knobs, query = listen(library, kind, where, device_id), Knobs(), ctypes.create_string_buffer(FRAME_BYTES_MAX)
    while True:
        size = library.modbus_receive(context, query)
        knobs.look()
        if size > 0:
            answer(library, context, query, size, mapping, knobs)
        elif size < 0 and kind == "tcp":
            return


def answer(
    library: ctypes.CDLL, context: int, query: ctypes.Array[ctypes.c_char], size: int, mapping: ctypes._Pointer[Mapping], knobs: Knobs
) -> None:
    """One answer, as the knobs say."""
    late_s, knobs.late_s = knobs.late_s, 0.0
    time.sleep(late_s)
    if knobs.exception:
        library.modbus_reply_exception(context, query, knobs.exception)
        return
    library.modbus_reply(context, query, size, mapping)
    mapping.contents.tab_input_registers[4] = mapping.contents.tab_registers[0]
    mapping.contents.tab_input_registers[3] = mapping.contents.tab_registers[1]


if __name__ == "__main__":
    serve(sys.argv[1], sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 1)
