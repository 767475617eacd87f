"""What a reset does, step by step: standstill, the devices' own faults, and a CNC without a job begun anew."""

from __future__ import annotations

import math

from cellctl.cell.controller import Controller
from cellctl.cell.safety import CNC_DOOR_OPEN
from cellctl.cell.transaction import Step
from cellctl.domain.causes import causes_of_interlocks

RESET_TIMEOUT_S = 3.0


def reset_steps(c: Controller) -> list[Step]:
    """The steps for the cell as it stands."""
    if c.drivers is None:
        return []
    d = c.drivers
    steps = [
        Step("waiting for standstill", lambda: not c.is_cnc_alive or _at_rest(c), RESET_TIMEOUT_S, code="cnc_silent")
    ]
    if "door" in c.alarms:
        steps.append(Step("waiting until every wire tells a closed door", lambda: not _door_told_open(c), RESET_TIMEOUT_S,
                          detail=lambda: _door_told_open(c), remedy="close the door; if it is, look at its contacts; reset"))  # fmt: skip
    if not math.isinf(d.laser.age_s):
        steps.append(Step("resetting the laser", lambda: not d.laser.faults, RESET_TIMEOUT_S, act=d.laser.reset_faults,
                          age_s=lambda: d.laser.age_s, code="laser_fault", detail=lambda: "; ".join(d.laser.faults)))  # fmt: skip
    if not math.isinf(d.feeder.age_s):
        steps.append(Step("resetting the feeder", lambda: not d.feeder.faults, RESET_TIMEOUT_S, act=d.feeder.reset_faults,
                          age_s=lambda: d.feeder.age_s, code="feeder_fault", detail=lambda: "; ".join(d.feeder.faults)))  # fmt: skip
    if c.is_cnc_alive and c.run is None:
        begin = lambda: c.quiesce.begin(c.times.wire.now(), reset=True)  # noqa: E731
        steps.append(Step("resetting the CNC", lambda: _advanced(c), RESET_TIMEOUT_S, act=begin, code="cnc_silent"))
        steps.append(c.gate.step())
    return steps


def _at_rest(c: Controller) -> bool:
    c.quiesce.advance(c.times.wire.now())
    return c.quiesce.is_still or c.quiesce.is_clear


def _door_told_open(c: Controller) -> str:
    """Which wire still tells an open door (the I/O coupler's was asked before the reset); empty when none does."""
    d = c.drivers
    if d is None:
        return ""
    told = [detail for code, detail in causes_of_interlocks(d.laser.interlocks) if code == "door"]
    if told and not d.laser.client.is_stale("interlock_word"):
        return f"the laser's interlock chain says {told[0]}"
    is_open = c.is_cnc_alive and d.cnc.status is not None and d.cnc.status.state == "Door" and d.cnc.status.substate in CNC_DOOR_OPEN
    return "the CNC says that its door input is open" if is_open else ""


def _advanced(c: Controller) -> bool:
    c.quiesce.advance(c.times.wire.now())
    return c.quiesce.is_clear
