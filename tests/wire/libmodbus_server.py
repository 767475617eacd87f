"""A Modbus server that is libmodbus (C, Debian's libmodbus5), run as a process: `python libmodbus_server.py tcp PORT | rtu PATH`.

Holding register 0 shows in input register 4 and 1 in 3, as the generic laser's set-point and heartbeat do.
"""

from __future__ import annotations

import ctypes
import sys

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
    library.modbus_reply.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int, ctypes.POINTER(Mapping)]
    return library


def serve(kind: str, where: str) -> None:
    """Answer until the client goes (TCP) or the process is ended (RTU)."""
    library = load()
    mapping = library.modbus_mapping_new(8, 8, 16, 16)
    mapping.contents.tab_input_registers[0] = 7500
    if kind == "tcp":
        context = library.modbus_new_tcp(b"127.0.0.1", int(where))
        listening = ctypes.c_int(library.modbus_tcp_listen(context, 1))
        print("ready", flush=True)
        library.modbus_tcp_accept(context, ctypes.byref(listening))
    else:
        context = library.modbus_new_rtu(where.encode(), 115200, b"N", 8, 1)
        library.modbus_set_slave(context, 1)
        library.modbus_connect(context)
        print("ready", flush=True)
    query = ctypes.create_string_buffer(FRAME_BYTES_MAX)
    while True:
        size = library.modbus_receive(context, query)
        if size > 0:
            library.modbus_reply(context, query, size, mapping)
            mapping.contents.tab_input_registers[4] = mapping.contents.tab_registers[0]
            mapping.contents.tab_input_registers[3] = mapping.contents.tab_registers[1]
        elif size < 0 and kind == "tcp":
            return


if __name__ == "__main__":
    serve(sys.argv[1], sys.argv[2])
