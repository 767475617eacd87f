"""The documents of materials and cells."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, Field

from cellctl.api.models import Strict

NAME = r"^[A-Za-z0-9][A-Za-z0-9._+-]{0,59}$"
WHY = Field(min_length=1, max_length=500, description="why, for whoever finds this version later")


class MaterialDocument(BaseModel):
    """One version of a material. sha256: of its facts, what a job pins; shipped: these facts come with the software."""

    name: str
    version: int
    sha256: str
    facts: dict[str, Any]
    because: str
    created_at: float
    created_by: str
    shipped: bool


class MaterialList(BaseModel):
    """The newest version of every material, by name; there are few, so in one page."""

    items: list[MaterialDocument]


class MaterialVersions(BaseModel):
    """A page of versions, newest first."""

    items: list[MaterialDocument]
    next: str | None = None


class MaterialChange(Strict):
    """The facts of the next version, as an object or as TOML."""

    facts: dict[str, Any] | None = None
    toml: str | None = Field(None, max_length=100_000)
    because: str = WHY


class NewMaterial(MaterialChange):
    """A material of the shop's own. copy_of: begin with the facts of this one; then facts and toml are left out."""

    name: str = Field(pattern=NAME)
    copy_of: str | None = Field(None, pattern=NAME)


class CellDocument(BaseModel):
    """A cell file as it was seen at starts of the service. running: it is the one that this service runs; file: its place there."""

    name: str
    version: int
    sha256: str
    facts: dict[str, Any]
    file: str
    first_seen_at: float
    last_seen_at: float
    starts: int
    running: bool


class CellList(BaseModel):
    """The newest version of every cell, by name."""

    items: list[CellDocument]


class CellVersions(BaseModel):
    """A page of versions, newest first."""

    items: list[CellDocument]
    next: str | None = None


class CellText(Strict):
    """A cell file to be looked at."""

    toml: str = Field(max_length=1_000_000)
    because: str = Field("", max_length=500)


class Difference(BaseModel):
    """A field in which two cell files differ; null: not there."""

    field: str
    unit: str
    running: Any
    given: Any


class CellCheck(BaseModel):
    """What a cell file would change. It is valid: one that is not is answered 422, naming field, value, bound and unit."""

    valid: Literal[True] = True
    sha256: str
    differences: list[Difference]
