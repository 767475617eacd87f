"""The way back from a guarded sequence that a fault broke off: begun with the fault, advanced while it is latched, told when it ends."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from cellctl.cell.modes import SAFE
from cellctl.cell.transaction import Rollback
from cellctl.domain.states import State

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller

GUARDED = frozenset({State.PREPARING, State.RESUMING, State.ABORTING})
"""States in which a guarded sequence sets the cell up or puts it to rest."""


def begin_way_back(c: Controller, failed: str) -> None:
    """Undo what the sequence under way has begun, if there is one. failed : what the operator is told of it"""
    broken = c.transaction or (c.run.transaction if c.run is not None else None)
    if c.drivers is None or broken is None or not broken.begun or c.state not in GUARDED:
        return
    if c.run is not None:
        c.run.transaction = None
    status = c.drivers.cnc.status
    is_standing = c.is_cnc_alive and status is not None and (status.is_idle or status.is_held)
    last = c.modes.stand_down(c.run.mode if c.run is not None else SAFE, is_standing=is_standing)
    c.way_back = Rollback(c.modes.back(), broken, last, failed, lambda: why_not_move(c))


def why_not_move(c: Controller) -> str:
    """Why nothing with mass may be moved now; empty if it may."""
    if c.drivers is None or not c.drivers.io.estop_ok:
        return "the E-stop chain is open"
    return "" if c.drivers.io.door_closed else "the door is open"


def advance_way_back(c: Controller, now: float) -> None:
    """Go on with it at wire time `now` (s); tell its end. A stop leaves the rest as it is: everything is off by then."""
    way_back = c.way_back
    if way_back is None or c.retract.is_pending:
        return
    if c.state is State.STOPPED:
        way_back.give_up("STOP was pressed")
    if not way_back.advance(now):
        return
    c.way_back = None
    data = {"failed": way_back.failed, "undone": way_back.undone, "not_undone": way_back.not_undone}
    c.event("rollback", f"{way_back.failed}: {way_back.text}", data)
    for code, alarm in c.alarms.items():
        if alarm.cause == way_back.failed:
            c.alarms[code] = msgspec.structs.replace(alarm, cause=f"{alarm.cause} ({way_back.text})")
