"""From a kill -9 in a pass to the finished part, as an operator has it: over REST, every process its own, the plant as witness."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import trimesh

from config import load_cell
from config.material import load_material
from planner.files import read_program
from planner.mesh import load
from sim.as_built import read_field
from sim.compare import difference
from sim.dryrun import DryRun
from sim.process.field import Field
from sim.process.stock import Stock
from sim.standing import stock_after
from tests.cell.test_rest import DONE_S, PLANNED_S, Plant, recover, served_plant, until

pytestmark = pytest.mark.timeout(900)
TIME_SCALE = 4.0
SIZE_MM = (20.0, 4.0, 0.8)
CELL_MM = 0.2
CREST_MM = 1.1  # of one bead
CUTTER = 2
LIT_W = 400.0
DARK_W = 1.0
STANDING_MM_S = 1e-6
LOOK_S = 0.01


@dataclass
class Witness:
    """Looks at the plant all the time. standing_w : most light while the tip stood"""

    plant: Plant
    standing_w: float = 0.0
    looks: int = 0
    _ends: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> Witness:
        self._thread = threading.Thread(target=self._look)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()

    def _look(self) -> None:
        while not self._ends.wait(LOOK_S):
            seen = self.plant.sim("state")
            self.looks += 1
            if seen["tip_speed_mm_s"] < STANDING_MM_S:
                self.standing_w = max(self.standing_w, seen["laser"]["emission_w"])


@pytest.fixture
def plant() -> Iterator[Plant]:
    with served_plant(TIME_SCALE) as one:
        yield one


def proven(plant: Plant, job_id: str) -> dict[str, Any]:
    """The job, once it waits for a person, with a proof that it passed."""
    job = until(lambda: plant.state(job_id) in ("waiting_for_approval", "failed") and plant.client.job(job_id), PLANNED_S)
    assert job["state"] == "waiting_for_approval", job["error"]
    assert job["proof"]["passed"] and job["proof"]["findings"] == {}, job["proof"]
    return dict(job)


def submitted(plant: Plant) -> dict[str, Any]:
    """A bar of one layer that is milled, proven, and a plate clamped for it."""
    path = plant.folder / "bar.stl"
    trimesh.creation.box(SIZE_MM).export(path)
    part = plant.client.upload(path)
    job = plant.client.submit(part["id"], recipe={"process": "hybrid", "tolerance_mm": 0.5}, name="bar")
    job = proven(plant, job["id"])
    frame = plant.client.get(f"jobs/{job['id']}/plan")["build_from_part"]
    plant.sim("workpiece", mesh=str(path), build_from_part=frame, material=job["material"], cell_mm=CELL_MM)
    return job


def keep_going(plant: Plant) -> None:
    """A busy machine that kept the plant waiting has the job held: reset and let go on, as an operator would."""
    state = plant.client.snapshot()["state"]
    if state in ("FAULT", "HELD"):
        plant.client.command("reset" if state == "FAULT" else "resume", "test")


def killed_in_a_pass(plant: Plant, job_id: str) -> None:
    """The cell process ends with light on the part, and another one is there by itself."""

    def is_lit() -> bool:
        seen = plant.sim("state")
        if seen["laser"]["emission_w"] > LIT_W and seen["tip_speed_mm_s"] > STANDING_MM_S:
            return True
        keep_going(plant)
        return False

    until(is_lit, DONE_S)
    cell = plant.process("cellctl.cell")
    os.kill(cell, signal.SIGKILL)
    until(lambda: plant.state(job_id) == "interrupted")
    assert plant.process("cellctl.cell") != cell


def is_done(plant: Plant, job_id: str) -> bool:
    """Whether the job is completed; it is kept going otherwise."""
    keep_going(plant)
    return plant.state(job_id) == "completed"


def laid(plant: Plant, job_id: str, folder: Path) -> Field:
    """The metal at the plant when all beads are laid and none is cut: the job is held behind the change to the cutter."""

    def has_cutter() -> bool:
        keep_going(plant)
        return bool(plant.sim("state")["cnc"]["tool"] == CUTTER)

    until(has_cutter, DONE_S)
    plant.client.command("hold", "to measure what was laid")
    until(lambda: plant.client.snapshot()["state"] in ("HELD", "FAULT"))
    plant.sim("as_built", dir=str(folder), name="bar", tolerance_mm=0.5, field=True)
    until(lambda: plant.state(job_id) == "held")
    return read_field(folder / "as_built.npz")


def laid_in_one_go(plant: Plant, job: dict[str, Any]) -> Stock:
    """The same of the first program, uninterrupted, in the twin."""
    program = read_program(plant.folder / "store" / "blobs" / "programs" / job["program_sha256"])
    cell, mesh = load_cell(str(plant.folder / "run" / "cell.toml")), load(plant.folder / "bar.stl", "mm")
    change = next(k for k, text in enumerate(program.lines) if f"M6 T{CUTTER}" in text)
    state = stock_after(program, cell, mesh, change, 1.0, cell_mm=CELL_MM)
    return DryRun(program, cell, mesh, load_material("316L"), None, CELL_MM, state).stock


def commands(plant: Plant) -> list[dict[str, Any]]:
    """Commands to the cell as they are in the record."""
    with closing(sqlite3.connect(plant.folder / "store" / "store.db")) as db:
        return [json.loads(data) for (data,) in db.execute("SELECT data FROM events WHERE kind = 'command' ORDER BY seq")]


def test_part_whose_cell_was_killed_in_a_pass_is_finished_over_rest_and_equals_the_uninterrupted_one(plant: Plant, tmp_path: Path) -> None:
    client = plant.client
    first = submitted(plant)
    with Witness(plant) as witness:
        client.approve(first["id"], because="test", table_clear=True)
        killed_in_a_pass(plant, first["id"])
        point = client.resumption_point(first["id"])
        end = point["metal_end"]
        assert point["possible"] and end["known_by"] == "tick" and "layer 1 of 1, deposit" in end["text"]
        recover(plant)
        rest = proven(plant, client.go_on(first["id"], because="power came back")["id"])
        assert rest["continues_job"] == first["id"] and rest["resumption"]["operation"] == end["operation"]
        assert "(resumes " in client.program_head(rest["id"])["lines"][0]
        client.approve(rest["id"], because="test", part_untouched=True)
        beads = laid(plant, rest["id"], tmp_path)
        until(lambda: is_done(plant, rest["id"]), DONE_S)
    assert witness.looks > 100 and witness.standing_w < DARK_W
    apart, overlap_mm = difference(beads, laid_in_one_go(plant, first)), rest["resumption"]["overlap_mm"]
    assert apart.max_mm < CREST_MM and 0.0 < apart.volume_mm3 < overlap_mm * 2.4 * CREST_MM, apart
    assert plant.sim("as_built", dir=str(tmp_path), name="bar", tolerance_mm=0.5)["passed"]
    asked = commands(plant)
    assert max(Counter(command["id"] for command in asked).values()) == 1
    started = [command["reply"]["data"]["job"] for command in asked if command["verb"] == "start" and command["reply"]["ok"]]
    assert started == [first["id"], rest["id"]]
    assert [client.job(job["id"])["state"] for job in (first, rest)] == ["interrupted", "completed"]
