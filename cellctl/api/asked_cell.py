"""The cell that a job is submitted for: this service's, one by its name, or any that it fits; refused where it cannot be made."""

from __future__ import annotations

from sqlalchemy import Connection

from cellctl.api.context import Service
from cellctl.api.problems import ApiError
from cellctl.domain.dispatch import none_fits
from cellctl.domain.fitting import CellFacts, JobNeeds, facts_from, why_not
from cellctl.domain.fleet import ANY
from cellctl.planning.needs import facts_of
from cellctl.store import fleet
from cellctl.store.fleet import Member

TITLE = "It does not fit the cell"
HINT = "change what is named, or submit it for another cell (`cell`: a name, or any)"


def known_cells(service: Service, rows: Connection) -> dict[str, tuple[CellFacts | None, str]]:
    """By name, what each cell of the fleet offers (None: told in another version's words) and its hash; this one as it stands."""
    now = fleet.now_of(rows, service.store.clock)
    found: dict[str, tuple[CellFacts | None, str]] = {one.cell: _of(one) for one in fleet.members(rows, now)}
    return found | {service.cell.name: (facts_of(service.cell), service.cell.sha256)}


def _of(member: Member) -> tuple[CellFacts | None, str]:
    return facts_from(member.facts), member.cell_sha256


def cell_for(service: Service, rows: Connection, asked: str | None, needs: JobNeeds) -> dict[str, str]:
    """`cell`, `cell_wanted` and `cell_sha256` of a job. Raises ApiError for a cell that is not there, or that the job does not fit."""
    known = known_cells(service, rows)
    if asked == ANY:
        reasons = {name: why_not(needs, facts) for name, (facts, _) in known.items() if facts is not None}
        if reasons and all(reasons.values()):
            raise ApiError(422, "It fits no cell", none_fits(reasons), "change what is named")
        return {"cell": "", "cell_wanted": ANY, "cell_sha256": ""}
    name = asked or service.cell.name
    if name not in known:
        raise ApiError(422, "Another cell", f"cell: there is no cell {name[:60]!r}", f"there are: {', '.join(sorted(known))}, or any")
    facts, sha256 = known[name]
    why = why_not(needs, facts) if facts is not None else ""
    if why:
        raise ApiError(422, TITLE, why, HINT)
    return {"cell": name, "cell_wanted": name, "cell_sha256": sha256}
