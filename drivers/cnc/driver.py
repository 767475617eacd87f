"""The CNC driver: the protocol joined to a port and a clock; streams a program, sends commands, tells what happens."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from config.cell import Cnc
from drivers.cnc.events import CncEvent, Identity, LineCounts, Status
from drivers.interfaces import BytePort, Clock


class CncDriver:
    """One CNC on one serial line. Synchronous calls never wait; nothing moves unless `pump` is called or a command awaited."""

    def __init__(self, port: BytePort, facts: Cnc, letters: tuple[str, ...], clock: Clock) -> None: ...

    status: Status | None
    identity: Identity | None
    is_drained: bool
    is_halted: str
    counts: LineCounts

    async def identify(self) -> Identity:
        """Stop what may still run, reset, learn who answers. Raises DeviceSilent, FirmwareUnknown, FirmwareMismatch."""
        raise NotImplementedError

    def pump(self) -> list[CncEvent]:
        """Read, parse, check time-outs, write what fits; events since the last call. Never waits, never raises LinkLost (PortLost event)."""
        raise NotImplementedError

    def due_in_s(self) -> float:
        """Seconds until pump has something to write again (pacing); call pump then, or when the descriptor is readable."""
        raise NotImplementedError

    def fileno(self) -> int | None:
        """Descriptor to watch for readability."""
        raise NotImplementedError

    def load(self, lines: Sequence[str] | Iterable[str], first: int = 0, times_s: Sequence[float] | None = None) -> None:
        """A program to stream from line index `first`; nothing goes before `release`. times_s: predicted end of each line. Raises CommandRefused."""

    def release(self, upto: int) -> None:
        """Let lines with index < upto go."""

    def unload(self) -> None:
        """Forget the program (after a reset, or when drained)."""

    def query_status(self) -> None:
        """`?` now."""

    def hold(self) -> None:
        """`!` now."""

    def resume(self) -> None:
        """`~` now."""

    def reset(self) -> None:
        """Soft reset now: output queue dropped, 0x18; lines in flight are forgotten when the banner comes."""

    def jog_cancel(self) -> None:
        """0x85 now."""

    def feed_override(self, percent: int) -> None:
        """Steer the feed override to `percent` (10..200) by real-time bytes."""

    async def command(self, text: str, timeout_s: float | None = None) -> list[str]:
        """Send one line outside a stream; its feedback lines. Raises CommandRefused, DeviceFault, DeviceSilent, LinkLost."""
        raise NotImplementedError

    async def home(self) -> None:
        """`$H`; returns when homing has ended."""

    async def unlock(self) -> None:
        """`$X`."""

    async def jog(self, axis: str, distance: float, feed: float) -> None:
        """Relative jog, mm (deg) and mm/min (deg/min); returns when accepted. Raises RangeError_, CommandRefused."""

    async def work_offset(self) -> dict[str, float]:
        """G54 per axis letter from `$#`."""
        raise NotImplementedError

    async def settings(self) -> dict[str, str]:
        """`$$` as number -> value, e.g. {"32": "1"}."""
        raise NotImplementedError

    def close(self) -> None:
        """Give the port back."""
