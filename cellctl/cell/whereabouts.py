"""Where the run is at a tick, and where metal will have ended if nobody beats from now on: written to the black box by every tick."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cellctl.cell.black_box import Moment, Place
from cellctl.domain.sync import Timeline

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller
    from cellctl.cell.stream import Run
    from drivers.cell_wires import CellDrivers


def note(c: Controller, now: float) -> None:
    """Keep this tick in the black box.  now : wire time, s. A cell without a run keeps one empty moment."""
    run, drivers, box = c.run, c.drivers, c.journal.box
    if run is None or drivers is None:
        if box.moment.job:
            box.write(Moment())
        return
    before = box.moment if box.moment.job == run.job else None
    box.write(_moment(c, run, drivers, before, now))


def _moment(c: Controller, run: Run, drivers: CellDrivers, before: Moment | None, now: float) -> Moment:
    timeline, last, wanted = run.timeline, run.follower.last, run.wanted
    sent, permit = drivers.cnc.counts.sent, c.hand.is_permitted
    lit = before.lit if before is not None else Place()
    if last is None:
        return Moment(
            run.job, c.times.unix(), now, lit=lit, dark=lit, executed=run.executed, sent=sent, is_permitted=permit
        )
    time_s = max(run.follower.predicted_time(now), last.time_s)
    place = place_at(timeline, time_s)
    if permit and (run.program.gate == "modbus" or timeline.is_emitting[place.line]):
        lit = place
    rate = run.follower.rate if last.is_run else 0.0
    dark = lit
    if permit:
        ends_s = time_s + rate * drivers.laser.client.trips_in_s
        ends_s = min(ends_s, float(timeline.time_end_s[sent - 1]) if sent else 0.0)  # what was not sent does not run
        dark = metal_end(timeline, lit, place_at(timeline, max(ends_s, time_s)), run.program.gate == "stream")
    return Moment(
        run.job, c.times.unix(), now, place, time_s, lit, rate, dark, run.executed, sent, permit,
        drivers.laser.power_setpoint_w, wanted.powder_g_min, wanted.carrier_gas_l_min, wanted.shield_gas_l_min,
    )  # fmt: skip


def place_at(timeline: Timeline, time_s: float) -> Place:
    """The place at a program time (s)."""
    line = timeline.line_at(time_s)
    start, end = float(timeline.time_start_s[line]), float(timeline.time_end_s[line])
    fraction = min(max((time_s - start) / (end - start), 0.0), 1.0) if end > start else 1.0
    return Place(line, fraction, timeline.arc_at(line, fraction))


def metal_end(timeline: Timeline, lit: Place, reach: Place, has_gate: bool) -> Place:
    """The last place with light between the last lit one and where the machine gets before the laser's dead-man has tripped.

    has_gate : whether the Program's own words shut the laser between passes, whoever is alive
    """
    if not has_gate:
        return reach if lit.line >= 0 else lit
    if timeline.is_emitting[reach.line]:
        return reach
    first = max(lit.line, 0)
    emitting = np.flatnonzero(timeline.is_emitting[first : reach.line])
    if emitting.size == 0:
        return lit
    line = first + int(emitting[-1])
    return Place(line, 1.0, timeline.arc_at(line, 1.0))
