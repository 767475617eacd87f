"""Dead-man timers, checked by letting them expire: one harmless output is on, heartbeats stop, and the device has to turn it off by itself.

The laser's output is its emission permit, with enable off and power 0, so two of the three conditions of light are missing; the feeder's is
shield gas; the I/O coupler's is the head's slide, which moves and so needs its own permission.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass

from cellctl.doctor.modbus import Wired
from cellctl.doctor.options import Options
from cellctl.doctor.report import Report
from config.cell import Cell
from drivers.errors import DriverError
from drivers.interfaces import Clock
from drivers.modbus.registers import meanings

SECTION = "Dead-man timers"
OUTPUT = {"laser": ("emission_permit", 1.0), "feeder": ("shield_gas_setpoint", 3.0), "io": ("head_deploy", 1.0)}
"""Per role: the output that is on while heartbeats stop, and its value in the register's unit."""

MUST_BE_OFF = {"laser": ("enable", "emission_permit", "power_setpoint", "emission"), "feeder": ("rate_setpoint", "carrier_gas_setpoint"), "io": ()}
BEAT_SHARE = 0.2  # of the dead-man's time between two heartbeats
KEPT_TIMES = 2.0  # dead-man times for which heartbeats alone have to keep the output on
WAITED_TIMES = 3.0  # dead-man times after which a timer that has not tripped never will
LATE_SHARE = 0.2  # of the dead-man's time, by which a timer may be late
EARLY_SHARE = 0.5  # a timer that trips sooner than this share cannot outlast a lost heartbeat
LOOK_S = 0.005  # between two looks at the output
WRAP = 1 << 16


class Unchecked(Exception):
    """The timer cannot be checked now; the text says why."""


@dataclass
class Beating:
    """Heartbeats of one device by hand."""

    wired: Wired
    clock: Clock
    count: int = 0
    at: float = 0.0

    async def beat(self) -> None:
        """One goes out. Raises DriverError."""
        self.count = (self.count + 1) % WRAP
        self.at = self.clock.now()
        await self.wired.write("heartbeat", float(self.count))


async def examine_dead_men(wired: Mapping[str, Wired], cell: Cell, options: Options, clock: Clock, is_standing: bool, report: Report) -> None:
    """Let each timer expire, where that was asked for and cannot do harm. is_standing : the CNC has said that it does not move"""
    for role, each in wired.items():
        what = f"{role}: {each.device.name}"
        try:
            if not options.let_dead_man_expire:
                raise Unchecked("with --let-dead-man-expire only: it writes heartbeats and one harmless output")
            if not is_standing:
                raise Unchecked("the CNC has not said that it stands")
            await _refuse_unless_harmless(role, wired, cell, options)
            await _let_expire(each, clock, what, report)
        except Unchecked as why:
            report.skip(SECTION, what, str(why))
        except DriverError as error:
            report.fault(SECTION, what, error)


async def _refuse_unless_harmless(role: str, wired: Mapping[str, Wired], cell: Cell, options: Options) -> None:
    """Raises Unchecked unless nothing can come of it."""
    if role == "laser" and cell.mode == "real" and not options.locked_out_by.strip():
        raise Unchecked('on a real cell say how emission is made impossible: --locked-out-by "key switch off", done before by hand')
    if role == "io" and not options.may_move:
        raise Unchecked("its output moves the head's slide: with --may-move only")
    if role == "io":
        answer = None if options.ask is None else await options.ask("The head's slide will go out and come back. Is the way clear? (yes, no)")
        if not (answer or "").startswith("y"):
            raise Unchecked("nobody said that the way of the head's slide is clear")
    each = wired[role]
    for name in MUST_BE_OFF[role]:
        if (value := await each.read(name)) != 0.0:
            raise Unchecked(f"{name} is {value:g}, it has to be off: nothing was written")
    if role == "laser" and (power := await each.read("power_readback")) > cell.limits.emission_off_w:
        raise Unchecked(f"power_readback is {power:g} W, it has to be 0: nothing was written")
    output = OUTPUT[role][0]
    if await each.read(output) != each.device.registers[output].safe:
        raise Unchecked(f"{output} is not at its safe value: nothing was written")
    for name in ("fault_word", "interlock_word"):
        register = each.register(name)
        if register is not None and (flags := meanings(name, register, await each.read(name))):
            raise Unchecked(f"{', '.join(flags)}: clear that first")


async def _let_expire(wired: Wired, clock: Clock, what: str, report: Report) -> None:
    output, value = OUTPUT[wired.role]
    safe = wired.device.registers[output].safe or 0.0
    beating = Beating(wired, clock)
    try:
        beating.count = round(await wired.read("heartbeat"))
        await beating.beat()
        await wired.write(output, min(value, wired.device.registers[output].max or value))
        if not await _is_kept(beating, output, safe):
            report.add(
                SECTION, what, "FAULT", f"{output} goes off while heartbeats come", f"on for {KEPT_TIMES:g} × dead_man_s",
                "does the device watch another register, or has its timer a shorter time? compare with its document",
            )  # fmt: skip
            return
        await _time_silence(beating, output, safe, what, report)
    finally:
        await _leave_safe(wired, output, safe)


async def _is_kept(beating: Beating, output: str, safe: float) -> bool:
    """Whether heartbeats keep the output on for KEPT_TIMES dead-man times."""
    dead_man_s, clock = beating.wired.device.dead_man_s, beating.clock
    until = clock.now() + KEPT_TIMES * dead_man_s
    while clock.now() < until:
        await beating.beat()
        if await beating.wired.read(output) == safe:
            return False
        await clock.sleep(BEAT_SHARE * dead_man_s)
    await beating.beat()
    return True


async def _time_silence(beating: Beating, output: str, safe: float, what: str, report: Report) -> None:
    """Watch the output from the last heartbeat on."""
    wired, clock = beating.wired, beating.clock
    said_s = wired.device.dead_man_s
    looked_at = clock.now()
    while (now := clock.now()) - beating.at < WAITED_TIMES * said_s + wired.device.timeout_s:
        earlier_s, looked_at = looked_at - beating.at, now
        if await wired.read(output) == safe:
            took_s, slack_s = now - beating.at, (now - beating.at) - earlier_s
            _judge(took_s, slack_s, said_s, what, await _said(wired), report)
            return
        await clock.sleep(LOOK_S)
    report.add(
        SECTION, what, "FAULT", f"{output} still on {1e3 * (clock.now() - beating.at):.0f} ms after the last heartbeat",
        f"off after {1e3 * said_s:.0f} ms",
        "the device's watchdog is off or watches something else: enable it at the device; until then a dead computer turns nothing off",
    )  # fmt: skip


def _judge(took_s: float, slack_s: float, said_s: float, what: str, said: str, report: Report) -> None:
    low, high = EARLY_SHARE * said_s, (1.0 + LATE_SHARE) * said_s + slack_s
    why = "longer than the map says: the laser or the powder stays on for as long" if took_s > high else "so short that a lost heartbeat trips it"
    report.judge(
        SECTION, what, low <= took_s <= high, f"off {1e3 * took_s:.0f} ms after the last heartbeat{said}",
        f"{1e3 * said_s:.0f} ms (dead_man_s), from {1e3 * low:.0f} to {1e3 * high:.0f}", f"{why}: set the device's timer, or dead_man_s in the map",
    )  # fmt: skip


async def _said(wired: Wired) -> str:
    """The device's own words for it."""
    register = wired.register("fault_word")
    if register is None:
        return ""
    return "; it says: " + (", ".join(meanings("fault_word", register, await wired.read("fault_word"))) or "nothing")


async def _leave_safe(wired: Wired, output: str, safe: float) -> None:
    """The output safe, whatever went wrong, and the fault that was provoked reset."""
    with contextlib.suppress(DriverError):  # a device that is lost now has been told as a fault
        await wired.write(output, safe)
        if wired.register("fault_word") is not None and await wired.read("fault_word"):
            await wired.write("fault_reset", 1.0)
            await wired.write("fault_reset", 0.0)
