"""A job in the store whose run on the cell was interrupted, as planner worker and cell process would have left it."""

from __future__ import annotations

import hashlib
import json
import shutil
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
import trimesh

import planner
from cellctl.cell.program_form import form_beside, write_form
from cellctl.domain.jobs import JobState
from cellctl.planning.view import write_layer, write_overview
from cellctl.store import Store, blobs, jobs, parts
from cellctl.store.ids import new_id
from cellctl.store.jobs import JobRow
from cellctl.store.parts import Inspection, PartRow
from config import Cell
from planner.files import write_plan, write_program
from planner.mesh import load
from planner.program import LineKind, Program
from planner.recipe import Recipe

MESH_SHA256 = "0" * 64
RECIPE: dict[str, Any] = {"process": "deposit", "tolerance_mm": 0.5}


@dataclass(frozen=True)
class Posted:
    """Files of a part, planned and posted for a cell."""

    mesh: Path
    plan: Path
    view: Path
    program: Path
    posted: Program
    layers: int
    recipe: dict[str, Any]


def wall_in(folder: Path, cell: Cell) -> Posted:
    """Two beads on each other, planned and posted; the files go into the folder."""
    return box_in(folder, cell, (8.0, 2.4, 1.6), RECIPE)


def box_in(folder: Path, cell: Cell, size_mm: tuple[float, float, float], recipe: dict[str, Any]) -> Posted:
    """A box, planned and posted; the files go into the folder."""
    mesh = folder / "wall.stl"
    trimesh.creation.box(size_mm).export(mesh)
    plan = planner.plan(load(mesh, "mm"), Recipe(**recipe))
    program = planner.post(plan, cell)
    view = folder / "view"
    view.mkdir()
    for number, layer in enumerate(plan.layers):
        write_layer(layer, number, view)
    write_overview(plan, view)
    write_plan(plan, folder / "plan.h5")
    write_program(program, folder / "program")
    digest = hashlib.sha256((folder / "program" / "program.json").read_bytes()).hexdigest()
    write_form(program, cell, form_beside(folder / "program"), digest)
    return Posted(mesh, folder / "plan.h5", view, folder / "program", program, len(plan.layers), recipe)


def bead_of(program: Program, layer: int = 0) -> int:
    """Index of the longest line of a layer on which metal is laid."""
    table = program.table
    way = np.where((table["layer"] == layer) & (table["kind"] == LineKind.PROCESS), table["arc_end_mm"] - table["arc_start_mm"], 0.0)
    return int(np.argmax(way))


def interrupted_job(store: Store, made: Posted, line: int, fraction: float = 0.5, name: str = "wall") -> str:
    """A job of the wall that was interrupted with light on a line; its id."""
    data = made.mesh.read_bytes()
    sha256 = hashlib.sha256(data).hexdigest()
    store.blobs.part(sha256, ".stl").write_bytes(data)
    store.blobs.mesh(MESH_SHA256).write_bytes(data)
    plan_sha256, program_sha256 = blobs.sha256_of(made.plan), blobs.sha256_of(made.program / "program.json")
    if not store.blobs.program(program_sha256).exists():
        shutil.copy(made.plan, store.blobs.plan(plan_sha256))
        shutil.copytree(made.view, store.blobs.view(plan_sha256))
        shutil.copytree(made.program, store.blobs.program(program_sha256))
        shutil.copytree(form_beside(made.program), form_beside(store.blobs.program(program_sha256)))
    now = store.clock()
    inspection = Inspection(MESH_SHA256, [[-4, -1.2, -0.8], [4, 1.2, 0.8]], 12, 30.72, [])
    part = PartRow(new_id("part", now), name, ".stl", "mm", sha256, len(data), now, "me", inspection)
    toml = tomli_w.dumps(Recipe(**made.recipe).model_dump(mode="json", exclude_none=True))
    row = JobRow(
        new_id("job", now), name, part.id, made.posted.cell_name, toml, "316L", now, "me", JobState.INTERRUPTED, plan_sha256=plan_sha256,
        program_sha256=program_sha256, layers=made.layers, lines_total=len(made.posted.lines), lines_executed=line, approved_by="me",
    )  # fmt: skip
    with store.write() as rows:
        parts.add(rows, part)
        jobs.add(rows, row)
    ran(store, row.id, program_sha256, "interrupted", line, fraction, len(made.posted.lines))
    return row.id


def ran(store: Store, job: str, program_sha256: str, outcome: str, line: int, fraction: float, total: int, name: str = "") -> None:
    """What the cell process writes of a run that has ended."""
    place = {"line": line, "fraction": fraction, "arc_mm": 0.0}
    told = {"outcome": outcome, "last_line": line, "total_lines": total, "place": place, "metal_end": place, "known_by": "tick"}
    now = store.clock()
    with closing(sqlite3.connect(store.folder / "store.db")) as db, db:
        db.execute(
            "INSERT INTO cell_runs (job, name, program_sha256, started_at, ended_at, outcome, last_line, total_lines, command_id)"
            " VALUES (?,?,?,?,?,?,?,?,?)",
            (job, name or job, program_sha256, now, now, outcome, line, total, f"start-{job}"),
        )
        db.execute(
            "INSERT INTO events (at, kind, text, job, data) VALUES (?, 'job', ?, ?, ?)", (now, f"{job}: {outcome}", job, json.dumps(told))
        )
