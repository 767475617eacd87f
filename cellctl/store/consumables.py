"""Powder and gas by their lots: what a person loaded when. Rows are only added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from sqlalchemy import Connection, RowMapping, insert, select

from cellctl.store.schema import consumables


class Kind(StrEnum):
    """What was loaded."""

    POWDER = "powder"
    CARRIER_GAS = "carrier_gas"
    SHIELD_GAS = "shield_gas"


@dataclass(frozen=True)
class Lot:
    """One lot that is, or was, loaded. lot : of the maker's certificate; material : of powder, a material's name; at : Unix time (s)"""

    seq: int
    at: float
    who: str
    kind: Kind
    lot: str
    material: str
    note: str


def _lot(row: RowMapping) -> Lot:
    return Lot(**{**row, "kind": Kind(row["kind"])})


def load(connection: Connection, at: float, who: str, kind: Kind, lot: str, material: str = "", note: str = "") -> Lot:
    """Write down that a lot was loaded; it is in force until the next one of its kind."""
    values = {"at": at, "who": who, "kind": kind.value, "lot": lot, "material": material, "note": note}
    key = connection.execute(insert(consumables).values(**values)).inserted_primary_key
    return _lot(connection.execute(select(consumables).where(consumables.c.seq == (key[0] if key else 0))).mappings().one())


def loaded(connection: Connection) -> list[Lot]:
    """What is in force, one lot of each kind."""
    return in_force(connection, float("inf"), None)


def every(connection: Connection, limit: int) -> list[Lot]:
    """The newest lots, newest first."""
    return [_lot(row) for row in connection.execute(select(consumables).order_by(consumables.c.seq.desc()).limit(limit)).mappings()]


def in_force(connection: Connection, since: float, until: float | None) -> list[Lot]:
    """What was loaded at `since`, and what was loaded then until `until` (None: up to now), in order (Unix time, s)."""
    query = select(consumables).order_by(consumables.c.at, consumables.c.seq)
    if until is not None:
        query = query.where(consumables.c.at <= until)
    lots = [_lot(row) for row in connection.execute(query).mappings()]
    before = {lot.kind: lot for lot in lots if lot.at <= since}
    return [*before.values(), *(lot for lot in lots if lot.at > since)]


def wrong_powder(lots: Sequence[Lot], material: str) -> str:
    """Why the powder that is loaded is not the job's, in a line; empty if it is, or if nobody told what is loaded."""
    powder = next((lot for lot in reversed(lots) if lot.kind is Kind.POWDER), None)
    if powder is None or powder.material == material:
        return ""
    return f"the feeder holds {powder.material} (lot {powder.lot}, told by {powder.who}), the job needs {material}"
