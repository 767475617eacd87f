from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
import trimesh

from cellctl.planning.jobwork import proof_summary
from cellctl.planning.process import WorkerError, Workers
from cellctl.planning.task import Task
from config.base import FACTS_DIR

CELLS = FACTS_DIR / "cells"


def said(_stage: str, _fraction: float) -> None:
    pass


async def test_worker_that_needs_too_much_memory_fails_with_the_reason(tmp_path: Path, block: Path) -> None:
    workers = Workers(tmp_path, 200 * 2**20)
    with pytest.raises(WorkerError) as caught:
        await workers.run(
            Task(kind="inspect", folder=str(tmp_path), parent=0, memory_bytes=0, part_name="block", mesh=str(block)),
            said,
        )
    assert caught.value.failed.detail and "\n" not in caught.value.failed.detail
    assert not list(tmp_path.glob("mesh.stl"))


async def test_errors_of_the_planner_come_back_in_its_words(tmp_path: Path, block: Path) -> None:
    workers = Workers(tmp_path, 8 * 2**30)
    task = Task(
        kind="plan",
        folder=str(tmp_path),
        parent=0,
        memory_bytes=0,
        part_name="block",
        mesh=str(block),
        recipe_toml="colour = 1",
    )
    with pytest.raises(WorkerError) as caught:
        await workers.run(task, said)
    assert (
        caught.value.failed.title == "The recipe cannot be used" and "colour: unknown key" in caught.value.failed.detail
    )
    assert caught.value.failed.status == 422 and caught.value.failed.hint


def test_proof_is_summed_up_by_its_figures() -> None:
    document = {
        "passed": True,
        "deviation": {"p99_mm": 0.1},
        "findings": [{"severity": "error"}, {"severity": "warning"}],
        "reasons": [],
    }
    assert proof_summary(document) == {"passed": True, "p99_mm": 0.1, "findings": {"error": 1, "warning": 1}}


async def test_part_larger_than_the_build_volume_is_refused_before_time_goes_into_its_plan(tmp_path: Path) -> None:
    mesh = tmp_path / "plate.stl"
    trimesh.creation.box((450.0, 60.0, 30.0)).export(mesh)
    task = Task(
        kind="plan", folder=str(tmp_path), parent=0, memory_bytes=0, part_name="plate", mesh=str(mesh), cell=str(CELLS / "trunnion_tcp.toml")
    )
    stages: list[str] = []
    with pytest.raises(WorkerError) as caught:
        await Workers(tmp_path, 8 * 2**30).run(task, lambda stage, _: stages.append(stage))
    assert "450.0 mm in X" in caught.value.failed.detail and "build volume 200.0 mm" in caught.value.failed.detail
    assert caught.value.failed.hint and "toolpaths" not in stages


@pytest.mark.parametrize("cancellations", [1, 2, 3])
async def test_request_cancelled_while_its_worker_starts_leaves_no_process_and_no_pipe(
    tmp_path: Path, block: Path, cancellations: int
) -> None:
    task = Task(kind="inspect", folder=str(tmp_path), parent=0, memory_bytes=0, part_name="block", mesh=str(block))
    open_files = len(list(Path("/proc/self/fd").iterdir()))
    for turns in range(6):
        running = asyncio.create_task(Workers(tmp_path, 2**30).run(task, said))
        for _ in range(turns):
            await asyncio.sleep(0)
        for _ in range(cancellations):
            running.cancel()
            await asyncio.sleep(0)
        with pytest.raises(asyncio.CancelledError):
            await running
    assert len(list(Path("/proc/self/fd").iterdir())) == open_files
    children = [path.read_text() for path in Path("/proc/self/task").glob("*/children")]
    workers = [pid for pid in " ".join(children).split() if b"cellctl.planning.worker" in Path(f"/proc/{pid}/cmdline").read_bytes()]
    assert not workers and not list(tmp_path.glob("mesh.stl"))
