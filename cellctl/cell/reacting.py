"""What a fault does: laser off first, then the reaction that the cell file has for its cause, latched with cause and remedy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cellctl.cell.safety import Told
from cellctl.domain.causes import is_explained
from cellctl.domain.reactions import explain
from cellctl.domain.snapshot import Alarm
from cellctl.domain.states import IN_JOB, LATCHED, State, Trigger
from config.reactions import CHECKED_AT_REST, Reaction

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller

S, T = State, Trigger
FAILINGS = frozenset({"line_rejected", "tool", "datum"})  # the program is at fault: the job has failed
HOLDABLE = frozenset({S.PREPARING, S.RUNNING, S.RESUMING})


def react(c: Controller, code: str, detail: str = "", remedy: str = "") -> None:
    """Latch a fault, laser off first; the same one twice is one alarm, and so are a cause and what it explains.

    Raises KeyError for a code without a reaction.
    """
    lead_s = 0.0
    if c.drivers is not None:
        lead_s = c.lead_s
        c.hand.lock(code)
    is_known = code in c.alarms or any(is_explained(code, detail, by=known) for known in c.alarms)
    if is_known and c.state is not S.RESETTING:  # a reset that fails of the same cause has failed
        return
    reaction = c.cell.reactions[code]
    if not reaction.latch and c.state in IN_JOB and not c.alarms:
        _hold_only(c, code, detail, remedy, lead_s)
        return
    cause = _latch(c, code, detail, remedy)
    before = c.state
    is_at_rest = (before is S.PREPARING and code in CHECKED_AT_REST) or (before is S.HELD and code == "head_position")
    if is_at_rest and not c.quiesce.outcome:
        reaction = reaction.at_rest()
    c.go(T.FAULTED, cause)
    if c.drivers is not None:
        _carry_out(c, code, reaction, before, lead_s)


def _carry_out(c: Controller, code: str, reaction: Reaction, before: State, lead_s: float) -> None:
    """Motion, powder and the job, as the reaction has them."""
    assert c.drivers is not None
    now = c.times.wire.now()
    wants_reset = reaction.drops_stream or before in (S.ABORTING, S.HOMING)  # homing knows no hold
    if c.is_cnc_alive and (wants_reset or before not in LATCHED):
        c.quiesce.begin(now, reset=wants_reset, lead_s=lead_s)
    if reaction.retract and before in IN_JOB:
        c.retract.want()
    elif not reaction.retract:
        c.retract.cancel(f"{code} allows no motion")
    divert_powder(c, reaction)
    c.drivers.laser.enable(False)
    run = c.run
    if run is None:
        return
    if before is S.ABORTING:
        c.quiesce.outcome = "aborted"
    elif reaction.stops_job:
        c.quiesce.outcome = c.quiesce.outcome or ("failed" if code in FAILINGS else "interrupted")
    if c.quiesce.outcome and not c.is_cnc_alive:
        c.end_run(c.quiesce.outcome)


def divert_powder(c: Controller, reaction: Reaction) -> None:
    """Powder shut, diverted, or left as it is; a later reaction never turns on again what an earlier one shut."""
    assert c.drivers is not None
    if reaction.powder == "off":
        c.drivers.feeder.safe()
        c.powder_until = None
        return
    if reaction.powder == "divert":
        c.drivers.feeder.divert(True)
    if c.powder_until is None:
        c.powder_until = c.times.wire.now() + c.cell.limits.powder_settle_timeout_s


def to_nozzle(c: Controller) -> None:
    """A job that goes on wants its powder at the nozzle again, and flowing as long as it says."""
    c.powder_until = None
    if c.drivers is not None:
        c.drivers.feeder.divert(False)


def shut_powder_in_time(c: Controller, now: float) -> None:
    """Powder that a reaction let flow on is shut when nobody has resumed for as long as it takes to settle anew."""
    if c.powder_until is not None and now >= c.powder_until and c.drivers is not None:
        c.powder_until = None
        c.drivers.feeder.safe()


def _hold_only(c: Controller, code: str, detail: str, remedy: str, lead_s: float) -> None:
    """The cell file has this cause hold the job without a latch: the operator resumes when it is gone."""
    if c.drivers is None or c.state not in HOLDABLE:
        return
    cause, cure = explain(code, detail, remedy)
    c.event("held", cause, {"code": code, "detail": detail, "shown_remedy": cure})
    divert_powder(c, c.cell.reactions[code])
    if c.state is S.PREPARING:
        if c.run is not None:
            c.run.transaction = None
    else:
        c.quiesce.begin(c.times.wire.now(), reset=False, lead_s=lead_s)
    c.go(T.HOLD, f"{cause}; {cure}")


def _latch(c: Controller, code: str, detail: str, remedy: str) -> str:
    """Make the alarm, in place of those that it explains; its cause in the operator's words."""
    cause, cure = explain(code, detail, remedy)
    now = c.times.unix()
    replaced = [known for known, told in c.told.items() if known == code or is_explained(known, told.detail, by=code)]
    began_at = min([now, *(c.alarms[known].at for known in replaced)])
    for known in replaced:
        del c.alarms[known], c.told[known]
    c.alarms_made += 1
    c.alarms[code] = Alarm(c.alarms_made, began_at, code, cause, cure)
    c.told[code] = Told(detail, c.times.wire.now())
    data: dict[str, Any] = {"code": code, "detail": detail, "remedy": remedy, "shown_remedy": cure, "instead_of": replaced}
    if c.run is not None:
        data |= {"line": c.run.line, "layer": int(c.run.row["layer"])}
    c.event("alarm", cause, data)
    if replaced:
        c.because = cause
    return cause
