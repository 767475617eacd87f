"""Commands of a hand at the machine: home, jog, unlock, confirm the position; motion begins when the laser is read back locked out."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import TYPE_CHECKING, Any

import structlog

from cellctl.cell.gate import SHUT_S
from cellctl.cell.jog import Jog, asked_jog, is_retract, way_to
from cellctl.cell.preconditions import check_devices
from cellctl.cell.refusal import Refused
from cellctl.cell.transaction import StepFailedError, Transaction
from cellctl.domain.messages import Command
from cellctl.domain.states import State, Trigger, after
from drivers.cell_wires import CellDrivers
from drivers.cnc.events import Status
from drivers.errors import CommandRefused, DeviceFault, DeviceSilent, DriverError, LinkError

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller

S, T = State, Trigger
UNLOCKED_S = 1.0  # a few status periods
BY_HAND = (S.HOMING, S.JOGGING)
log = structlog.get_logger()


class ByHand:
    """One piece of work at a time, in a task of its own; what it commands is verified before and after."""

    def __init__(self, controller: Controller) -> None:
        self._c = controller
        self._task: asyncio.Task[None] | None = None
        self.jog: Jog | None = None

    # -- commands ------------------------------------------------------------------------------------------------------

    def home(self, command: Command, drivers: CellDrivers) -> None:
        """Home all axes. Raises Refused, WrongStateError."""
        c = self._c
        after(c.state, T.HOME)
        check_devices(drivers, for_job=False)
        self._lock_out(drivers, "homing")
        c.go(T.HOME, command.because or "homing")
        self._spawn(self._home(drivers))

    async def unlock(self, command: Command, drivers: CellDrivers) -> None:
        """Leave the CNC's alarm without homing; the position is suspect from then on."""
        c = self._c
        check_devices(drivers, for_job=False)
        asked_at = c.times.wire.now()
        await drivers.cnc.unlock()
        await drivers.cnc.wait_until(lambda: self._is_unlocked(drivers, asked_at), UNLOCKED_S)
        if not self._is_unlocked(drivers, asked_at):
            raise Refused("unlock: the CNC is still locked", "remove what locks it, reset, then home or unlock it")
        after(c.state, T.UNLOCK)
        c.position.suspect("the machine was unlocked without homing")
        c.go(T.UNLOCK, command.because or "unlocked without homing")

    @staticmethod
    def _is_unlocked(drivers: CellDrivers, since: float) -> bool:
        status = drivers.cnc.status
        return status is not None and status.at > since and status.state != "Alarm"

    def confirm_position(self, command: Command) -> None:
        """A person vouches for the position that the CNC tells. Raises Refused without a reason or outside of rest."""
        c = self._c
        if c.state is not S.IDLE:
            raise Refused(f"confirm_position is not possible while the cell is {c.state.value}", "the position is confirmed when the cell is IDLE")
        if not command.because.strip():
            raise Refused("confirm_position: a reason is needed", "say how the position was checked")
        c.position.trust(f"{command.who} confirms it, because {command.because}")

    def start_jog(self, command: Command, drivers: CellDrivers) -> Jog:
        """Jog one axis. Raises Refused, WrongStateError."""
        c = self._c
        status = drivers.cnc.status
        suspect_feed = c.cell.by_hand.suspect_feed_mm_min if c.position.why else None
        jog = asked_jog(c.cell, command.args, status.machine if status else {}, c.times.wire.now(), suspect_feed)
        after(c.state, T.JOG)
        check_devices(drivers, for_job=False)
        self._lock_out(drivers, "jogging")
        c.jog_sent_at = None
        self.jog = jog
        c.go(T.JOG, command.because or jog.text)
        self._spawn(self._jog(drivers, jog))
        return jog

    def keep(self) -> bool:
        """The button of a continuous jog is still held; whether there is one."""
        if self.jog is None or self._c.state is not S.JOGGING or self.jog.ended:
            return False
        self.jog.keep(self._c.times.wire.now())
        return True

    def end_jog(self, because: str) -> None:
        """No more motion by hand, now. Harmless without a jog."""
        c = self._c
        if self.jog is None or c.state is not S.JOGGING:
            return
        self.jog.end(because)
        if c.drivers is not None and c.is_cnc_alive:
            c.drivers.cnc.jog_cancel()

    def end_purge(self, because: str) -> None:
        """No more powder and gas by hand, now. Harmless without."""
        self._c.flow_by_hand.end(because)

    def go_to(self, command: Command, drivers: CellDrivers) -> str:
        """Send the machine to one of the cell file's places, axis by axis, rising first. Raises Refused, WrongStateError."""
        c = self._c
        name, status = str(command.args.get("place", "")), drivers.cnc.status
        c.position.check()
        legs = way_to(c.cell, name, status.machine if status else {}, command.args.get("feed"), c.times.wire.now())
        after(c.state, T.JOG)
        check_devices(drivers, for_job=False)
        if not legs:
            return name
        self._lock_out(drivers, f"going to {name}")
        c.jog_sent_at = None
        self.jog = legs[0]
        c.go(T.JOG, command.because or f"going to {name}")
        self._spawn(self._go_legs(drivers, legs, name))
        return name

    # -- work ----------------------------------------------------------------------------------------------------------

    async def _home(self, drivers: CellDrivers) -> None:
        if await self._is_safe(drivers, "homing", parks=True):
            await self._shut_gate(drivers)
            if self._c.state is not S.HOMING:
                return
            self._c.homing_watch.asked(self._c.times.wire.now())
            await drivers.cnc.home()
            homed_at = self._c.times.wire.now()  # reports that were formed before may still tell the lock that homing has opened
            await drivers.cnc.wait_until(lambda: self._is_unlocked(drivers, homed_at), UNLOCKED_S)
            if self._c.state is S.HOMING:
                self._c.position.trust("homed")
                self._c.go(T.HOMED, "homed")

    async def _shut_gate(self, drivers: CellDrivers) -> None:
        """A locked control takes no M65: it is unlocked for that alone, and homes next. One that may not be unlocked homes as it stands.

        Nothing hangs on it but the second lock: the laser's permit is off and was read back before.
        """
        c = self._c
        if c.gate.is_shut or self._status is None or self._status.state != "Alarm":
            return
        c.position.suspect("the machine was unlocked to shut the laser's gate, and homing has not ended")
        try:
            await drivers.cnc.unlock()
        except DeviceFault as error:
            c.event("gate", f"the laser's gate is shut after homing only: {error.message}", {"why": error.message})
            return
        await drivers.cnc.wait_until(lambda: c.gate.is_shut or c.state is not S.HOMING, SHUT_S)

    async def _jog(self, drivers: CellDrivers, jog: Jog) -> None:
        c = self._c
        is_safe = await self._is_safe(drivers, "jogging", parks=not is_retract(c.cell, jog))
        while is_safe and c.state is S.JOGGING and not jog.ended and not jog.is_asked:
            now = c.times.wire.now()
            jog.watch(now, c.cell.by_hand.jog_repeat_s)
            status = drivers.cnc.status
            reported = status.machine.get(jog.axis, 0.0) if status else 0.0
            distance = 0.0 if jog.ended else jog.piece(now, reported) if jog.is_continuous else jog.whole()
            if distance:
                await drivers.cnc.jog(jog.axis, distance, jog.feed)
            else:
                await c.times.wire.sleep(c.cell.limits.tick_s)
        while jog.is_continuous and c.state is S.JOGGING and not jog.ended and self._moves(drivers):  # the end of travel lies ahead
            jog.watch(c.times.wire.now(), c.cell.by_hand.jog_repeat_s)
            await c.times.wire.sleep(c.cell.limits.tick_s)
        if c.state is not S.JOGGING:
            return
        if jog.ended:
            c.because = f"the jog has ended: {jog.ended}"
            drivers.cnc.jog_cancel()
        c.jog_sent_at = c.times.wire.now()

    async def _go_legs(self, drivers: CellDrivers, legs: list[Jog], name: str) -> None:
        c = self._c
        if not await self._is_safe(drivers, f"going to {name}", parks=True):
            return
        for leg in legs:
            leg.ended, self.jog = self.jog.ended if self.jog is not None else "", leg
            if c.state is not S.JOGGING or leg.ended:
                break
            await drivers.cnc.jog(leg.axis, leg.whole(), leg.feed)
            while c.state is S.JOGGING and not leg.ended and not self._has_come(drivers, leg):
                await c.times.wire.sleep(c.cell.limits.tick_s)
        if c.state is S.JOGGING:
            if self.jog is not None and self.jog.ended:
                drivers.cnc.jog_cancel()
            c.jog_sent_at = c.times.wire.now()

    def _has_come(self, drivers: CellDrivers, leg: Jog) -> bool:
        status = drivers.cnc.status
        return status is not None and status.is_idle and abs(status.machine.get(leg.axis, 1e9) - leg.target) < 0.01

    def _moves(self, drivers: CellDrivers) -> bool:
        status = drivers.cnc.status
        return status is not None and status.state == "Jog"

    async def _is_safe(self, drivers: CellDrivers, purpose: str, *, parks: bool) -> bool:
        """Carry the guarded steps before motion out; whether motion may begin. Raises StepFailedError."""
        c, state = self._c, self._c.state
        transaction = c.transaction = Transaction([*c.modes.by_hand(purpose, parks=parks), c.gate.step()])
        while not transaction.advance(c.times.wire.now()):
            await c.times.wire.sleep(c.cell.limits.tick_s)
            if c.state is not state or (state is S.JOGGING and self.jog is not None and self.jog.ended):
                break
        if c.state is not state:
            return False
        c.transaction = None
        check_devices(drivers, for_job=False)
        return transaction.is_done

    def _lock_out(self, drivers: CellDrivers, why: str) -> None:
        self._c.hand.lock(why)
        drivers.laser.safe()

    # -- the task ------------------------------------------------------------------------------------------------------

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        self._task = asyncio.get_running_loop().create_task(self._guarded(work))

    async def _guarded(self, work: Coroutine[Any, Any, None]) -> None:
        """Work of the CNC that takes its time; what goes wrong changes the state."""
        c = self._c
        try:
            await work
        except StepFailedError as error:
            if c.state in BY_HAND:
                c.fault(error.code, error.detail, error.remedy)
        except Refused as error:
            if c.state in BY_HAND:
                c.fault("step_failed", error.message, error.hint)
        except DriverError as error:
            c.pump()  # what the line tells by itself is the cause: it is lost, an alarm, a restart
            if c.state is S.JOGGING and self._stands():
                c.event("jog", f"the CNC refused the jog: {error.message}")
                c.go(T.JOGGED, f"the CNC refused the jog: {error.message}")
            elif c.state in BY_HAND and isinstance(error, (CommandRefused, DeviceSilent)) and self._is_held():
                c.fault("step_failed", "feed hold at the machine", "reset, then try again")
            elif c.state in BY_HAND:
                c.fault(_code_of(error), error.message, error.hint)
        except Exception as error:
            log.exception("work of the CNC failed", state=c.state.value)
            c.fault("internal", f"{c.state.value}: {type(error).__name__}: {error}")

    @property
    def _status(self) -> Status | None:
        return self._c.drivers.cnc.status if self._c.drivers is not None and self._c.is_cnc_alive else None

    def _stands(self) -> bool:
        return self._status is not None and self._status.is_idle

    def _is_held(self) -> bool:
        return self._status is not None and self._status.state == "Hold"

    def stop(self) -> None:
        """Drop the work under way; the CNC is the caller's to stop."""
        if self.jog is not None:
            self.jog.end("stopped")
        if self._task is not None:
            self._task.cancel()

    async def close(self) -> None:
        """End work under way."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
            self._task = None


def _code_of(error: DriverError) -> str:
    """Cause of work that the CNC did not carry out: it fell silent, its line is lost, or it refuses."""
    if isinstance(error, DeviceSilent):
        return "cnc_silent"
    return "cnc_lost" if isinstance(error, LinkError) else "step_failed"
