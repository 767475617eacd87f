"""The documents that `cellctl.client` hands out, typed. Plain dicts; the fields are those of /openapi.json. Times are Unix s."""

from __future__ import annotations

from typing import Any, TypedDict


class Finding(TypedDict):
    """What was found in a mesh, and whether it was mended."""

    kind: str
    count: int
    place_mm: list[float] | None
    mended: bool
    volume_change_mm3: float
    text: str


class Part(TypedDict):
    """A mesh that was uploaded. bbox_mm : lower and upper corner"""

    id: str
    name: str
    units: str
    sha256: str
    bytes: int
    bbox_mm: list[list[float]]
    facets: int
    volume_mm3: float
    findings: list[Finding]
    created_at: float
    created_by: str


class JobError(TypedDict):
    """Why a job failed, and what to do."""

    title: str
    detail: str
    hint: str


class Change(TypedDict):
    """A field of a recipe that a clone has otherwise."""

    field: str
    before: Any
    after: Any


class Dependency(TypedDict):
    """A job that another waits for. until : completed or cleared"""

    job: str
    name: str
    state: str
    until: str
    met: bool


class Job(TypedDict):
    """A job with where the work on it stands. why : what it waits for or why it ended, in one line

    cell : empty while none has it; cell_wanted : the one that it was submitted for, or any
    """

    id: str
    name: str
    part_id: str
    state: str
    why: str
    material: str
    cell: str
    cell_wanted: str
    recipe: dict[str, Any]
    created_at: float
    created_by: str
    error: JobError | None
    proof: dict[str, Any] | None
    stage: str
    progress: float
    layers: int
    lines_executed: int
    lines_total: int
    duration_s: float
    approved_by: str
    approve_because: str
    override_reason: str
    table_clear: bool
    continues_job: str | None
    resume_point: dict[str, Any] | None
    resumption: dict[str, Any] | None
    material_sha256: str
    cell_sha256: str
    plan_sha256: str | None
    program_sha256: str | None
    proof_sha256: str | None
    timestamps: dict[str, float]
    waits_for: list[dict[str, Any]]
    after: list[Dependency]
    not_before: float | None
    priority: int
    rank: int
    tags: list[str]
    made_from: str | None
    made_how: str
    changes: list[Change]
    cleared_at: float | None


class MaterialDocument(TypedDict):
    """One version of a material; it never changes."""

    name: str
    version: int
    sha256: str
    facts: dict[str, Any]
    because: str
    created_at: float
    created_by: str
    shipped: bool


class CellDocument(TypedDict):
    """One version of a cell file, as it was seen when a service started. starts : how often"""

    name: str
    version: int
    sha256: str
    facts: dict[str, Any]
    file: str
    first_seen_at: float
    last_seen_at: float
    starts: int
    running: bool


class Upload(TypedDict):
    """A file that comes in pieces. part_id : of what it became"""

    id: str
    filename: str
    units: str
    sha256: str
    bytes: int
    received: int
    created_at: float
    expires_at: float
    part_id: str | None


class EventItem(TypedDict):
    """Something that happened at the cell."""

    seq: int
    at: float
    kind: str
    text: str
    job: str
    data: dict[str, Any]


class ProgramHead(TypedDict):
    """The first lines of a program. head_lines : how many were generated to go on after an interruption"""

    lines: list[str]
    head_lines: int
    lines_total: int


class CommandAnswer(TypedDict):
    """What the cell said to a command that it accepted."""

    ok: bool
    state: str
    data: dict[str, Any]


ALL = (Finding, Part, JobError, Change, Dependency, Job, MaterialDocument, CellDocument, Upload, EventItem, ProgramHead, CommandAnswer)


class FleetJob(TypedDict):
    """The job on a cell. remaining_s : predicted"""

    id: str
    name: str
    remaining_s: float | None


class FleetCell(TypedDict):
    """A cell of the house. path : of its console at the host that was asked; heard : living, silent or dead; age_s : since it was heard"""

    cell: str
    here: bool
    path: str
    url: str
    state: str
    because: str
    job: FleetJob | None
    alarms: int
    queued: int
    age_s: float
    heard: str
    software: str
    facts: dict[str, Any]


class Fleet(TypedDict):
    """All cells of the house. unassigned : jobs for any cell that none was chosen for yet"""

    shared: bool
    here: str
    unassigned: int
    cells: list[FleetCell]
