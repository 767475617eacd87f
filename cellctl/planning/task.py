"""What a worker is told, what it reports, and the error that it hands back: one struct each, JSON between the processes."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

Kind = Literal["inspect", "plan", "post", "resume", "prove", "record"]


class Link(msgspec.Struct, frozen=True):
    """A program that was interrupted, and where metal ended in it. line : index; fraction : of it that is done"""

    program: str
    line: int
    fraction: float


class Task(msgspec.Struct, frozen=True):
    """One piece of work.

    folder : where the result's files go; parent : process that waits for it, the worker ends with it
    mesh, units : the part's file; plan, program : files made before; cell : cell file; stock : mesh of the raw stock
    material, material_toml : facts that this name stands for in this task, empty: what is shipped under it
    point : resume: {from, line, fraction, layer, operation, overlap_mm}; links : prove: what was run on the part before, in order
    store, job : record: whose; sealed_at : when it is sealed (Unix time, s), 0: it is only written, as it stands
    checkpoints : folder in which proofs keep their states at layers, so that an edited program is not proven from its begin
    """

    kind: Kind
    folder: str
    parent: int
    memory_bytes: int
    part_name: str = "part"
    mesh: str = ""
    units: str = "mm"
    recipe_toml: str = ""
    stock: str = ""
    plan: str = ""
    program: str = ""
    cell: str = ""
    checkpoints: str = ""
    material: str = ""
    material_toml: str = ""
    point: dict[str, Any] = {}
    links: list[Link] = []
    store: str = ""
    job: str = ""
    sealed_at: float = 0.0


class Progress(msgspec.Struct, frozen=True, tag="progress"):
    """How far it is. fraction : 0 to 1 of this task"""

    stage: str
    fraction: float


class Done(msgspec.Struct, frozen=True, tag="done"):
    """It is finished; the files are in the task's folder."""

    summary: dict[str, Any]


class Failed(msgspec.Struct, frozen=True, tag="failed"):
    """It cannot be done. title, detail : one line each; hint : what to do; status : of HTTP, 422 when the input is at fault"""

    title: str
    detail: str
    hint: str = ""
    status: int = 422


Report = Progress | Done | Failed

PLAN_FILE = "plan.h5"
VIEW_FOLDER = "view"
PROGRAM_FOLDER = "program"
PROOF_FILE = "proof.json"
PICTURE_FILE = "proof.png"
REPORT_FILE = "proof.html"
SURFACE_FILE = "proof.surface"
MESH_FILE = "mesh.stl"
