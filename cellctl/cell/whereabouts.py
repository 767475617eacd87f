"""Where the run is at a tick, and where metal will have ended if nobody beats from now on: written to the black box by every tick."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cellctl.cell.black_box import Moment, Place
from cellctl.domain.sync import HORIZON_PERIODS, Timeline

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
    place = _at(timeline, run.follower.predicted_place(now))
    if permit and (run.program.gate == "modbus" or timeline.is_emitting[place.line]):
        lit = place
    dark = lit
    if permit and before is not None and before.is_permitted and c.journal.box.is_odd and _order(before.dark) >= _order(place):
        dark = before.dark  # looked for at every second tick: the dead-man is not beaten so often
    elif permit:
        reach = _reach(run, now + drivers.laser.client.trips_in_s)
        if reach.line >= sent:  # what was not sent does not run
            reach = _at(timeline, (max(sent - 1, 0), 1.0))
        dark = metal_end(timeline, lit, max(reach, place, key=_order), run.program.gate == "stream")
    rate = run.follower.rate if last.is_run else 0.0
    time_s = timeline.time_at(place.line, place.fraction)
    return Moment(
        run.job, c.times.unix(), now, place, time_s, lit, rate, dark, run.executed, sent, permit,
        drivers.laser.power_setpoint_w, wanted.powder_g_min, wanted.carrier_gas_l_min, wanted.shield_gas_l_min,
    )  # fmt: skip


def _at(timeline: Timeline, place: tuple[int, float]) -> Place:
    return Place(*place, timeline.arc_at(*place))


def _order(place: Place) -> tuple[int, float]:
    return place.line, place.fraction


def _reach(run: Run, at: float) -> Place:
    """Where the machine is at wire time `at` (s) if it goes on as it does, also beyond what the follower predicts."""
    follower, timeline = run.follower, run.timeline
    last = follower.last
    place = _at(timeline, follower.predicted_place(at))
    beyond_s = at - (last.at + HORIZON_PERIODS * follower.period_s) if last is not None and last.is_run else 0.0
    if beyond_s <= 0.0:
        return place
    time_s = timeline.time_at(place.line, place.fraction) + follower.rate * follower.override * beyond_s
    line = max(timeline.line_at(time_s), place.line)
    start, end = float(timeline.time_start_s[line]), float(timeline.time_end_s[line])
    return _at(timeline, (line, min(max((time_s - start) / (end - start), 0.0), 1.0) if end > start else 1.0))


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
