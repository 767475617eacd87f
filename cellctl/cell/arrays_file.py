"""One file of a text and several arrays, mapped as a whole: one descriptor however many there are, verified block by block."""

from __future__ import annotations

import mmap
import os
import threading
import zlib
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

ALIGNED_BYTES = 64  # where an array begins: a line of the processor's cache, as in NumPy's own files
BLOCK_BYTES = 1 << 24  # of one checksum
PIECE_BYTES = 1 << 20  # read at once
READERS = 2
MOST_URGENT = -20  # nice value


def append_array(file: BinaryIO, array: NDArray[Any]) -> int:
    """Write an array behind what is there, in NumPy's .npy format; where it begins (bytes). Raises OSError."""
    file.write(bytes(-file.tell() % ALIGNED_BYTES))
    place = file.tell()
    np.lib.format.write_array(file, np.ascontiguousarray(array), allow_pickle=False)
    return place


def block_sums(path: Path) -> list[int]:
    """CRC-32 of each BLOCK_BYTES of a file, two blocks at a time; the event loop of another thread goes on meanwhile. Raises OSError.

    The readers go before ordinary processes where that is permitted: one that is set aside while it holds the interpreter keeps all waiting.
    """
    handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        starts = range(0, os.fstat(handle).st_size, BLOCK_BYTES)
        if len(starts) == 1:
            return [_block_sum(handle, 0)]
        with ThreadPoolExecutor(READERS, "verify", _go_first) as readers:
            return list(readers.map(lambda start: _block_sum(handle, start), starts))
    finally:
        os.close(handle)


def _go_first() -> None:
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), MOST_URGENT)


def _block_sum(handle: int, start: int) -> int:
    total = 0
    with mmap.mmap(-1, PIECE_BYTES) as buffer, memoryview(buffer) as view:  # given back to the system at once
        for place in range(start, start + BLOCK_BYTES, PIECE_BYTES):
            count = os.preadv(handle, [buffer], place)
            with view[:count] as piece:
                total = zlib.crc32(piece, total)
            if count < PIECE_BYTES:
                break
    return total


class MappedFile:
    """A file that is mapped, read only. It is given back, with its descriptor, when the last array of it goes. Raises OSError, ValueError."""

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            self.bytes = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)

    def array(self, place: int) -> NDArray[Any]:
        """The array that begins there; nothing of it is read before it is looked at. Raises ValueError."""
        self.bytes.seek(place)
        version = np.lib.format.read_magic(self.bytes)
        if version != (1, 0):
            raise ValueError(f"an array of format {version}")
        shape, is_fortran, kind = np.lib.format.read_array_header_1_0(self.bytes)
        if is_fortran and len(shape) > 1:
            raise ValueError("an array by columns")
        return np.ndarray(shape, kind, buffer=self.bytes, offset=self.bytes.tell())
