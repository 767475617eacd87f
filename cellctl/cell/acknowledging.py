"""A person says that an alarm was seen: written down and shown to every console. It resets nothing, and the machine does nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgspec

from cellctl.cell.refusal import Refused
from cellctl.domain.messages import Command

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller


def acknowledge(c: Controller, command: Command) -> dict[str, Any]:
    """Mark those of the alarms named in `codes` that are latched and that nobody acknowledged before; harmless twice.

    Returns the codes that were marked now. Raises Refused without codes.
    """
    codes = command.args.get("codes")
    if not isinstance(codes, list) or not codes or not all(isinstance(code, str) for code in codes):
        raise Refused("acknowledge: codes are needed", "name the alarms that were seen")
    fresh = [code for code in codes if code in c.alarms and not c.alarms[code].acknowledged_by]
    if fresh:
        mark(c, fresh, command.who, c.times.unix())
        c.event("acknowledge", f"{command.who} has seen: {', '.join(fresh)}", {"who": command.who, "codes": fresh})
    return {"state": c.state.value, "acknowledged": fresh}


def mark(c: Controller, codes: list[str], who: str, at: float) -> None:
    """Show that `who` acknowledged these alarms at `at` (Unix, s); one that is not latched is left out."""
    for code in codes:
        if code in c.alarms:
            c.alarms[code] = msgspec.structs.replace(c.alarms[code], acknowledged_by=who, acknowledged_at=at)
