"""The C library's allocator, told to give memory back: a process that runs for weeks keeps no more than it uses."""

from __future__ import annotations

import ctypes
from contextlib import suppress

ARENAS = 2  # of all threads; the interpreter's lock lets one allocate at a time anyway, and each arena keeps its own rest
MAPPED_FROM_BYTES = 256 * 1024  # larger pieces are given back to the system at once; a fixed bound, or it rises with the first large piece
_ARENA_MAX = -8  # M_ARENA_MAX and M_MMAP_THRESHOLD of glibc's malloc.h
_MMAP_THRESHOLD = -3


def keep_little() -> None:
    """Set both for this process, before it starts a thread. Nothing happens where the C library has no mallopt (musl)."""
    with suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        library.mallopt(_ARENA_MAX, ARENAS)
        library.mallopt(_MMAP_THRESHOLD, MAPPED_FROM_BYTES)
