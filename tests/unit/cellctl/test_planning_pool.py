"""A planning pool with real processes: whatever is killed, no request is lost, and what comes back is what this machine would have made."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio
import trimesh

from cellctl.planning.pool.near import Pool
from cellctl.planning.pool.order import CHUNK_BYTES
from cellctl.planning.pool.wire import PoolWire
from cellctl.planning.process import WorkerError, Workers
from cellctl.planning.task import Task
from tests.unit.cellctl import certificates
from tests.unit.cellctl.planning_house import House, inspection, is_alive, pool_house, until

pytestmark = pytest.mark.asyncio(loop_scope="module")
MEMORY_BYTES = 8 * 2**30


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def house(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[House]:
    async with pool_house(tmp_path_factory.mktemp("pool")) as made:
        made.start_scheduler()
        for name in ("left", "right"):
            made.start_machine(name)
        await made.machines_joined(2)
        yield made


@pytest.fixture
def box(tmp_path: Path) -> Path:
    path = tmp_path / "box.stl"
    trimesh.creation.box((12.0, 8.0, 2.0)).export(path)
    return path


def quiet(_stage: str, _share: float) -> None:
    pass


def contents(folder: str) -> dict[str, bytes]:
    root = Path(folder)
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("*") if path.is_file()}


async def test_task_on_another_machine_gives_the_same_bytes_in_pieces_that_were_checked(house: House, tmp_path: Path) -> None:
    ball = tmp_path / "ball.stl"
    trimesh.creation.icosphere(subdivisions=4, radius=20.0).export(ball, file_type="stl_ascii")
    here, there = inspection(ball, tmp_path / "here"), inspection(ball, tmp_path / "there")
    stages: list[str] = []
    summary = await Workers(tmp_path, MEMORY_BYTES).run(here, quiet)
    assert await house.pool.run(there, lambda stage, _: stages.append(stage)) == summary and contents(there.folder) == contents(here.folder)
    costs = house.pool.costs[-1]
    assert costs.sent_bytes == ball.stat().st_size > CHUNK_BYTES and costs.fetched_bytes == len(contents(there.folder)["mesh.stl"])
    assert stages == ["reading the mesh"] and costs.attempts == 1


@pytest.mark.slow
async def test_errors_come_back_in_their_words(house: House, tmp_path: Path) -> None:
    broken = tmp_path / "broken.stl"
    broken.write_bytes(b"solid of nothing")
    told = []
    for engine in (Workers(tmp_path, MEMORY_BYTES), house.pool):
        with pytest.raises(WorkerError) as caught:
            await engine.run(inspection(broken, tmp_path / type(engine).__name__), quiet)
        told.append(caught.value.failed)
    assert told[0].title == "The mesh cannot be used" and told[0].status == 422 and told[0].hint
    assert [told[1].title, told[1].hint, told[1].status] == [told[0].title, told[0].hint, told[0].status]
    assert told[1].detail.rpartition("/")[2] == told[0].detail.rpartition("/")[2]


async def test_machine_killed_in_the_middle_loses_no_request(house: House, box: Path, tmp_path: Path) -> None:
    task = inspection(box, tmp_path / "out")
    running = asyncio.create_task(house.pool.run(task, quiet))
    name, child = await house.stopped_in_the_middle()
    house.kill_machine(name)
    assert (await running)["facets"] == 12 and "mesh.stl" in contents(task.folder)
    await until(lambda: not is_alive(child), "the end of the task's process")


async def test_cancelled_task_ends_at_its_machine(house: House, box: Path, tmp_path: Path) -> None:
    running = asyncio.create_task(house.pool.run(inspection(box, tmp_path / "out"), quiet))
    name, child = await house.stopped_in_the_middle()
    running.cancel()
    await asyncio.wait({running})
    assert running.cancelled()
    await until(lambda: not is_alive(child), "the end of the task's process")
    assert house.machines[name].poll() is None
    await until(lambda: not list((house.folder / name / "scratch").glob("*/made")), "an empty scratch folder")


async def test_scheduler_killed_in_the_middle_and_started_again_loses_no_request(house: House, box: Path, tmp_path: Path) -> None:
    waited: list[str] = []
    running = asyncio.create_task(house.pool.run(inspection(box, tmp_path / "out"), quiet, waited.append))
    await house.stopped_in_the_middle()
    house.kill_scheduler()
    await until(lambda: waited and "cannot be reached" in waited[-1] and house.wire.address in waited[-1], "the reason")
    assert house.pool.places == 1 and not running.done()
    house.start_scheduler()
    assert (await running)["facets"] == 12 and waited[-1] == ""


async def test_task_that_kills_what_works_on_it_three_times_is_told_as_the_cause(house: House, box: Path, tmp_path: Path) -> None:
    task = inspection(box, tmp_path / "out")
    running = asyncio.create_task(house.pool.run(task, quiet))
    killed: set[int] = set()
    while not running.done():
        for _, child in house._busy():
            if child not in killed:
                os.kill(child, signal.SIGKILL)
                killed.add(child)
        await asyncio.sleep(0.01)
    with pytest.raises(WorkerError) as caught:
        await running
    assert len(killed) == 3 and caught.value.failed.title == "Its planning machines were lost"
    assert "begun 3 times" in caught.value.failed.detail and caught.value.failed.status == 503


@pytest.mark.slow
async def test_machine_with_other_software_is_told_and_gets_nothing(house: House, box: Path, tmp_path: Path) -> None:
    for name in list(house.machines):
        house.kill_machine(name)
    other = "f" * 64
    code = f"import cellctl.planning.pool.machine as machine, cellctl.cli; machine.software = lambda: '{other}'; cellctl.cli.main()"
    house.start_machine("stranger", code=code)
    waited: list[str] = []
    running = asyncio.create_task(house.pool.run(inspection(box, tmp_path / "out"), quiet, waited.append))
    await until(lambda: waited and "stranger" in waited[-1], "the reason")
    assert other[:12] in waited[-1] and "0.1.0" in waited[-1] and "install the same version" in waited[-1]
    house.start_machine("third")
    assert (await running)["facets"] == 12
    assert house.pool.costs[-1].machine == "third"
    house.kill_machine("stranger")


@pytest.mark.slow
async def test_plan_program_and_proof_are_those_of_this_machine(house: House, tmp_path: Path) -> None:
    from config.base import FACTS_DIR

    await until(lambda: house.pool.state.places >= 1, "a machine")
    mesh = tmp_path / "chip.stl"
    trimesh.creation.box((8.0, 8.0, 1.6)).export(mesh)
    cell = str(FACTS_DIR / "cells" / "trunnion_tcp.toml")
    made: list[list[tuple[Any, dict[str, bytes]]]] = []
    for engine in (Workers(tmp_path, MEMORY_BYTES), house.pool):
        root = tmp_path / type(engine).__name__
        root.mkdir()
        steps: list[dict[str, Any]] = [{"kind": "plan", "recipe_toml": "layer_height_mm = 0.8"}]
        steps += [{"kind": "post", "plan": f"{root}/plan/plan.h5"}, {"kind": "prove", "program": f"{root}/post/program"}]
        made.append([])
        for step in steps:
            folder = root / step["kind"]
            folder.mkdir()
            task = Task(folder=str(folder), parent=0, memory_bytes=0, part_name="chip", mesh=str(mesh), cell=cell, **step)
            made[-1].append((await engine.run(task, quiet), contents(task.folder)))
    assert made[0] == made[1]


@pytest.mark.slow
async def test_service_with_another_certificate_stays_outside(house: House, tmp_path: Path) -> None:
    await until(lambda: house.pool.state.places >= 1, "a machine")
    cert, key = certificates.make(tmp_path, "stranger")
    (tmp_path / "files").mkdir()
    stranger = Pool(PoolWire(house.wire.address, cert, key), tmp_path / "files", tmp_path, "0.1.0")
    keeping = asyncio.create_task(stranger.keep())
    try:
        await until(lambda: "cannot be reached" in stranger.state.why, "the refusal")
        assert stranger.state.machines == 0 and house.pool.state.places >= 1
    finally:
        keeping.cancel()
        await asyncio.gather(keeping, return_exceptions=True)
