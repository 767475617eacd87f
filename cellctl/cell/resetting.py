"""What a reset does, step by step: standstill, the devices' own faults, and a CNC without a job begun anew."""

from __future__ import annotations

import math

from cellctl.cell.controller import Controller
from cellctl.cell.safety import CNC_DOOR_OPEN
from cellctl.cell.transaction import Step
from cellctl.domain.causes import causes_of_interlocks
from drivers.feeder import Feeder
from drivers.laser import Laser

RESET_TIMEOUT_S = 3.0
ABSENT_S = 1.0  # a device that has not answered by then is not there
AGAIN_S = 0.5  # a device has taken a reset and shows it long before


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
    steps += [_own_faults(c, "laser", d.laser), _own_faults(c, "feeder", d.feeder)]
    if c.is_cnc_alive and c.run is None:
        begin = lambda: c.quiesce.begin(c.times.wire.now(), reset=True)  # noqa: E731
        steps.append(Step("resetting the CNC", lambda: _advanced(c), RESET_TIMEOUT_S, act=begin, code="cnc_silent"))
        steps.append(c.gate.step())
    return steps


def _own_faults(c: Controller, name: str, device: Laser | Feeder) -> Step:
    """Clear what the device has latched. It is asked again while a fault stays: a request is lost with a connection that breaks.

    One that has not been heard since the process began is waited for a moment; without it the cell is offline, and says so.
    """
    asked_at = [0.0, 0.0]

    def ask() -> None:
        asked_at[0] = c.times.wire.now()
        device.reset_faults()

    def begin() -> None:
        ask()
        asked_at[1] = asked_at[0]

    def is_absent() -> bool:
        return math.isinf(device.age_s) and c.times.wire.now() - asked_at[1] >= ABSENT_S

    def is_clear() -> bool:
        if is_absent():
            return True
        if device.faults and c.times.wire.now() - asked_at[0] >= AGAIN_S:
            ask()
        return not device.faults

    return Step(
        f"resetting the {name}",
        is_clear,
        RESET_TIMEOUT_S,
        act=begin,
        age_s=lambda: 0.0 if is_absent() else device.age_s,
        code=f"{name}_fault",
        detail=lambda: "; ".join(device.faults),
    )


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
