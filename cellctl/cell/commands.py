"""Commands: verbs that name the end state, each carried out once per id, durable before the answer, harmless twice."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import msgspec
import structlog

from cellctl.cell.acknowledging import acknowledge
from cellctl.cell.answering import written
from cellctl.cell.answers import Answers
from cellctl.cell.by_hand import ByHand
from cellctl.cell.controller import Controller
from cellctl.cell.gate import SHUT_S
from cellctl.cell.hand_commands import HandCommands
from cellctl.cell.left_in_light import told
from cellctl.cell.overriding import overrides_of
from cellctl.cell.preconditions import check_cnc, check_devices, check_program, still_there
from cellctl.cell.record import END, RUN, StoreError
from cellctl.cell.refusal import READINESS, STORE, Refused
from cellctl.cell.resetting import reset_steps
from cellctl.cell.stream import Run
from cellctl.cell.surroundings import CLEAR, UNTOUCHED
from cellctl.cell.transaction import Transaction
from cellctl.domain.messages import Command, Reply
from cellctl.domain.states import HINTS, LATCHED, State, Trigger, WrongStateError, after, is_reached
from drivers.cell_wires import CellDrivers
from drivers.errors import DriverError
from planner.errors import PlannerError
from planner.program import Program

S, T = State, Trigger
log = structlog.get_logger()
PASSING = frozenset({"present", "jog_keep", "jog_end", "pages"})
"""Signs of life, and where pages are: nothing to be written down, and nothing to be done once only."""
ReadProgram = Callable[[Path], Awaitable[tuple[Program, str]]]


class Commands:
    """Carries commands out on a controller. read_program : directory -> (Program, sha256 of it), off the loop

    on_pages : told the hosts whose pages may read what the STOP listener answers
    """

    def __init__(self, controller: Controller, read_program: ReadProgram) -> None:
        self._c = controller
        self._read_program = read_program
        self._replies = Answers()
        for ident, found in controller.found.replies.items():
            self._replies[ident] = msgspec.convert(found, Reply)
        self._under_way: dict[str, asyncio.Future[Reply]] = {}
        self._hands = ByHand(controller)
        self._starting = ""  # job whose start is under way
        self._stops = 0
        self._verbs: dict[str, Callable[[Command], Awaitable[dict[str, Any]]]] = {
            "start": self._start,
            "hold": self._hold,
            "resume": self._resume,
            "abort": self._abort,
            "stop": self._stop,
            "reset": self._reset,
            "record": self._record,
            "acknowledge": self._acknowledge,
            "take_control": self._take_control,
            "release_control": self._release_control,
            "present": self._present,
            "pages": self._pages,
            **HandCommands(controller, self._hands, self._drivers).verbs,
        }
        controller.control.on_taken = self._hands.end_jog
        self.on_pages: Callable[[frozenset[str]], None] = lambda hosts: None

    async def handle(self, command: Command) -> Reply:
        """Carry out, make durable, answer. A repeated id gets the first answer."""
        if command.verb in PASSING:
            return await self._pass(command)
        known = self._replies.get(command.id)
        if known is not None:
            return known
        under_way = self._under_way.get(command.id)
        if under_way is not None:
            return await asyncio.shield(under_way)
        future: asyncio.Future[Reply] = asyncio.get_running_loop().create_future()
        self._under_way[command.id] = future
        try:
            reply = await self._answer(command)
            self._replies[command.id] = reply
            future.set_result(reply)
        finally:
            del self._under_way[command.id]
            if not future.done():
                future.cancel()
        return reply

    async def _pass(self, command: Command) -> Reply:
        try:
            self._c.control.admit(command)
            return Reply(command.id, True, data=await self._verbs[command.verb](command))
        except (Refused, DriverError) as error:
            return Reply(command.id, False, error.message, error.hint, kind=getattr(error, "kind", ""))

    async def _answer(self, command: Command) -> Reply:
        verb = self._verbs.get(command.verb)
        if verb is None:
            return Reply(command.id, False, f"{command.verb}: no such command", f"one of {', '.join(self._verbs)}")
        if not command.id:
            return Reply("", False, f"{command.verb}: the command has no id", "give every command an id of its own")
        try:
            self._c.control.admit(command)
            reply = Reply(command.id, True, data=await verb(command))
        except WrongStateError as error:
            kind = READINESS if error.trigger is T.START else ""
            reply = Reply(command.id, False, str(error), HINTS.get(error.trigger, ""), kind=kind)
        except Refused as error:
            reply = Reply(command.id, False, error.message, error.hint, kind=error.kind)
        except StoreError as error:
            reply = Reply(command.id, False, error.message, error.hint, kind=STORE)
        except (DriverError, PlannerError) as error:
            reply = Reply(command.id, False, error.message, error.hint)
        except Exception as error:
            log.exception("command failed", verb=command.verb)
            reply = Reply(command.id, False, *self._failed(command.verb, error))
        await self._note(command, reply)
        return await written(self._c.journal, command, reply)

    def _failed(self, verb: str, error: Exception) -> tuple[str, str]:
        """What nobody foresaw: latched, and told in one line with a hint."""
        line = f"{verb}: {type(error).__name__}: {error}"
        self._c.fault("internal", line)
        return line, "note what was done, reset, tell the maintainers"

    async def _note(self, command: Command, reply: Reply) -> None:
        said = f"{command.who}: {command.verb}" + (f", because {command.because}" if command.because else "")
        text = said if reply.ok else f"{said}; refused: {reply.error}"
        data = {"id": command.id, "verb": command.verb, "who": command.who, "client": command.client, "because": command.because}
        self._c.event("command", text, {**data, "reply": msgspec.to_builtins(reply)})

    def _drivers(self) -> CellDrivers:
        if self._c.drivers is None or not self._c.is_cnc_alive:
            raise Refused(f"the cell is offline: {self._c.offline_line}", "connect the device that is named", READINESS)
        return self._c.drivers

    # -- the job -------------------------------------------------------------------------------------------------------

    async def _start(self, command: Command) -> dict[str, Any]:
        c, args = self._c, command.args
        job, name, directory = (str(args.get(key, "")) for key in ("job", "name", "program"))
        if not job or not directory:
            raise Refused("start: job and program are needed", "give the job's id and the program's directory")
        after(c.state, T.START)
        if job in c.found.jobs:
            raise Refused(f"job {job} was started before", "submit it again as a new job")
        if self._starting:
            raise Refused(f"start: job {self._starting} is being started", "one job at a time")
        c.position.check()
        self._check_table(command)
        self._starting = job
        try:
            return await self._start_job(command, job, name, directory)
        finally:
            self._starting = ""

    async def _start_job(self, command: Command, job: str, name: str, directory: str) -> dict[str, Any]:
        c, stops = self._c, self._stops
        program, digest = await self._read_program(Path(directory))
        drivers = self._drivers()
        check_devices(drivers)
        check_cnc(drivers)
        check_program(program, c.cell, drivers, await drivers.cnc.work_offset())
        await drivers.cnc.wait_until(lambda: c.gate.is_shut, SHUT_S)
        c.gate.check()
        overrides = await overrides_of(program, c.cell, drivers)
        if drivers.cnc.status is not None and drivers.cnc.status.overrides[0] != 100:  # of an earlier job: a new one begins as programmed
            drivers.cnc.feed_override(100)
        self._check_table(command)
        self._check_start(stops)
        c.found.jobs.add(job)
        row = (job, name, directory, digest, c.times.unix(), len(program.lines), command.who, command.id)
        c.journal.write(RUN, row)
        try:
            await c.journal.durable()
            self._check_start(stops)
            run = Run(job, name, program, c.cell, drivers, c.modes, c.hand, overrides)
            c.run, c.run_started_at, c.ended = run, c.times.wire.now(), None
            c.go(T.START, f"{name}: {command.because or 'started'}")
        except (WrongStateError, DriverError, Refused, StoreError):
            c.run = None
            if c.journal.withdraw(row):  # the store never had it: the same job may be started again
                c.found.jobs.discard(job)
            else:
                c.journal.write(END, (c.times.unix(), "aborted", 0, job))
            raise
        c.event("job", f"{name}: started by {command.who}", {"outcome": "", "total_lines": run.total})
        if drivers.cnc.identity is not None and (text := await told(program, run.timeline, drivers.laser.client, drivers.cnc.identity)):
            c.event("dead_man", text, job=job)
        return {"job": job, "total_lines": run.total}

    def _check_table(self, command: Command) -> None:
        """Raises Refused when a confirmation of the table, or of the part on it, counts no more."""
        confirmed_at = command.args.get("confirmed_at")
        if isinstance(confirmed_at, (int, float)):
            self._c.table.check(float(confirmed_at), UNTOUCHED if command.args.get("continues") else CLEAR)

    def _check_start(self, stops: int) -> None:
        """Raises unless the cell may still start: what was awaited took time."""
        after(self._c.state, T.START)
        if self._stops != stops:
            raise Refused("start: a stop came before the job began", "start it again as a new job if it is still wanted")

    async def _hold(self, command: Command) -> dict[str, Any]:
        c = self._c
        if not is_reached(c.state, T.HOLD):
            after(c.state, T.HOLD)
            drivers = self._drivers()
            lead = c.lead_s
            c.hand.lock(command.because)
            if c.state in (S.JOGGING, S.PURGING):
                self._hands.end_jog(command.because or "held")
                self._hands.end_purge(command.because or "held")
            elif c.state is S.PREPARING:
                drivers.feeder.set_rate(0.0)
                if c.run is not None:
                    c.run.transaction = None
            else:
                c.quiesce.begin(c.times.wire.now(), reset=False, lead_s=lead)
            c.go(T.HOLD, command.because or "held by the operator")
        return {"state": c.state.value}

    async def _resume(self, command: Command) -> dict[str, Any]:
        c = self._c
        if not is_reached(c.state, T.RESUME):
            after(c.state, T.RESUME)
            check_devices(self._drivers())
            c.go(T.RESUME, command.because or "resumed by the operator")
        return {"state": c.state.value}

    async def _abort(self, command: Command) -> dict[str, Any]:
        c = self._c
        if not is_reached(c.state, T.ABORT) and not (c.state is S.IDLE and c.ended is not None):
            after(c.state, T.ABORT)
            lead = c.lead_s
            c.hand.lock(command.because)
            c.quiesce.begin(c.times.wire.now(), reset=True, lead_s=lead)
            c.go(T.ABORT, command.because or "aborted by the operator")
        return {"state": c.state.value}

    async def _stop(self, command: Command) -> dict[str, Any]:
        self.stop_now(command.because)
        return {"state": self._c.state.value}

    def stop_now(self, because: str) -> None:
        """Everything off at once, in any state."""
        c = self._c
        self._stops += 1
        c.table.disturb("a stop was pressed")
        self._hands.stop()
        if c.drivers is not None:
            c.hand.lock(because)
            c.drivers.laser.safe()
            c.drivers.feeder.safe()
            if c.is_cnc_alive:
                c.quiesce.begin(c.times.wire.now(), reset=True)
            else:  # a CNC that is being identified, or has fallen silent, may well hear
                with contextlib.suppress(DriverError):
                    c.drivers.cnc.hold()
            if c.run is not None:
                c.run.judge.standstill("stopped")
                c.quiesce.outcome = c.quiesce.outcome or "aborted"
        c.go(T.STOP, because or "STOP pressed")

    async def _reset(self, command: Command) -> dict[str, Any]:
        c = self._c
        if c.state not in LATCHED and not self._needs_reset():
            return {"state": c.state.value}
        after(c.state, T.RESET)
        if c.quiesce_pending:
            raise Refused("cannot reset: the machine is still coming to rest", "try again in a second")
        if c.way_back is not None:
            raise Refused(f"cannot reset: {c.way_back.waiting}", "try again in a few seconds")
        for code in [*c.alarms, "estop"]:
            why = still_there(code, c)
            if why:
                raise Refused(
                    f"cannot reset: {why}", c.alarms[code].remedy if code in c.alarms else "release the E-stop"
                )
        c.event(
            "reset",
            f"{command.who} resets: {', '.join(c.alarms) or 'stop'}",
            {"who": command.who, "codes": [*c.alarms], "because": command.because},
        )
        c.go(T.RESET, command.because or "reset by the operator")
        c.transaction = Transaction(reset_steps(c))
        return {"state": c.state.value}

    def _needs_reset(self) -> bool:
        """Whether a device holds a fault, or the CNC a hold, that the cell has not latched."""
        d = self._c.drivers
        if d is None or not self._c.is_cnc_alive or self._c.state not in (S.IDLE, S.UNHOMED):
            return False
        return bool(
            d.laser.faults or d.feeder.faults or (d.cnc.status is not None and d.cnc.status.state in ("Hold", "Door", "Alarm"))
        )

    # -- control -------------------------------------------------------------------------------------------------------

    async def _take_control(self, command: Command) -> dict[str, Any]:
        taken = self._c.control.take(command)
        return {"state": self._c.state.value, "holder": self._c.control.name, "taken_over": taken}

    async def _release_control(self, command: Command) -> dict[str, Any]:
        self._c.control.release(command)
        return {"state": self._c.state.value}

    async def _present(self, command: Command) -> dict[str, Any]:
        return {"state": self._c.state.value}

    async def _pages(self, command: Command) -> dict[str, Any]:
        self.on_pages(frozenset(str(host) for host in command.args.get("hosts", ())))
        return {"state": self._c.state.value}

    async def _record(self, command: Command) -> dict[str, Any]:
        c = self._c
        view = c.job_view() if c.run is not None else c.ended.view if c.ended else None
        return {"job": msgspec.to_builtins(view), "lines": msgspec.to_builtins(c.lines())}

    async def _acknowledge(self, command: Command) -> dict[str, Any]:
        return acknowledge(self._c, command)

    async def close(self) -> None:
        """End work under way."""
        await self._hands.close()
