"""What a cell does about each unsafe signal or fault: safe defaults, and the floor below which no cell file may go."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, ValidationError

from config.base import Facts, explain

Motion = Literal["hold", "reset"]
Powder = Literal["keep", "divert", "off"]


class Reaction(Facts):
    """The reaction to one cause. The laser and its permit are off in every one."""

    laser: Literal["off"] = "off"
    motion: Motion = Field("hold", description="hold: decelerate, the stream stays intact; reset: decelerate, then drop what is buffered")
    powder: Powder = Field("off", description="off: powder and gas are shut; divert: to the bin, the feeder runs on; keep: as it is")
    retract: bool = Field(False, description="after standstill the head goes back along the tool axis by limits.retract_mm; the stream is dropped")
    latch: bool = Field(True, description="the fault stays until an operator resets it; false: the job is held, and resumed by the operator")
    ends_job: bool = Field(False, description="the job is over (interrupted); otherwise it is held and can be resumed after the reset")

    def at_rest(self) -> Reaction:
        """The same for a job whose machine stands at a barrier: nothing is buffered, and nothing is lost."""
        return self.model_copy(update={"motion": "hold", "ends_job": False})

    @property
    def drops_stream(self) -> bool:
        """Whether what is buffered in the control is lost: a held control cannot retract without losing it."""
        return self.motion == "reset" or self.retract

    @property
    def stops_job(self) -> bool:
        """Whether the job cannot be resumed from its stream."""
        return self.ends_job or self.retract


_HOLD = Reaction()
_RESET = Reaction(motion="reset", ends_job=True)

DEFAULTS: dict[str, Reaction] = {
    "estop": _RESET,
    "door": _HOLD,
    "chiller": _HOLD,
    "gas_pressure": _HOLD,
    "fume_extraction": _HOLD,
    "head_position": _RESET,
    "laser_fault": _HOLD,
    "laser_interlock": _HOLD,
    "laser_silent": _HOLD,
    "laser_lost": _HOLD,
    "laser_emitting": _RESET,
    "dark_pass": _HOLD,
    "feeder_fault": _HOLD,
    "feeder_silent": _HOLD,
    "feeder_lost": _HOLD,
    "powder_flow": _HOLD,
    "gas_flow": _HOLD,
    "io_silent": _HOLD,
    "io_fault": _RESET,
    "io_lost": _RESET,
    "power": _RESET,
    "cnc_lost": _RESET,
    "cnc_silent": _RESET,
    "cnc_alarm": _RESET,
    "cnc_reset": _RESET,
    "line_rejected": _RESET,
    "answer_overdue": _RESET,
    "cnc_answers": _RESET,
    "step_failed": _HOLD,
    "tool": _RESET,
    "datum": _RESET,
    "store": _HOLD,
    "internal": _RESET,
    "restarted": _HOLD,
}
"""Cause -> reaction where the cell file says nothing. Motion, ends_job and latch are also the floor, but for what stands below."""

CHECKED_AT_REST = frozenset({"tool", "datum"})
"""Found by a check before anything moves, these hold the job: it is put right, reset, and the check is done again."""
MAY_KEEP_POWDER = frozenset({"chiller", "laser_fault", "laser_interlock", "laser_silent", "laser_lost", "store"})
"""Causes at which flowing powder harms nothing: nobody is in the cell, and the flow itself is sound."""
MAY_PASS = frozenset({"chiller", "gas_pressure", "fume_extraction", "powder_flow", "gas_flow", "feeder_fault"})
"""Supplies: a cell file may have the job held without a latched fault (latch = false)."""
MAY_RETRACT = MAY_KEEP_POWDER | MAY_PASS | {"laser_emitting", "feeder_silent"}
"""Causes at which the position is trusted and the doors are known to be closed, so that the head may move."""


def _weaker(name: str, chosen: Reaction) -> str:
    """What of a reaction is below the floor of its cause; empty if nothing is."""
    floor = DEFAULTS[name]
    if floor.motion == "reset" and chosen.motion == "hold":
        return "motion: the control's buffer has to be dropped (reset)"
    if floor.ends_job and not chosen.ends_job:
        return "ends_job: the job cannot go on after it (true)"
    if not chosen.latch and name not in MAY_PASS:
        return f"latch: it has to latch (true); false is only for {', '.join(sorted(MAY_PASS))}"
    if not chosen.latch and chosen.stops_job:
        return "latch: a reaction that ends the job or retracts has to latch (true)"
    if chosen.powder == "keep" and name not in MAY_KEEP_POWDER:
        return f"powder: it has to be off or diverted; keep is only for {', '.join(sorted(MAY_KEEP_POWDER))}"
    if chosen.retract and name not in MAY_RETRACT:
        return f"retract: no motion may follow it (false); true is only for {', '.join(sorted(MAY_RETRACT))}"
    return ""


def complete(given: Mapping[str, Mapping[str, Any] | Reaction]) -> dict[str, Reaction]:
    """The reaction to every cause: the default, changed by what the cell file gives for it.

    Raises ValueError, in one line, for a cause that does not exist, a value that is none, and a reaction below the floor.
    """
    found = dict(DEFAULTS)
    for name, change in given.items():
        if name not in DEFAULTS:
            raise ValueError(f"no signal or fault {name!r}; there are {', '.join(DEFAULTS)}")
        if not isinstance(change, Mapping | Reaction):
            raise ValueError(f"{name}: a table [reactions.{name}] is needed (got {change!r})")
        values = change.model_dump() if isinstance(change, Reaction) else dict(change)
        try:
            found[name] = Reaction.model_validate({**DEFAULTS[name].model_dump(), **values})
        except ValidationError as error:
            raise ValueError(f"{name}.{explain(error)}") from None
        below = _weaker(name, found[name])
        if below:
            raise ValueError(f"{name}.{below}")
    return found
