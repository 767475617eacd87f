"""Powder and gas by their lots: what is loaded, and telling that something else was loaded."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter
from pydantic import BaseModel, Field
from sqlalchemy import Connection

from cellctl.api.context import Service
from cellctl.api.idempotent import IdempotencyKey, once
from cellctl.api.models import Strict
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Operator, ServiceOf, Viewer
from cellctl.store import audit, consumables, versions
from cellctl.store.consumables import Kind, Lot
from cellctl.store.parts import NotFoundError

router = APIRouter(prefix="/api/v1/cell/consumables", tags=["cell"], responses=DOCUMENTED)
LISTED = 100


class LotItem(BaseModel):
    """A lot and who loaded it when (Unix time, s)."""

    seq: int
    at: float
    who: str
    kind: Kind
    lot: str
    material: str
    note: str


class Consumables(BaseModel):
    """What is in force, one lot of each kind that was told; and what was loaded before, newest first."""

    loaded: list[LotItem]
    history: list[LotItem]


class NewLot(Strict):
    """A lot that was loaded. material: of powder, a name of GET /api/v1/materials."""

    kind: Kind
    lot: str = Field(min_length=1, max_length=100, description="as on the maker's certificate")
    material: str = Field("", max_length=60)
    note: str = Field("", max_length=500)


def _item(lot: Lot) -> LotItem:
    return LotItem(**lot.__dict__)


@router.get("")
def list_consumables(_person: Viewer, service: ServiceOf) -> Consumables:
    """What is loaded, and what was."""
    with service.store.read() as rows:
        return Consumables(
            loaded=[_item(lot) for lot in consumables.loaded(rows)], history=[_item(lot) for lot in consumables.every(rows, LISTED)]
        )


def _check_known(service: Service, material: str) -> None:
    """Raise ApiError 422 unless there is such a material."""
    with service.store.read() as rows:
        try:
            versions.material(rows, material)
        except NotFoundError as error:
            known = ", ".join(row.name for row in versions.materials(rows))
            raise ApiError(422, "The request does not fit", f"material: {error}", f"there are: {known}") from None


@router.post("", status_code=201)
def load(person: Operator, service: ServiceOf, body: NewLot, idempotency_key: IdempotencyKey = None) -> LotItem:
    """Tell that a lot was loaded. It stands in the record of every job from now on; a job of another material does not start."""
    if (body.kind is Kind.POWDER) != bool(body.material):
        detail = "powder needs material" if body.kind is Kind.POWDER else f"material does not belong to {body.kind.value}"
        raise ApiError(422, "The request does not fit", detail, "name a material of GET /api/v1/materials, for powder alone")
    if body.material:
        _check_known(service, body.material)

    def make(rows: Connection) -> dict[str, Any]:
        now = service.store.clock()
        lot = consumables.load(rows, now, person.name, body.kind, body.lot, body.material, body.note)
        audit.add(rows, person.deed("load", f"{body.kind.value} {body.lot}", body.note), now, "ok")
        return _item(lot).model_dump(mode="json")

    answer, _ = once(service, person, idempotency_key, ("consumable", body.model_dump(mode="json")), make)
    service.runs.wake()
    return LotItem(**answer)
