"""The overrides of the running job as commands: which percentages its material's window allows, and what changes when one is set."""

from __future__ import annotations

import asyncio
from functools import cache
from typing import TYPE_CHECKING, Any

from cellctl.cell.modes import DEPOSIT
from cellctl.cell.refusal import Refused
from cellctl.domain.messages import Command
from cellctl.domain.overrides import AS_PROGRAMMED, SETTLED, Overrides, Span
from cellctl.domain.snapshot import OverridesView
from cellctl.domain.states import State
from config.base import ConfigError
from config.material import load_material
from planner.program import Channel, ProcessWindow, Program

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller
    from config.cell import Cell
    from drivers.cell_wires import CellDrivers

STEADY = frozenset({State.RUNNING, State.HOLDING, State.HELD})  # in others a sequence verifies the rate that it was built for
KEYS = ("feed_percent", "laser_percent", "powder_percent")
_material = cache(load_material)


async def overrides_of(program: Program, cell: Cell, drivers: CellDrivers) -> Overrides:
    """The overrides of a Program that is about to run, by the window that it was posted with; none of laser and powder without one.

    A Program that does not say its window has that of the shipped material of its name.
    """
    if program.window is not None:
        return _within(program, cell, drivers, program.window)
    try:
        material = await asyncio.to_thread(_material, program.material)
    except ConfigError:
        return Overrides()
    laser, powder = material.deposition.laser_w, material.deposition.powder_g_min
    return _within(program, cell, drivers, ProcessWindow(material.sha256, (laser.min, laser.max), (powder.min, powder.max)))


def _within(program: Program, cell: Cell, drivers: CellDrivers, window: ProcessWindow) -> Overrides:
    schedule = program.schedule
    response, laser, feeder = cell.response, drivers.laser.client.device, drivers.feeder.client.device
    watts = schedule["value"][schedule["channel"] == Channel.LASER_W]
    grams = schedule["value"][schedule["channel"] == Channel.POWDER_G_MIN]
    in_lines = cell.cnc.power_output is not None  # M67: the power is in the text, nobody's to change
    return Overrides(
        None if in_lines else Span.from_values("laser", "W", window.laser_w, watts, laser.registers["power_setpoint"].max),
        Span.from_values("powder", "g/min", window.powder_g_min, grams, feeder.registers["rate_setpoint"].max),
        flow_settles_s=response.powder_delay_s + SETTLED * response.powder_settle_s,
    )


def override(c: Controller, command: Command, drivers: CellDrivers) -> dict[str, Any]:
    """Set one override or several; all are checked before any is set. Feed needs no job. Raises Refused, RangeError_."""
    asked = {key: command.args[key] for key in KEYS if command.args.get(key) is not None}
    if not asked:
        raise Refused(f"override: {', '.join(KEYS[:-1])} or {KEYS[-1]} is needed", "give a whole number of percent, 100 as programmed")
    for key, percent in asked.items():
        if isinstance(percent, bool) or not isinstance(percent, int):
            raise Refused(f"override: {key} is {percent!r}", "give a whole number of percent, 100 as programmed")
    _check_process(c, asked)
    if (feed := asked.get("feed_percent")) is not None:
        drivers.cnc.feed_override(feed)
    run = c.run
    if run is not None:
        now = c.times.wire.now()
        if feed is not None:
            run.follower.command_override(feed / 100.0, now)
        if (laser := asked.get("laser_percent")) is not None:
            run.overrides.laser_percent = laser
        if (powder := asked.get("powder_percent")) is not None:
            _set_powder(c, drivers, powder, now)
        told = ", ".join(f"{key.removesuffix('_percent')} {percent} %" for key, percent in asked.items())
        c.event("override", f"{told} by {command.who}" + (f", because {command.because}" if command.because else ""), {**asked, "who": command.who})
    return {"state": c.state.value, **asked}


def _check_process(c: Controller, asked: dict[str, Any]) -> None:
    """Raises Refused for laser and powder without a job that has them, outside of the window, or while a sequence is being verified."""
    for what in ("laser", "powder"):
        percent = asked.get(f"{what}_percent")
        if percent is None:
            continue
        if c.run is None:
            raise Refused(f"override: there is no job whose {what} could be changed", "the material's window is that of a running job")
        span: Span | None = getattr(c.run.overrides, what)
        if span is None:
            hint = "it sets none, carries it in its own lines, or its material is not known"
            raise Refused(f"override: {what} cannot be changed in this job", hint)
        if refusal := span.refusal(percent):
            raise Refused(f"override: {refusal}", f"give {span.least} to {span.most} %")
        if c.state not in STEADY:
            raise Refused(f"override: {what} cannot be changed while the cell is {c.state.value}", "wait until it runs, or hold it")


def _set_powder(c: Controller, drivers: CellDrivers, percent: int, now: float) -> None:
    """The new rate goes to the feeder at once where powder flows; it reaches the nozzle with the hose's delay."""
    run = c.run
    assert run is not None
    run.overrides.set_powder(percent, now)
    if c.state is State.RUNNING and run.mode == DEPOSIT and drivers.feeder.rate_setpoint_g_min > 0.0:
        drivers.feeder.set_rate(run.overrides.powder_g_min(run.wanted.powder_g_min))


def view(c: Controller) -> OverridesView:
    """The overrides as they stand, with the bounds that hold for the job."""
    status = c.drivers.cnc.status if c.drivers is not None else None
    feed = status.overrides[0] if status is not None else AS_PROGRAMMED
    if c.run is None:
        return OverridesView(feed_percent=feed)
    known = c.run.overrides
    laser, powder = known.laser, known.powder
    return OverridesView(
        feed_percent=feed,
        laser_percent=known.laser_percent,
        laser_min=laser.least if laser else AS_PROGRAMMED,
        laser_max=laser.most if laser else AS_PROGRAMMED,
        laser_window_w=(laser.low, laser.high) if laser else (0.0, 0.0),
        powder_percent=known.powder_percent,
        powder_min=powder.least if powder else AS_PROGRAMMED,
        powder_max=powder.most if powder else AS_PROGRAMMED,
        powder_window_g_min=(powder.low, powder.high) if powder else (0.0, 0.0),
    )
