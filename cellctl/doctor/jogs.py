"""Direction and distance of each axis by one small step to and fro, each after a person has said that the way is clear."""

from __future__ import annotations

from cellctl.doctor.cnc import QuietCnc
from cellctl.doctor.options import Ask, Options
from cellctl.doctor.report import Report
from config.cell import Axis, Cell
from drivers.cnc.events import Status
from drivers.errors import DriverError
from drivers.interfaces import Clock

SECTION = "Axes"
STEP = 1.0  # mm or deg: seen by eye, and too short to reach anything that stands clear
FEED = 60.0  # mm/min or deg/min: a second for the step
TOLERANCE = 0.01  # mm or deg of the control's own position
MOVE_S = 10.0


async def jog_axes(cnc: QuietCnc, cell: Cell, options: Options, clock: Clock, report: Report) -> None:
    """Every axis, where its person says yes to both questions. Nothing moves unless the CNC says Idle."""
    for axis in cell.axes:
        what = f"{axis.letter}: direction and distance"
        if options.ask is None:
            report.skip(SECTION, what, "it has to be looked at: with --ask and --may-move")
            continue
        try:
            await _step(cnc, axis, options.ask, clock, what, report)
        except DriverError as error:
            report.fault(SECTION, what, error)


async def _step(cnc: QuietCnc, axis: Axis, ask: Ask, clock: Clock, what: str, report: Report) -> None:
    unit = "mm" if axis.kind == "linear" else "deg"
    began = await _idle(cnc, clock)
    if began is None:
        report.skip(SECTION, what, "the CNC is not Idle: home it, then look again")
        return
    place = began.machine[axis.letter]
    step = STEP if place + STEP <= axis.max else -STEP
    answer = await ask(f"{axis.letter} will move by {step:+g} {unit} and back. Is the way clear? (yes, no)")
    if not (answer or "").startswith("y"):
        report.skip(SECTION, what, "nobody answers" if answer is None else "not confirmed")
        return
    moved = await _jogged(cnc, axis, step, clock)
    seen = await ask(f"Did {axis.letter} move by {step:+g} {unit}, in the sense of the cell file's kinematics? (yes, no)")
    back = await _jogged(cnc, axis, -step, clock)
    is_told = moved is not None and back is not None and abs(moved - place - step) <= TOLERANCE and abs(back - place) <= TOLERANCE
    told = "nothing" if moved is None else f"{moved - place:+.3f} {unit}"
    report.judge(
        SECTION, what, is_told and (seen or "").startswith("y"), f"the control tells {told}; seen: {seen or 'no answer'}", f"{step:+g} {unit}",
         f"look at the sense of {axis.letter} ($3), its steps ($100 and on) and kinematics.{axis.letter}",
    )  # fmt: skip


async def _jogged(cnc: QuietCnc, axis: Axis, step: float, clock: Clock) -> float | None:
    """The control's own position after a step; None if it does not come to rest."""
    await cnc.command(f"$J=G91 G21 {axis.letter}{step:.3f} F{FEED:.0f}")
    status = await _idle(cnc, clock)
    return None if status is None else status.machine.get(axis.letter)


async def _idle(cnc: QuietCnc, clock: Clock) -> Status | None:
    """The first report of a machine that stands, within MOVE_S."""
    until = clock.now() + MOVE_S
    while clock.now() < until:
        answer = await cnc.status()
        if answer is not None and answer[0].is_idle:
            return answer[0]
        if answer is not None and answer[0].state not in ("Jog", "Run"):
            return None
        await clock.sleep(0.1)
    return None
