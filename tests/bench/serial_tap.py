"""A wire in the middle: `python -m tests.bench.serial_tap NEAR FAR BAUD` carries bytes at the pace of the baud rate.

It tells when real-time bytes reach the far end."""

from __future__ import annotations

import os
import select
import sys
import time
import tty
from pathlib import Path

WATCHED = frozenset(b"!\x18\x90\x91\x92\x93\x94")
STEP_S = 0.0005
BITS_PER_BYTE = 10


def raw_pair(link: Path) -> int:
    """The master of a new pseudo-terminal whose other end is found at `link`."""
    master, slave = os.openpty()
    tty.setraw(slave)
    link.unlink(missing_ok=True)
    link.symlink_to(os.ttyname(slave))
    os.set_blocking(master, False)
    return master


def carry(near: int, far: int, bytes_per_s: float) -> None:
    """Both ways, for ever; a line of output per watched byte: its number and CLOCK_MONOTONIC in s."""
    credit, last = 0.0, time.monotonic()
    while True:
        time.sleep(STEP_S)
        now = time.monotonic()
        credit = min(credit + (now - last) * bytes_per_s, 4.0 + 0.003 * bytes_per_s)
        last = now
        if credit >= 1.0 and select.select([near], [], [], 0)[0]:
            data = os.read(near, int(credit))
            credit -= len(data)
            for byte in data:
                if byte in WATCHED:
                    print(byte, time.monotonic(), flush=True)
            os.write(far, data)
        if select.select([far], [], [], 0)[0]:
            os.write(near, os.read(far, 4096))


def main(words: list[str]) -> int:
    """Open both ends and carry."""
    near = raw_pair(Path(words[0]))
    far = os.open(words[1], os.O_RDWR | os.O_NOCTTY)
    tty.setraw(far)
    print("ready", flush=True)
    try:
        carry(near, far, float(words[2]) / BITS_PER_BYTE)
    except (KeyboardInterrupt, OSError):
        return 0
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
