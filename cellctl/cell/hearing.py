"""What the CNC tells the cell by itself: reports, answers, alarms, a restart; each event to the one who needs it, or to a fault."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cellctl.domain.causes import cause_of_alarm
from cellctl.domain.states import IN_JOB, State
from drivers.cnc.events import (
    AlarmRaised,
    AnswerOverdue,
    CncEvent,
    LineAccepted,
    LineRejected,
    Message,
    PortLost,
    ProtocolFault,
    StatusReport,
    Welcome,
)

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller

S = State


def hear(c: Controller, event: CncEvent) -> None:
    """Take in one event: positions, answers, and what has to latch."""
    has_job = c.run is not None and not c.quiesce_pending  # also behind a fault that can be reset
    busy = has_job or c.state in IN_JOB or c.state in (S.HOMING, S.JOGGING, S.PURGING)
    if isinstance(event, StatusReport):
        c.position.report(event.status)
        if c.run is not None:
            c.run.report(event.status)
    elif isinstance(event, LineAccepted):
        if c.run is not None:
            c.run.answered(c.times.wire.now())
    elif isinstance(event, PortLost):
        c.is_cnc_alive = False
        if busy:
            c.fault("cnc_lost", event.message, event.hint)
    elif isinstance(event, AlarmRaised) and busy:
        c.fault(cause_of_alarm(event.code), f"ALARM:{event.code} {event.cause}", event.remedy)
    elif isinstance(event, LineRejected) and c.run is not None:
        c.fault("line_rejected", f"N{event.n} {event.line!r}: error {event.code}, {event.text}", event.remedy)
    elif isinstance(event, AnswerOverdue) and c.run is not None:
        c.fault("answer_overdue", f"N{event.n} after {event.waited_s:.1f} s {event.garbled}".strip())
    elif isinstance(event, ProtocolFault) and has_job and c.drivers and c.drivers.cnc.is_halted:
        c.fault("cnc_answers", event.text)
    elif isinstance(event, Welcome) and not event.expected:
        c.gate.doubt()
        if c.state is not S.OFFLINE:
            c.position.suspect("the CNC restarted by itself")
        if busy:
            c.fault("cnc_reset", event.banner)
    elif isinstance(event, Message):
        c.event("cnc", event.text)
