"""Three whole cells on one PostgreSQL: services, cell processes and simulated plants; one host is killed with a job running and others waiting."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import trimesh
from sqlalchemy import URL

from cellctl.client import Client, ServiceError
from cellctl.domain.fleet import DEAD_S
from cellctl.store import open_store, tokens
from cellctl.store.tokens import Role
from tests.console.running_cell import RunningCell

CELLS = ("alpha", "beta", "gamma")
RECIPE = {"process": "deposit", "build_direction": [0.0, 0.0, 1.0], "layer_height_mm": 1.0, "interpass_s": 0.0, "tolerance_mm": 2.0}
SLOW = {**RECIPE, "interpass_s": 60.0}
PATIENCE_S = 600.0  # nine workers on two cores
LOOK_S = 0.2
BUSY = 409


class FleetCell(RunningCell):
    """A cell of its own name whose service works on a database and files of all."""

    def __init__(self, name: str, database: URL, files: Path) -> None:
        super().__init__()
        self.name = name
        told = self.folder / "database"
        told.write_text(database.render_as_string(hide_password=False), encoding="utf-8")
        self.shares = ("--shared-database", f"@{told}", "--shared-files", str(files))

    def _cell_file(self) -> Path:
        path = super()._cell_file()
        path.write_text(path.read_text(encoding="utf-8").replace('name = "trunnion-tcp"', f'name = "{self.name}"'), encoding="utf-8")
        return path

    @property
    def cpu_s(self) -> float:
        """Processor time of its processes so far, s."""
        return sum(_cpu_s(child.pid) for child in self._children)

    def kill(self) -> None:
        """Host down: the service, its web process, planner workers and cell process get no word in; the machine stays as it is."""
        service = self._children.pop()
        for process in (service.pid, *_offspring(service.pid)):
            os.kill(process, signal.SIGKILL)
        service.communicate()

    def come_back(self) -> None:
        """The service again, on the same store."""
        self._serve()


def _offspring(parent: int) -> list[int]:
    found: list[int] = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(words[1]) == parent:
            found += [int(stat.parent.name), *_offspring(int(stat.parent.name))]
    return found


def _cpu_s(process: int) -> float:
    total = 0.0
    for one in (process, *_offspring(process)):
        try:
            words = Path(f"/proc/{one}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        total += sum(map(int, words[11:15])) / os.sysconf("SC_CLK_TCK")
    return total


@pytest.fixture
def cells(database: URL, tmp_path: Path) -> Iterator[dict[str, FleetCell]]:
    with ExitStack() as running:
        yield {name: running.enter_context(FleetCell(name, database, tmp_path / "files")) for name in CELLS}


def engineers_token(cell: FleetCell) -> str:
    """Of somebody who may approve what a coarse proof refuses; valid at every host of the house."""
    store = open_store(cell.store)
    try:
        with store.write() as rows:
            return tokens.create(rows, "an engineer", Role.ENGINEER, store.clock())[1]
    finally:
        store.close()


def until(client: Client, job: str, holds: Callable[[Any], bool]) -> Any:
    """The job, once something holds of it."""
    end = time.monotonic() + PATIENCE_S
    while not holds(shown := client.job(job)):
        life = [f"{one['state']}: {one['why']}" for one in client.get(f"jobs/{job}/life")["items"]]
        assert time.monotonic() < end, f"{shown['state']} at {shown['cell']!r}, {shown['why']}, {shown['error']}; {life}"
        time.sleep(LOOK_S)
    return shown


def settled(client: Client, job: str) -> Any:
    """The job, planned, posted and proven; approved whatever the coarse proof says."""
    shown = until(client, job, lambda job: job["state"] in ("waiting_for_approval", "failed"))
    assert shown["state"] == "waiting_for_approval", shown["error"]
    return shown


def build(cell: FleetCell, client: Client, job: str) -> None:
    """Approve at the job's own cell, and see that it runs."""
    end = time.monotonic() + PATIENCE_S
    while True:
        try:
            client.approve(job, override_reason="a coarse part of a test", table_clear=True)
            break
        except ServiceError as refusal:
            if refusal.status != BUSY:  # the table is taken by the job before it
                raise
            assert time.monotonic() < end, str(refusal)
            time.sleep(LOOK_S)


@pytest.mark.slow
def test_what_waits_at_a_killed_host_is_made_elsewhere_and_what_ran_there_stays_and_goes_on(cells: dict[str, FleetCell], tmp_path: Path) -> None:
    began = time.monotonic()
    mesh = tmp_path / "tile.stl"
    trimesh.creation.box((8.0, 6.0, 2.0)).export(mesh)
    with ExitStack() as stack:
        token = engineers_token(cells["alpha"])
        clients = {name: stack.enter_context(Client(cell.url, token)) for name, cell in cells.items()}
        alpha, beta = clients["alpha"], clients["beta"]
        for cell in cells.values():
            cell.make_ready_with(clients[cell.name])
        part = alpha.upload(mesh, "mm")["id"]

        running = alpha.submit(part, recipe=SLOW, cell="beta")["id"]
        settled(alpha, running)
        build(cells["beta"], beta, running)
        until(alpha, running, lambda job: job["state"] == "running" and job["lines_executed"] > 0)

        anywhere = [alpha.submit(part, recipe=RECIPE, cell="any")["id"] for _ in range(4)]
        named = alpha.submit(part, recipe=RECIPE, cell="beta")["id"]
        places = {job: until(alpha, job, lambda job: job["cell"])["cell"] for job in anywhere}
        assert "beta" in places.values() and len(set(places.values())) == 3
        for job in anywhere:
            if places[job] == "beta":
                settled(alpha, job)  # it waits there, proven
        cells["beta"].kill()
        time_of_death = time.monotonic()

        for job in (job for job in anywhere if places[job] == "beta"):
            until(alpha, job, lambda job: job["cell"] not in ("", "beta"))
            assert time.monotonic() - time_of_death > DEAD_S - 10.0
        stays = until(alpha, running, lambda job: "has not been heard" in job["why"])
        assert stays["cell"] == "beta" and stays["state"] in ("running", "held") and stays["why"].endswith("its part lies on that table")
        assert alpha.job(named)["cell"] == "beta"

        for job in anywhere:
            at = settled(alpha, job)["cell"]
            assert at in ("alpha", "gamma")
            build(cells[at], clients[at], job)
            until(alpha, job, lambda job: job["state"] == "completed")
            starts = [one for one in alpha.get(f"jobs/{job}/life")["items"] if one["state"] == "running"]
            assert len(starts) == 1

        cells["beta"].come_back()
        clients["beta"] = stack.enter_context(Client(cells["beta"].url, token))
        back = until(alpha, running, lambda job: job["state"] == "interrupted")
        assert back["cell"] == "beta" and "heard" not in back["why"]
        rest = clients["beta"].go_on(running)
        assert (rest["cell"], rest["cell_wanted"], rest["continues_job"]) == ("beta", "beta", running)
        assert settled(alpha, named)["cell"] == "beta"
        cpu_s = sum(cell.cpu_s for cell in cells.values())
    print(f"three cells: {time.monotonic() - began:.0f} s, {cpu_s:.0f} s of processors in the services that stand at the end")
