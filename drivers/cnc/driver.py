"""What can be asked of the CNC: who it is, home, unlock, jog, work offset, settings."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from types import MappingProxyType

from drivers.cnc import protocol as grbl
from drivers.cnc.codes import explain_error
from drivers.cnc.events import AlarmRaised, Identity
from drivers.cnc.identity import check_identity, read_identity
from drivers.cnc.line import CncLine
from drivers.cnc.overdue import RESET_S
from drivers.cnc.status import MOVING
from drivers.errors import CommandRefused, DeviceFault, DeviceSilent, FirmwareUnknown, RangeError_, WrongAnswer

ANSWER_S = 3.0  # for a first sign of life; boards that reset when their port is opened take about two
HOLD_REPEAT_S = 0.3  # a few status periods
STANDSTILL_S = 10.0  # for a machine that was found moving to slow down
HOMING_S = 180.0  # longest homing cycle of the travels that these controllers drive
REPORT_S = 0.35  # by then a report shows the state that a command left behind
STANDING = frozenset({"Idle", "Alarm", "Check", "Sleep"})  # states in which a $ command is answered


class CncDriver(CncLine):
    """One CNC: the line with its program (CncLine) and the commands that are awaited.

    Awaited commands raise CommandRefused (nothing was sent), DeviceFault (refused by the controller), DeviceSilent, LinkLost.
    """

    told_settings: Mapping[str, str] = MappingProxyType({})
    """The controller's `$$` as it was last read."""

    async def identify(self) -> Identity:
        """Bring the controller to rest, reset it, learn who it is and how much it holds.

        A machine that is found moving (its former master died) is held first; a half line in its buffer is lost in the reset.
        Raises DeviceSilent, FirmwareUnknown, FirmwareMismatch (firmware or axes differ from the cell file), LinkLost.
        """
        self.identity = None
        self._check_port()
        was_alive = await self._greet()
        if self._is_moving():
            await self._come_to_rest()
        if not await self._reset_and_wait() and not was_alive:
            raise DeviceSilent(
                f"the CNC at {self._port.name} does not answer at {self.facts.baud} baud",
                "check its power, the cable and cnc.baud in the cell file",
            )
        if not self.protocol.banner:
            raise FirmwareUnknown(
                f"CNC at {self._port.name}: no banner after a reset", "these drivers know grbl 1.1 and grblHAL"
            )
        identity = await self._read_identity()
        if identity.firmware == "grblhal":
            self.urge(grbl.FULL_STATUS)
        status = self.status
        if not await self.wait_until(lambda: self.status is not status, ANSWER_S) or self.status is None:
            raise DeviceSilent(f"the CNC at {self._port.name} sends no status", "check the controller")
        letters = check_identity(identity, self.facts, self.letters, self.protocol.reader.axes_reported)
        window = min(identity.rx_bytes, self.status.rx_free or identity.rx_bytes) - self.facts.rx_margin_bytes
        planner = self.status.planner_free if self.status.is_idle and self.status.planner_free else identity.planner_blocks
        self.protocol.window_bytes = window
        self.protocol.rx_idle = self.status.rx_free
        self.identity = dataclasses.replace(identity, letters=letters, window_bytes=window, planner_blocks=planner)
        return self.identity

    async def command(self, text: str, timeout_s: float | None = None) -> list[str]:
        """One line outside a program; its feedback lines (`[...]`, `$n=...`)."""
        await self._check_may_command(text)
        answer = self.enqueue(text)
        self.alarm = None
        limit = self.facts.answer_timeout_s if timeout_s is None else timeout_s
        is_motion = text.startswith(("$H", "$J"))
        answered = await self.wait_until(lambda: answer.done or answer.is_lost or (is_motion and self.alarm is not None), limit)
        if is_motion and self.alarm is not None and not (answer.done and answer.code == 0):
            raise self._alarmed(text, self.alarm)
        if answer.is_lost:
            raise DeviceSilent(f"the CNC was reset before it answered {text!r}", "try again")
        if not answered:
            raise DeviceSilent(f"the CNC did not answer {text!r} within {limit:g} s", "check the controller, then reset it")
        if answer.code:
            await self._clear_latch()
            cause, remedy = explain_error(answer.code)
            raise DeviceFault(f"the CNC refused {text!r}: {cause} (error {answer.code})", remedy, answer.code)
        return answer.lines

    async def home(self) -> None:
        """`$H`; returns when homing has ended. DeviceFault names the alarm when it fails."""
        await self.command("$H", HOMING_S)

    async def unlock(self) -> None:
        """`$X`: leave the alarm state without homing."""
        await self.command("$X")

    async def abort(self) -> None:
        """Hold, wait for standstill, reset: the program is gone and the position kept. Raises DeviceSilent, LinkLost.

        A machine that does not stand within STANDSTILL_S is reset all the same (alarm 3 then says that its position is lost).
        """
        self._halt("aborted")
        self.hold()
        await self._come_to_rest()
        await self.soft_reset()

    async def soft_reset(self) -> None:
        """Reset and wait for the banner. Raises DeviceSilent when none comes."""
        if not await self._reset_and_wait():
            raise DeviceSilent(f"the CNC at {self._port.name} did not confirm the reset", "switch the controller off and on")

    async def jog(self, axis: str, distance: float, feed: float) -> None:
        """Move one axis by `distance` (mm or deg) at `feed` (mm/min or deg/min); returns when the controller has accepted.

        Raises RangeError_ for an unknown axis or a value that is no positive feed or finite distance.
        """
        if axis not in self.letters:
            raise RangeError_(f"CNC: no axis {axis!r}, this machine has {''.join(self.letters)}", "name one of its axes")
        if not math.isfinite(distance) or not math.isfinite(feed) or feed <= 0:
            raise RangeError_(f"CNC: jog by {distance} at feed {feed} asked", "give a finite distance and a feed above 0 mm/min")
        await self.command(f"$J=G91 G21 {axis}{distance:.4f} F{feed:.1f}")

    async def work_offset(self) -> dict[str, float]:
        """G54 per axis letter, mm or deg, machine coordinates (from `$#`). Raises WrongAnswer when it does not come."""
        for line in await self.command("$#"):
            name, _, values = line.strip("[]").partition(":")
            if name == "G54":
                try:
                    numbers = [float(value) for value in values.split(",")]
                except ValueError:  # damaged on the way
                    continue
                if len(numbers) == len(self.letters):
                    return dict(zip(self.letters, numbers, strict=True))
        raise WrongAnswer(f"the CNC told no work offset for axes {''.join(self.letters)} ($#)", "check firmware and axes in the cell file")

    async def settings(self) -> dict[str, str]:
        """The controller's settings (`$$`): number -> value, both as text, e.g. {"32": "1"}."""
        pairs = (line[1:].partition("=") for line in await self.command("$$") if line.startswith("$"))
        settings = {number: value.split(" ")[0] for number, _, value in pairs}
        self.told_settings = settings
        return settings

    async def _check_may_command(self, text: str) -> None:
        self._check_port()
        if self._program is not None and not self.is_halted and not self.is_drained:
            raise CommandRefused(f"{text!r} cannot be sent while a program runs", "hold and abort the job first")
        if self.protocol.is_latched:
            raise CommandRefused(f"{text!r} cannot be sent: the controller holds an error", "reset it first")
        if text.startswith("$") and not await self.wait_until(lambda: self._is_standing(text), REPORT_S):
            state = self.status.state if self.status else "unknown"
            raise CommandRefused(f"{text!r} cannot be sent while the CNC is in state {state}", "wait until it stands, or reset it")

    def _is_standing(self, text: str) -> bool:
        state = self.status.state if self.status else ""
        return state in STANDING or (state == "Jog" and text.startswith("$J="))

    def _alarmed(self, text: str, alarm: AlarmRaised) -> DeviceFault:
        return DeviceFault(f"{text!r} failed: {alarm.cause} (alarm {alarm.code})", alarm.remedy, alarm.code)

    async def _greet(self) -> bool:
        """Ask for status until something sensible comes; whether it did."""
        return await self.wait_until(lambda: self.status is not None or bool(self.protocol.banner), ANSWER_S)

    async def _come_to_rest(self) -> None:
        """Hold a machine that moves and wait until it stands, so that a reset does not cost its position.

        Said again while it moves: a hand at the machine's own cycle start may have let it go on.
        """
        asked_at = self.clock.now()
        while self.clock.now() - asked_at < STANDSTILL_S:
            if self._is_moving():
                self.hold()
            if await self.wait_until(
                lambda: self.status is not None and self.status.at > asked_at and not self._is_moving(), HOLD_REPEAT_S
            ):
                return

    def _is_moving(self) -> bool:
        status = self.status
        return status is not None and (status.state in MOVING or (status.state == "Hold" and not status.is_held))

    async def _reset_and_wait(self) -> bool:
        self.protocol.banner = ""
        self.reset()
        return await self.wait_until(lambda: bool(self.protocol.banner), RESET_S)

    async def _read_identity(self) -> Identity:
        lines = await self._ask("$I")
        if self.protocol.banner.lower().startswith("grblhal") and not any(line.startswith("[AXS:") for line in lines):
            lines += await self._ask("$I+")
        return read_identity(lines, self.protocol.banner, self._port.name)

    async def _ask(self, text: str) -> list[str]:
        answer = self.enqueue(text)
        if not await self.wait_until(lambda: answer.done or answer.is_lost, ANSWER_S) or answer.is_lost:
            raise DeviceSilent(f"the CNC at {self._port.name} did not answer {text}", "check the controller, then connect again")
        if answer.code:
            await self._clear_latch()
            raise FirmwareUnknown(f"CNC at {self._port.name}: refused {text} (error {answer.code})", "these drivers know grbl 1.1 and grblHAL")
        return list(answer.lines)

    async def _clear_latch(self) -> None:
        """An empty line: grblHAL executes nothing after an error until it has had one; grbl answers it with `ok`."""
        answer = self.enqueue("")
        await self.wait_until(lambda: answer.done or answer.is_lost, self.facts.answer_timeout_s)
