"""The documents of uploads that can be resumed."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field


class Upload(BaseModel):
    """A file on its way. bytes: in all; received: safe on the disk; part_id: the part that it became."""

    id: str
    filename: str
    units: Literal["mm", "inch"]
    sha256: str = Field(description="of the whole file as its sender said it, empty if not")
    bytes: int
    received: int
    created_at: float
    expires_at: float = Field(description="when it is forgotten if nothing more comes")
    part_id: str | None = None


class Uploads(BaseModel):
    """One's own uploads, oldest first; there are few, so in one page."""

    items: list[Upload]
