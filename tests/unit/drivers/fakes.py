"""A clock that is turned by hand, a port without a wire and a small firmware of its own: far ends for unit tests."""

from __future__ import annotations

import asyncio
import re
from collections import deque

from config.cell import Cnc
from drivers.cnc.driver import CncDriver

LETTERS = ("X", "Y", "Z", "A", "C")


class ManualClock:
    """Time that passes only when someone sleeps or `advance` is called; then `world` is told."""

    def __init__(self) -> None:
        self.time = 100.0
        self.world: FakeCnc | None = None

    def now(self) -> float:
        return self.time

    async def sleep(self, seconds: float) -> None:
        self.advance(seconds)
        await asyncio.sleep(0)

    def advance(self, seconds: float) -> None:
        self.time += seconds
        if self.world is not None:
            self.world.step(seconds)


class MemoryPort:
    """A port whose far end is a FakeCnc. `takes` limits what the operating system accepts."""

    def __init__(self, cnc: FakeCnc) -> None:
        self.name = "memory"
        self.cnc = cnc
        self.takes = 10**9
        self.written = bytearray()
        self.discarded = 0
        self.read_max = 10**9
        self._in = bytearray()

    def read(self) -> bytes:
        self._in += self.cnc.transmit()
        data = bytes(self._in[: self.read_max])
        del self._in[: len(data)]
        return data

    def write(self, data: bytes) -> int:
        data = data[: self.takes]
        self.written += data
        self.cnc.receive(data)
        return len(data)

    def queued(self) -> int:
        return 0

    def discard_output(self) -> None:
        self.discarded += 1

    def close(self) -> None:
        pass

    def fileno(self) -> int | None:
        return None


class FakeCnc:
    """Enough of a firmware to talk to: RX ring that overflows silently, planner, both ways to treat an error.

    kind : "grblhal" latches an error until an empty line, "grbl" drops the bad line and goes on.
    """

    def __init__(self, kind: str = "grblhal", rx: int = 1024, planner: int = 100, line_s: float = 0.01) -> None:
        self.kind, self.rx, self.planner_size, self.line_s = kind, rx, planner, line_s
        self.ring = bytearray()
        self.planner: deque[tuple[int, float]] = deque()
        self.executed: list[str] = []
        self.texts: dict[int, str] = {}
        self.out = bytearray()
        self.state = "Idle"
        self.latch = 0
        self.overflowed = 0
        self.line = 0
        self.homing_s = 0.0
        self.is_mute = False  # answers nothing at all
        self.eat_ok = 0  # how many `ok` to lose
        self.double_ok = 0
        self.spoil_ok = 0
        self.commands: list[str] = []
        self.realtime: list[int] = []

    def receive(self, data: bytes) -> None:
        for byte in data:
            if byte in b"?!~\x18" or byte >= 0x80:
                self._realtime(byte)
            elif len(self.ring) < self.rx:
                self.ring.append(byte)
            else:
                self.overflowed += 1
        self.step(0.0)

    def transmit(self) -> bytes:
        data, self.out = bytes(self.out), bytearray()
        return b"" if self.is_mute else data

    def say(self, text: str) -> None:
        self.out += text.encode() + b"\r\n"

    def step(self, dt: float) -> None:
        while self.state == "Run" and self.planner and dt >= 0:
            n, left = self.planner[0]
            self.line = n
            if left > dt:
                self.planner[0] = (n, left - dt)
                break
            dt -= left
            self.planner.popleft()
            self.executed.append(self.texts.pop(n))
        if self.state == "Run" and not self.planner:
            self.state, self.line = "Idle", 0
        if self.state == "Home":
            self.homing_s -= dt
            if self.homing_s <= 0:
                self.state = "Idle"
                self.say("ok")
        self._parse()

    def _parse(self) -> None:
        while b"\n" in self.ring and self.state not in ("Hold", "Door", "Tool", "Home"):
            if len(self.planner) >= self.planner_size:
                return
            line, _, rest = bytes(self.ring).partition(b"\n")
            self.ring = bytearray(rest)
            self._line(line.decode())

    def _line(self, line: str) -> None:
        self.commands.append(line)
        if not line:
            self.latch = 0
            self.say("ok")
        elif line.startswith("$"):
            self._dollar(line)
        elif self.latch:
            self.say(f"error:{self.latch}")
        elif "BAD" in line:
            self.latch = 20 if self.kind == "grblhal" else 0
            self.say("error:20")
        else:
            number = re.match(r"N(\d+)", line)
            n = int(number[1]) if number else 0
            self.texts[n] = line
            self.planner.append((n, self.line_s))
            self.state = "Run"
            self._ok()

    def _ok(self) -> None:
        if self.eat_ok:
            self.eat_ok -= 1
        elif self.spoil_ok:
            self.spoil_ok -= 1
            self.say("o*")
        else:
            self.say("ok")
            if self.double_ok:
                self.double_ok -= 1
                self.say("ok")

    def _dollar(self, line: str) -> None:
        if self.state == "Run":
            self.latch = 8
            self.say("error:8")
        elif line == "$I":
            self.say("[VER:1.1f.20260801:]" if self.kind == "grblhal" else "[VER:1.1h.20190825:]")
            self.say(f"[OPT:VN,{self.planner_size},{self.rx},5,0]")
            if self.kind == "grblhal":
                self.say("[AXS:5:XYZAC]")
                self.say("[FIRMWARE:grblHAL]")
            self.say("ok")
        elif line == "$#":
            self.say("[G54:1.000,2.000,-420.000,0.000,5.500]")
            self.say("ok")
        elif line == "$$":
            self.say("$10=511")
            self.say("$32=0")
            self.say("ok")
        elif line == "$H":
            self.state = "Home"
            self.homing_s = 2.0
        elif line.startswith("$J=") or line == "$X":
            self.latch = 0
            self.say("ok")
        else:
            self.say("error:3")

    def _realtime(self, byte: int) -> None:
        self.realtime.append(byte)
        if byte in (0x3F, 0x87):
            self.say(self.report(full=byte == 0x87))
        elif byte == 0x21 and self.state == "Run":
            self.state = "Hold"
        elif byte == 0x7E and self.state == "Hold":
            self.state = "Run" if self.planner else "Idle"
        elif byte == 0x18:
            self.reset()

    def reset(self) -> None:
        self.ring.clear()
        self.planner.clear()
        self.latch = self.line = 0
        self.state = "Idle"
        self.say("")
        self.say("GrblHAL 1.1f ['$' or '$HELP' for help]" if self.kind == "grblhal" else "Grbl 1.1h ['$' for help]")

    def report(self, full: bool = False) -> str:
        state = "Hold:0" if self.state == "Hold" else self.state
        moved = len(self.executed)
        text = f"<{state}|MPos:{moved}.000,0.000,0.000,0.000,5.000|Bf:{self.planner_size - len(self.planner)},{self.rx - 1 - len(self.ring)}"
        text += f"|Ln:{self.line}" if self.line else ""
        text += "|FS:600,0"
        return text + ("|WCO:1.000,0.000,0.000,0.000,5.000|Ov:100,100,100|T:1>" if full else ">")


def cnc_facts(**changes: object) -> Cnc:
    return Cnc.model_validate({"firmware": "grblhal", "port": "cnc", "rx_margin_bytes": 16} | changes)


def far_end(cnc: FakeCnc | None = None, **facts: object) -> tuple[CncDriver, FakeCnc, MemoryPort, ManualClock]:
    """A driver joined to a firmware in memory; time passes for both by the same clock."""
    cnc = cnc or FakeCnc()
    clock = ManualClock()
    clock.world = cnc
    port = MemoryPort(cnc)
    driver = CncDriver(port, cnc_facts(firmware=cnc.kind, **facts), LETTERS, clock)
    return driver, cnc, port, clock


def program(count: int, first: int = 0, bad: int = 0) -> list[str]:
    """Lines N1..; the bad-th carries a word that no firmware knows."""
    return [f"N{k + 1} {'BAD ' if k + 1 == bad else ''}G1 X{k}.123 Y{k}.456 F600" for k in range(first, first + count)]
