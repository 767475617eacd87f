"""The audit trail: who did what, from where and why; read by engineers and admins, changed by nobody."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from cellctl.api.models_people import AuditItem, AuditPage, AuditVerdict
from cellctl.api.parts import Cursor, Limit
from cellctl.api.problems import DOCUMENTED
from cellctl.api.sign_in import Engineer, ServiceOf
from cellctl.store import audit
from cellctl.store.audit import Wanted

router = APIRouter(prefix="/api/v1/audit", tags=["audit"], responses=DOCUMENTED)
Text = Annotated[str | None, Query(max_length=200)]
Time = Annotated[float | None, Query(ge=0, le=1e11, description="Unix seconds")]


@router.get("")
def list_deeds(
    _person: Engineer,
    service: ServiceOf,
    who: Text = None,
    verb: Text = None,
    target: Text = None,
    since: Time = None,
    until: Time = None,
    cursor: Cursor = None,
    limit: Limit = 50,
) -> AuditPage:
    """Deeds, newest first: of one person, verb or target, from `since` to before `until`."""
    with service.store.read() as rows:
        found, following = audit.find_page(rows, Wanted(who, verb, target, since, until), cursor, limit)
    return AuditPage(items=[AuditItem.model_validate(dict(row)) for row in found], next=following)


@router.get("/verdict")
def verify(
    _person: Engineer,
    service: ServiceOf,
    anchor: Annotated[str, Query(max_length=64, description="hash of a row that was noted earlier, which must still be there")] = "",
) -> AuditVerdict:
    """Look through the whole trail: every row must be as it was written, and none missing."""
    with service.store.read() as rows:
        return AuditVerdict(**audit.verify(rows, anchor).__dict__)
