"""The documents of a job's life: what it waits for, its steps, notes, attachments, re-runs, the queues and the table."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Field

from cellctl.store.dependencies import Until

TAGS_MAX, DEPENDENCIES_MAX = 20, 20
TIME_MAX = 4_102_444_800.0  # 2100-01-01


def _tag(text: str) -> str:
    """A tag as it is kept. Raises ValueError for what is none."""
    kept = " ".join(text.split())
    if not kept or len(kept) > 40 or not kept.isprintable():
        raise ValueError("a tag has 1 to 40 printable characters")
    return kept


def _text(text: str) -> str:
    """A note as it is kept. Raises ValueError for one that says nothing, or holds what is no text."""
    kept = text.strip()
    if not kept or any(not (char.isprintable() or char in "\n\t") for char in kept):
        raise ValueError("a note has words, and no control characters")
    return kept


Tag = Annotated[str, Field(max_length=60), AfterValidator(_tag)]
Because = Annotated[str, Field(max_length=500, description="why, in words that others read")]


class Strict(BaseModel, extra="forbid"):
    """A request: unknown fields are refused."""


class After(Strict):
    """Not before another job is completed, or its part was cleared from the table."""

    job: str = Field(max_length=60)
    until: Until = Until.COMPLETED


class Wait(BaseModel):
    """One thing that a job waits for. kind: job, time, table, cell, planner, approval, person; blocked: it will not come about by itself"""

    kind: Literal["job", "time", "table", "cell", "planner", "approval", "person"]
    text: str
    job: str | None = Field(None, description="the other job")
    until: str | None = Field(None, description="of a job: completed or cleared")
    at: float | None = Field(None, description="Unix time, s")
    blocked: bool = False


class Dependency(BaseModel):
    """What a job may not start before."""

    job: str
    name: str
    state: str
    until: Until
    met: bool


class Change(BaseModel):
    """A field of the recipe that differs from the job that it was made from. None: left to the material or the planner"""

    field: str
    before: Any = None
    after: Any = None


class JobEdit(Strict):
    """What of a job may be changed. What is left out stays; after: all its dependencies anew; not_before: null takes it away"""

    name: str | None = Field(None, min_length=1, max_length=200)
    tags: list[Tag] | None = Field(None, max_length=TAGS_MAX)
    priority: int | None = Field(None, ge=1, le=9, description="1 goes first, 9 last; 5 as submitted")
    not_before: float | None = Field(None, ge=0, le=TIME_MAX, description="Unix time, s")
    after: list[After] | None = Field(None, max_length=DEPENDENCIES_MAX)
    because: Because = ""


class Again(Strict):
    """A job once more."""

    name: str | None = Field(None, max_length=200)
    because: Because = ""


class Clone(Again):
    """A job once more with another recipe: fields that are named take the place of those of the first; null leaves one to the material."""

    recipe: dict[str, Any] = Field(default_factory=dict)
    tags: list[Tag] | None = Field(None, max_length=TAGS_MAX, description="default: those of the first")


class CloneShown(BaseModel):
    """What a clone would be."""

    recipe: dict[str, Any]
    changes: list[Change]


class Step(BaseModel):
    """One step of a job's life. left: the state before; lasted_s: until the next step, null for the state that it is in"""

    at: float
    left: str
    state: str
    why: str
    who: str
    lasted_s: float | None


class Life(BaseModel):
    """The steps of a job's life so far."""

    items: list[Step]


class NewNote(Strict):
    """Words to be added."""

    text: Annotated[str, Field(max_length=4000), AfterValidator(_text)]


class Note(BaseModel):
    """A remark of a person."""

    seq: int
    at: float
    who: str
    text: str


class Notes(BaseModel):
    """The notes of a job, in order."""

    items: list[Note]


class Attachment(BaseModel):
    """A file at a job. kind: its media type, as its bytes tell; is_image: it may be shown"""

    id: str
    at: float
    who: str
    name: str
    kind: str
    bytes: int
    sha256: str
    is_image: bool


class Attachments(BaseModel):
    """The attachments of a job, in order."""

    items: list[Attachment]


class Tags(BaseModel):
    """Every tag in use, and at how many jobs."""

    items: dict[str, int]


class Move(Strict):
    """Where a job goes in its queue: one of these. position: from 0, among the others"""

    job: str = Field(max_length=60)
    to: Literal["first", "last", "up", "down"] | None = None
    before: str | None = Field(None, max_length=60)
    behind: str | None = Field(None, max_length=60)
    position: int | None = Field(None, ge=0, le=10**7)
    version: int | None = Field(None, ge=0, le=2**53, description="of the order that was seen; 412 if it is another by now")
    because: Because = ""


class Clear(Strict):
    """I looked: the table is clear and the substrate is clamped. start: a queued job that may start on it"""

    because: Because = ""
    start: str | None = Field(None, max_length=60)


class Table(BaseModel):
    """What lies on the table of the cell. job: whose part, null if it was cleared; next: what could start once somebody looked"""

    cell: str
    job: str | None
    name: str
    state: str
    since: float | None
    cleared_at: float | None
    cleared_by: str
    because: str
    next: str | None
    next_name: str
    text: str
