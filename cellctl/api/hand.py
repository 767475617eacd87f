"""By hand at the machine: places, purge and gas test, aiming beam. Each is carried out once per id, audited, and refused in one line."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter

from cellctl.api.cell import ABSENT_HINT, refused
from cellctl.api.cell_link import CellAbsentError
from cellctl.api.context import Service
from cellctl.api.models import CommandAnswer
from cellctl.api.models_hand import GoTo, PilotAsked, Purge, Told
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Operator, Person, ServiceOf

router = APIRouter(prefix="/api/v1/cell", tags=["by hand"], responses=DOCUMENTED)


async def _told(service: Service, person: Person, verb: str, body: Told | GoTo | Purge | PilotAsked, args: dict[str, Any]) -> CommandAnswer:
    """Carry a command to the cell, write the deed down, answer. Raises ApiError."""
    outcome = "failed"
    try:
        because = body.because or f"{verb} by {person.name}"
        reply = await service.link.command(verb, person.name, because, args, body.id, client=person.client)
        outcome = "ok" if reply.ok else f"refused: {reply.error}"
    except CellAbsentError as error:
        outcome = f"no answer: {error}"
        raise ApiError(503, "The cell process does not answer", str(error), ABSENT_HINT) from None
    finally:
        await service.deeds.note(service.store, person.deed(verb, service.cell.name, body.because), outcome)
    if not reply.ok:
        raise refused(reply.error, reply.hint, reply.kind)
    return CommandAnswer(ok=True, state=str(reply.data.get("state", "")), data=reply.data)


@router.post("/go_to")
async def go_to(person: Operator, service: ServiceOf, body: GoTo) -> CommandAnswer:
    """Send the machine to a place of the cell file (by_hand.places), axis by axis; HOLD ends it."""
    return await _told(service, person, "go_to", body, {"place": body.place, "feed": body.feed})


@router.post("/purge")
async def purge(person: Operator, service: ServiceOf, body: Purge) -> CommandAnswer:
    """Powder and gas, or gas alone, for a while; the laser is locked out and read back first."""
    flows = body.model_dump(include={"seconds", "powder_g_min", "carrier_l_min", "shield_l_min"}, exclude_none=True)
    return await _told(service, person, "purge", body, flows)


@router.post("/purge/end")
async def purge_end(person: Operator, service: ServiceOf, body: Told) -> CommandAnswer:
    """Shut powder and gas before their time is over."""
    return await _told(service, person, "purge_end", body, {})


@router.post("/pilot")
async def pilot(person: Operator, service: ServiceOf, body: PilotAsked) -> CommandAnswer:
    """Switch the aiming beam; on only at rest or while jogging, and off by itself with anything else."""
    return await _told(service, person, "pilot", body, {"on": body.on, "seconds": body.seconds})
