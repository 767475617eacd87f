"""The same streams in a time of their own: driver and far end joined in memory by a line at the true baud rate, millions of lines in minutes."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence

from drivers.cnc.driver import CncDriver
from tests.bench.cnc_far_end import Counts, FarEnd
from tests.bench.streaming import LETTERS, Case, FiveAxisLines, Outcome, five_axis_line

TICK_S = 0.01  # the cell's tick, which looks at the line too
LATE_S = (0.00005, 0.0001, 0.00007, 0.0004)  # how late timers are, in turn
LINES_ALLOWED = 1000
STALL_S = 60.0  # without an answer: the stream stands


class Turned:
    """A clock that is turned by hand; who sleeps turns it."""

    def __init__(self, far: FarEnd) -> None:
        self.time = 100.0
        self._far = far

    def now(self) -> float:
        """Seconds."""
        return self.time

    async def sleep(self, seconds: float) -> None:
        """Let the far end live on for so long."""
        self.to(self.time + seconds)
        await asyncio.sleep(0)

    def to(self, at: float, is_woken: bool = False) -> None:
        """Turn to `at`; the far end lives through everything before it. is_woken : no further than to the next answer."""
        while self.time < at:
            then = min(at, max(self._far.next_at(self.time), self.time + 1e-6))
            if is_woken and self._far.answer_at() <= then:
                self.time = max(self.time, self._far.answer_at())
                return
            self.time = then
            self._far.step(then)


class MemoryLine:
    """A port whose other side is the far end; nothing of it can be overtaken or asked, as with a pty."""

    name = "memory"

    def __init__(self, far: FarEnd, clock: Turned) -> None:
        self._far, self._clock = far, clock

    def read(self) -> bytes:
        """What has reached the host."""
        return self._far.transmit(self._clock.time)

    def write(self, data: bytes) -> int:
        """Onto the line."""
        if data:
            self._far.arrive(data, self._clock.time)
        return len(data)

    def queued(self) -> int:
        """Never told."""
        return 0

    def discard_output(self) -> None:
        """Nothing can be discarded."""

    def close(self) -> None:
        """Nothing to give back."""

    def fileno(self) -> int | None:
        """None."""
        return None


def in_memory(
    case: Case, lines: Sequence[str] | None = None, far: FarEnd | None = None, upto: int | None = None, hold_every_s: float = 0.1
) -> Outcome:
    """One stream; holds are asked for at odd instants all along. Raises RuntimeError if the stream stops or stands still.

    lines, far : in place of those of the case; upto : only so many lines are released
    """
    far = far or case.far_end()
    clock = Turned(far)
    facts = case.facts()
    driver = CncDriver(MemoryLine(far, clock), facts, LETTERS, clock)
    asyncio.run(_identify(driver))
    far.counts = Counts()
    lines = FiveAxisLines(case.lines) if lines is None else lines
    driver.load(lines)
    upto = len(lines) if upto is None else upto
    driver.release(upto)
    began, cpu = clock.time, time.process_time()
    asked: list[float] = []
    wakes, answered_at = 0, began
    while driver.counts.sent < upto or driver.protocol.unanswered:
        before = driver.protocol.acknowledged
        driver.pump()
        if driver.protocol.acknowledged != before:
            answered_at = clock.time
        if driver.is_halted or clock.time - answered_at > STALL_S:
            raise RuntimeError(f"the stream stopped: {driver.is_halted or 'no answers'}")
        if clock.time - began > hold_every_s * (len(asked) + 1.0):
            clock.to(clock.time + 0.0001 * (len(asked) % 15))
            asked.append(clock.time)
            driver.hold()
        wakes += 1
        due = driver.due_at() + LATE_S[wakes % len(LATE_S)]
        clock.to(max(clock.time + 1e-6, min(due, clock.time + TICK_S)), is_woken=True)
    seconds = clock.time - began
    clock.to(clock.time + 0.1)
    return Outcome(far.counts, seconds, time.process_time() - cpu, asked)


async def _identify(driver: CncDriver) -> None:
    await driver.identify()



def allowed(case: Case) -> float:
    """Share of the wire that the buffer allows: of a sender that knows every answer at once, never asks and keeps nothing of its own waiting."""
    far = case.far_end()
    clock = Turned(far)
    window = case.rx - 1 - case.facts().rx_margin_bytes
    sizes, written, answered = [len(five_axis_line(k)) + 1 for k in range(LINES_ALLOWED)], 0, 0
    text = b"".join(five_axis_line(k) + b"\n" for k in range(LINES_ALLOWED))
    done = 0
    while done < LINES_ALLOWED:
        room = min(window - (written - answered), len(text) - written)
        if room > 0:
            far.arrive(text[written : written + room], clock.time)
            written += room
        clock.to(max(min(far.answer_at(), far.next_at(clock.time)), clock.time + 1e-5), is_woken=True)
        came = far.transmit(clock.time).count(b"ok")
        answered += sum(sizes[done : done + came])
        done += came
    counts = far.counts
    return min(1.0, counts.bytes * case.byte_s / (counts.last_at - counts.first_at))
