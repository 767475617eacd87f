"""The documents of REST. Times are Unix seconds; every number has its unit in its name."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from cellctl.api.models_jobs import TAGS_MAX, TIME_MAX, After, Change, Dependency, Tag, Wait

Because = Field("", max_length=500, description="why, in words that the operator reads")


class Strict(BaseModel):
    """A request: unknown fields are refused."""

    model_config = ConfigDict(extra="forbid")


class Finding(BaseModel):
    """Something found in a mesh, and whether it was mended."""

    kind: str
    count: int
    place_mm: list[float] | None
    mended: bool
    volume_change_mm3: float
    text: str


class Part(BaseModel):
    """An uploaded mesh, checked. bbox_mm: lowest and highest corner in the part's own frame."""

    id: str
    name: str
    units: Literal["mm", "inch"]
    sha256: str
    bytes: int
    bbox_mm: list[list[float]]
    facets: int
    volume_mm3: float
    findings: list[Finding]
    created_at: float
    created_by: str


class Parts(BaseModel):
    """A page of parts, newest first."""

    items: list[Part]
    next: str | None = Field(None, description="cursor of the following page")


class JobError(BaseModel):
    """Why a job failed."""

    title: str
    detail: str
    hint: str = ""


class Job(BaseModel):
    """A job. progress: 0 to 1 of the stage that it is in; why: what it waits for."""

    id: str
    name: str
    part_id: str
    state: str
    why: str
    material: str
    cell: str = Field(description="the cell that has it; empty while none has it yet")
    cell_wanted: str = Field("", description="the cell that it was submitted for, or any")
    recipe: dict[str, Any]
    created_at: float
    created_by: str
    error: JobError | None
    proof: dict[str, Any] | None = Field(
        description="figures of the proof: passed, mean_mm, p99_mm, max_mm, missing_mm3, ... and counts of findings"
    )
    stage: str
    progress: float
    layers: int = Field(description="of the plan; while it is being made, those that can be looked at already")
    lines_executed: int
    lines_total: int
    duration_s: float
    approved_by: str
    approve_because: str
    override_reason: str
    table_clear: bool = Field(
        description="a person vouches: the table is clear, or, of a job that continues another, the part stands untouched"
    )
    continues_job: str | None = Field(None, description="the interrupted job whose part this one goes on with")
    resume_point: dict[str, Any] | None = Field(
        None, description="from where it goes on: line and fraction where metal ended; from, layer, operation, overlap_mm as asked"
    )
    resumption: dict[str, Any] | None = Field(
        None, description="figures of the generated program: overlap_mm, lead_in_mm, clearance_mm, extra_s, remaining_s, remaining_lines, ..."
    )
    material_sha256: str = Field("", description="version of the material that it is made with")
    cell_sha256: str = Field("", description="version of the cell that it is made with")
    plan_sha256: str | None
    program_sha256: str | None
    proof_sha256: str | None
    timestamps: dict[str, float]
    waits_for: list[Wait] = Field(default_factory=list, description="all that it waits for; `why` tells the first")
    after: list[Dependency] = Field(default_factory=list, description="other jobs that it may not start before")
    not_before: float | None = None
    priority: int = Field(5, description="1 goes first, 9 last")
    rank: int = Field(0, description="its place among those of its priority: smaller goes first")
    tags: list[str] = Field(default_factory=list)
    made_from: str | None = Field(None, description="the job that it was made from")
    made_how: str = Field("", description="rerun, clone or retry")
    changes: list[Change] = Field(default_factory=list, description="of a clone: what differs in its recipe")
    cleared_at: float | None = Field(None, description="when a person found the table cleared of its part")


class Jobs(BaseModel):
    """A page of jobs."""

    items: list[Job]
    next: str | None = None


class NewJob(Strict):
    """A part to be made. The recipe comes as an object or as TOML; what it leaves out comes from the material."""

    part_id: str = Field(max_length=60)
    recipe: dict[str, Any] | None = None
    recipe_toml: str | None = Field(None, max_length=100_000)
    cell: str | None = Field(
        None, min_length=1, max_length=200, description="its name, or any: the fitting one with the least work; default: this service's"
    )
    name: str | None = Field(None, max_length=200)
    tags: list[Tag] = Field(default_factory=list, max_length=TAGS_MAX)
    priority: int = Field(5, ge=1, le=9, description="1 goes first, 9 last")
    not_before: float | None = Field(None, ge=0, le=TIME_MAX, description="it is not started before; Unix time, s")
    after: list[After] = Field(default_factory=list, max_length=20, description="other jobs that it may not start before")


class Approval(Strict):
    """A person's yes. Without a passing proof it needs an engineer and a reason."""

    because: str = Because
    override_reason: str = Field("", max_length=500)
    table_clear: bool = Field(False, description="I looked: the table is clear and the substrate is clamped")
    part_untouched: bool = Field(
        False,
        description="of a job that continues another: I looked: its part stands untouched on the table, "
        "nothing was moved, and neither tool nor work offset was changed",
    )


class Because_(Strict):
    """Why."""

    because: str = Because


class CellCommand(Strict):
    """What a command to the cell needs. job, table_clear, part_untouched: start;
    axis, distance, feed, continuous: jog (mm or deg, mm/min or deg/min); feed_percent: override."""

    because: str = Because
    id: str | None = Field(None, max_length=100, description="the same id is carried out once")
    job: str | None = Field(None, max_length=60)
    table_clear: bool = False
    part_untouched: bool = False
    axis: str | None = Field(None, max_length=1)
    distance: float | None = Field(None, ge=-10_000, le=10_000)
    feed: float | None = Field(None, gt=0, le=100_000)
    feed_percent: int | None = Field(None, ge=10, le=200, description="override: of the programmed feed, 100 as programmed")
    laser_percent: int | None = Field(None, ge=10, le=200, description="override: of the programmed power, within the snapshot's bounds")
    powder_percent: int | None = Field(None, ge=10, le=200, description="override: of the programmed rate, within the snapshot's bounds")
    continuous: bool = Field(False, description="jog: until its end is told or jog/keep is not, in the sense of distance")


class ControlAsked(Strict):
    """Control of the cell: take it (over, with a reason), give it back, or tell that who has it is still there."""

    action: Literal["take", "release", "present"]
    because: str = Because


class CommandAnswer(BaseModel):
    """The command was accepted and is written down. state: of the cell as last reported."""

    ok: bool
    state: str
    data: dict[str, Any] = {}


class About(BaseModel):
    """What a page has to know before anybody signs in."""

    cell: str
    mode: str
    version: str
    stop_url: str


class EventItem(BaseModel):
    """Something that happened at the cell."""

    seq: int
    at: float
    kind: str
    text: str
    job: str
    data: dict[str, Any]


class Events(BaseModel):
    """A page of events, newest first."""

    items: list[EventItem]
    next: str | None = None


class ProgramFile(BaseModel):
    """A file of a program."""

    name: str
    bytes: int


class Program(BaseModel):
    """A posted program: facts, files."""

    sha256: str
    lines: int
    layers: int
    duration_s: float
    files: list[ProgramFile]


class Health(BaseModel):
    """Whether the service works. cell: whether the cell process answers."""

    status: str
    cell: bool
    cell_state: str = ""
    snapshot_age_s: float | None = None
