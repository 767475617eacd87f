"""What each state does at every tick: one function per state, one table."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from cellctl.cell.cnc_checks import SPINDLE_TIMEOUT_S
from cellctl.cell.modes import SAFE
from cellctl.cell.reacting import shut_powder_in_time, to_nozzle
from cellctl.cell.tool_by_hand import told_pause
from cellctl.cell.transaction import Step, Transaction
from cellctl.cell.way_back import advance_way_back
from cellctl.domain.states import State, Trigger
from drivers.cell_wires import CellDrivers

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller

S, T = State, Trigger
MOTION_TIMEOUT_S = 5.0  # from `~` to the first report of motion
CNC_SILENT_S = 2.0  # at rest: after so long without a status report the CNC counts as missing
DEVICE_SILENT_S = 1.0  # at rest, the same for a device: a few requests missed in a row; what needs a fresh level asks for its stale limit


def _connected(cell: Controller, drivers: CellDrivers, now: float) -> None:
    """At rest: the wires have to stay there, and the machine unlocked."""
    missing = what_is_missing(cell, drivers)
    status = drivers.cnc.status
    if missing:
        cell.offline_line = missing
        cell.go(T.CONNECTION_LOST, missing)
    elif cell.state is S.IDLE and status is not None and status.state == "Alarm":
        cell.go(T.LOCKED, "the CNC has locked itself")


def what_is_missing(cell: Controller, drivers: CellDrivers) -> str:
    """One line about every wire or device that does not answer; empty when all are there. A request or two that were missed are no loss."""
    missing = []
    if not cell.is_cnc_alive:
        missing.append(cell.cnc_line or "the CNC does not answer")
    elif cell.senses.cnc_age_s > CNC_SILENT_S:
        missing.append("the CNC sends no status")
    for name, device, register in (
        ("laser", drivers.laser, "fault_word"),
        ("feeder", drivers.feeder, "fault_word"),
        ("I/O coupler", drivers.io, "door_closed"),
    ):
        if device.client.age(register) > DEVICE_SILENT_S:
            error = device.client.last_error
            missing.append(f"{name}: {error.message}" if error is not None else f"the {name} does not answer")
    return "; ".join(missing)


def _offline(cell: Controller, drivers: CellDrivers, now: float) -> None:
    missing = what_is_missing(cell, drivers)
    status = drivers.cnc.status
    if missing:
        cell.offline_line = missing
    elif status is not None:
        cell.offline_line = ""
        is_locked = status.state == "Alarm"
        cell.go(T.CONNECTED_LOCKED if is_locked else T.CONNECTED, "all devices answer")


def _homing(cell: Controller, drivers: CellDrivers, now: float) -> None:
    for code, detail, remedy in cell.homing_watch.faults(drivers.cnc.status, now):
        cell.fault(code, detail, remedy)


def _jogging(cell: Controller, drivers: CellDrivers, now: float) -> None:
    status = drivers.cnc.status
    if cell.jog_sent_at is not None and status is not None and status.is_idle and status.at > cell.jog_sent_at:
        cell.go(T.JOGGED, "the jog has ended")


def _purging(cell: Controller, drivers: CellDrivers, now: float) -> None:
    cell.flow_by_hand.advance(now)


def _preparing(cell: Controller, drivers: CellDrivers, now: float) -> None:
    run = cell.run
    assert run is not None
    if run.transaction is None:
        to_nozzle(cell)
        run.begin_barrier()
    assert run.transaction is not None
    if run.transaction.advance(now):
        run.pass_barrier(now)
        cell.go(T.PREPARED, "everything for the next lines is set and verified")


def _running(cell: Controller, drivers: CellDrivers, now: float) -> None:
    run = cell.run
    assert run is not None
    run.follow(now)
    status = drivers.cnc.status
    if status is not None and status.state == "Hold":
        cell.quiesce.begin(now, reset=False)
        cell.go(T.HELD_AT_MACHINE, told_pause(cell, run, drivers))
    elif run.is_finished:
        cell.hand.lock("the job is done")
        cell.end_run("completed")
        drivers.cnc.unload()
        drivers.laser.safe()
        drivers.feeder.safe()
        cell.go(T.COMPLETED, "every line is executed")
    elif run.is_at_barrier:
        run.begin_barrier()
        cell.go(T.BARRIER_REACHED, f"line {run.executed + 1} waits until the cell is prepared")


def _holding(cell: Controller, drivers: CellDrivers, now: float) -> None:
    cell.quiesce.advance(now)
    if cell.run is not None:
        cell.run.judge.standstill("the job is held")
    if cell.quiesce.is_still:
        drivers.feeder.set_rate(0.0)
        cell.go(T.STOOD_STILL, cell.because)


def _held(cell: Controller, drivers: CellDrivers, now: float) -> None:
    """The machine stands; one that was let go at its own panel is held again."""
    shut_powder_in_time(cell, now)
    cell.spindle.advance(now)
    status = drivers.cnc.status
    if status is not None and status.state == "Run":
        cell.quiesce.advance(now)


def _resuming(cell: Controller, drivers: CellDrivers, now: float) -> None:
    run = cell.run
    assert run is not None
    if run.stands_before_barrier:
        run.begin_barrier(again=True)
        cell.go(T.BARRIER_REACHED, "the cell is prepared again")
        return
    if cell.transaction is None:
        to_nozzle(cell)
        cell.transaction = Transaction([*cell.spindle.settled(), *run.restore(), _motion_again(cell, drivers, now)])
    if cell.transaction.advance(now):
        cell.go(T.MOVED, "the job goes on")


def _motion_again(cell: Controller, drivers: CellDrivers, now: float) -> Step:
    said_at = [now]
    is_behind_door = drivers.cnc.status is not None and drivers.cnc.status.state == "Door"
    timeout_s = MOTION_TIMEOUT_S + (SPINDLE_TIMEOUT_S if is_behind_door else 0.0)  # the firmware restores a spindle before it moves

    def resume() -> None:
        drivers.cnc.resume()
        if cell.run is not None:
            cell.run.follower.command_resume(cell.times.wire.now())
        drivers.cnc.query_status()

    def goes_on() -> bool:
        status = drivers.cnc.status
        is_ready = status is not None and status.is_idle and drivers.cnc.is_drained
        return status is not None and status.at > said_at[0] and (status.state == "Run" or is_ready)

    return Step("waiting for motion", goes_on, timeout_s, act=resume, remedy="look at the CNC, then reset")


def _aborting(cell: Controller, drivers: CellDrivers, now: float) -> None:
    cell.quiesce.advance(now)
    if not cell.quiesce.is_clear:
        return
    if cell.transaction is None:
        cell.end_run("aborted")
        drivers.cnc.unload()
        cell.transaction = Transaction([*cell.modes.steps(SAFE, None, {}), cell.gate.step()])
    if cell.transaction.advance(now):
        cell.go(T.ABORTED, cell.because)


def _latched(cell: Controller, drivers: CellDrivers, now: float) -> None:
    quiesce = cell.quiesce
    if cell.is_cnc_alive:
        quiesce.advance(now)
    shut_powder_in_time(cell, now)
    cell.spindle.advance(now)
    if quiesce.outcome and (quiesce.is_reset or not cell.is_cnc_alive):
        cell.end_run(quiesce.outcome)
    if quiesce.is_clear and cell.run is None:
        drivers.cnc.unload()
    cell.retract.advance(now)
    advance_way_back(cell, now)


def _resetting(cell: Controller, drivers: CellDrivers, now: float) -> None:
    if cell.transaction is None or not cell.transaction.advance(now):
        return
    cell.alarms.clear()
    cell.told.clear()
    status = drivers.cnc.status
    if not cell.is_cnc_alive or status is None:
        cell.go(T.RESET_OFFLINE, "reset; the CNC is not there")
    elif cell.run is not None:
        cell.go(T.RESET_HELD, "reset; the job is held")
    elif status.state == "Alarm":
        cell.go(T.RESET_LOCKED, "reset; the machine has to be homed or unlocked")
    else:
        cell.go(T.RESET_DONE, "reset")


STEPS: dict[State, Callable[[Controller, CellDrivers, float], None]] = {
    S.OFFLINE: _offline,
    S.UNHOMED: _connected,
    S.IDLE: _connected,
    S.HOMING: _homing,
    S.JOGGING: _jogging,
    S.PURGING: _purging,
    S.PREPARING: _preparing,
    S.RUNNING: _running,
    S.HOLDING: _holding,
    S.HELD: _held,
    S.RESUMING: _resuming,
    S.ABORTING: _aborting,
    S.FAULT: _latched,
    S.STOPPED: _latched,
    S.RESETTING: _resetting,
}
