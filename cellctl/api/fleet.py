"""The cells of the house, as their services tell them in the shared store."""

from __future__ import annotations

import math
from typing import Any

from fastapi import APIRouter

from cellctl.api.context import Service
from cellctl.api.models_fleet import Fleet, FleetCell, FleetJob
from cellctl.api.problems import DOCUMENTED
from cellctl.api.sign_in import ServiceOf, Viewer
from cellctl.domain import cell_path
from cellctl.planning.keys import software_version
from cellctl.store import cell_queues, fleet
from cellctl.store.fleet import Member

router = APIRouter(prefix="/api/v1/fleet", tags=["fleet"], responses=DOCUMENTED)


@router.get("")
def get_fleet(_person: Viewer, service: ServiceOf) -> Fleet:
    """All cells of this store: what each does, how old that news is, and how many jobs wait for it. A cell by itself is a fleet of one."""
    here = service.neighbours.here
    known = {member.cell for member in service.neighbours.members}
    with service.store.read() as rows:
        members = fleet.members(rows, fleet.now_of(rows, service.store.clock))
        waiting = cell_queues.lengths(rows)
    found = {member.cell: _told(service, member, waiting) for member in members if member.cell in known}
    found[here] = _own(service, found.get(here), waiting)
    return Fleet(
        shared=service.neighbours.is_shared,
        here=here,
        unassigned=waiting.get("", 0),
        cells=[found[cell] for cell in sorted(found)],
    )


def _told(service: Service, member: Member, waiting: dict[str, int]) -> FleetCell:
    """A member as its row says."""
    doing = member.doing
    is_reachable = member.cell in service.neighbours.hosts
    return FleetCell(
        cell=member.cell, here=member.cell == service.neighbours.here, path=cell_path.page_of(member.cell) if is_reachable else "",
        url=member.host_url, state=member.state, because=str(doing.get("because", "")), job=_job(doing), alarms=int(doing.get("alarms") or 0),
        queued=waiting.get(member.cell, 0), age_s=round(member.age_s, 2),
        heard="living" if member.is_living else "dead" if member.is_dead else "silent", software=member.software, facts=member.facts,
    )  # fmt: skip


def _job(doing: dict[str, Any]) -> FleetJob | None:
    """The job that a row tells of; a time that is no number is not known."""
    if not doing.get("job"):
        return None
    remaining = doing.get("remaining_s")
    is_known = isinstance(remaining, int | float) and math.isfinite(remaining)
    return FleetJob(id=str(doing["job"]), name=str(doing.get("name") or doing["job"]), remaining_s=float(remaining) if is_known else None)  # type: ignore[arg-type]


def _own(service: Service, told: FleetCell | None, waiting: dict[str, int]) -> FleetCell:
    """This host's own cell: what it says at this moment, not what was last written down of it."""
    here, snapshot = service.neighbours.here, service.link.fresh
    job = None
    if snapshot is not None and snapshot.job is not None and not snapshot.job.outcome:
        left = snapshot.job.remaining_s
        job = FleetJob(id=snapshot.job.id, name=snapshot.job.name, remaining_s=left if math.isfinite(left) and left >= 0 else None)
    age_s = service.link.age_s
    return FleetCell(
        cell=here, here=True, path="/", url=told.url if told is not None else "", state=snapshot.state if snapshot is not None else "",
        because=snapshot.because if snapshot is not None else "", job=job, alarms=len(snapshot.alarms) if snapshot is not None else 0,
        queued=waiting.get(here, 0), age_s=round(age_s, 2) if math.isfinite(age_s) else 0.0, heard="living", software=software_version(),
        facts=told.facts if told is not None else {},
    )  # fmt: skip
