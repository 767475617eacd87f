"""The service as its users have it: `cellctl serve` and a simulated cell as processes, driven over REST, killed here and there."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
import tomli_w
import trimesh

from cellctl.client import Client, ServiceError
from cellctl.demo import ask_sim, to_be_simulated
from config import load_cell

pytestmark = pytest.mark.timeout(1500)
START_S = 120.0
PLANNED_S = 600.0  # plan, post and proof by workers that give way to whatever else the machine does
DONE_S = 300.0
END_S = 60.0
POLL_S = 0.05


@dataclass
class Plant:
    """Simulated cell and service. `folder` holds run directory, store and logs"""

    folder: Path
    client: Client
    service: subprocess.Popen[bytes]
    stop_url: str

    def sim(self, do: str, **fields: Any) -> dict[str, Any]:
        return ask_sim(self.folder / "run" / "sim.sock", {"do": do, **fields})

    def process(self, module: str) -> int:
        """Process id of the service's process that runs a module."""
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                parent = int(stat.read_text().rpartition(")")[2].split()[1])
                words = (stat.parent / "cmdline").read_bytes().split(b"\0")
            except OSError:
                continue
            if parent == self.service.pid and module.encode() in words:
                return int(stat.parent.name)
        raise AssertionError(f"no process runs {module}")

    def state(self, job_id: str) -> str:
        return str(self.client.job(job_id)["state"])


def until(is_so: Callable[[], Any], seconds: float = START_S) -> Any:
    """What `is_so` gives once it is true; refusals of a service on its way up count as not yet."""
    end = time.monotonic() + seconds
    while True:
        try:
            if found := is_so():
                return found
        except ServiceError:
            pass
        assert time.monotonic() < end, "it did not come about in time"
        time.sleep(POLL_S)


@contextmanager
def served_plant(time_scale: float) -> Iterator[Plant]:
    """A simulated cell and its service, each its own process, ended afterwards."""
    folder = Path(tempfile.mkdtemp(prefix="cellctl-rest-"))  # short: sockets have names of at most 107 bytes
    children = []
    try:
        given = folder / "cell.toml"
        given.write_text(tomli_w.dumps(to_be_simulated(load_cell("trunnion_tcp"))))
        run = folder / "run"
        children.append(
            spawn(folder, "sim", ["-m", "sim", "--cell", str(given), "--run", str(run), "--time-scale", f"{time_scale:g}"])
        )
        until(lambda: (run / "sim.sock").exists() and (run / "cell.toml").exists())
        words = [
            "--cell",
            str(run / "cell.toml"),
            "--store",
            str(folder / "store"),
            "--run",
            str(run),
            "--port",
            "0",
            "--stop-port",
            "0",
        ]
        children.append(spawn(folder, "serve", ["-m", "cellctl", "serve", *words]))
        address = json.loads(until(lambda: (run / "service.json").exists() and (run / "service.json").read_text()))
        made = subprocess.run(
            [sys.executable, "-m", "cellctl", "token", "create", "tester", "--role", "engineer", "--store", str(folder / "store")],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        with Client(address["url"], made.stdout.strip()) as client:
            until(lambda: client.snapshot()["state"] == "IDLE")
            yield Plant(folder, client, children[-1], address["stop_url"])
    finally:
        for child in reversed(children):
            child.terminate()
            child.wait(END_S)
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="module")
def plant() -> Iterator[Plant]:
    with served_plant(20.0) as one:
        yield one


def spawn(folder: Path, name: str, words: list[str]) -> subprocess.Popen[bytes]:
    with (folder / f"{name}.log").open("wb") as log:
        return subprocess.Popen([sys.executable, *words], stdin=subprocess.DEVNULL, stdout=log, stderr=log)


@pytest.fixture(scope="module")
def part_id(plant: Plant) -> str:
    path = plant.folder / "block.stl"
    trimesh.creation.box((12.0, 8.0, 1.6)).export(path)
    return str(plant.client.upload(path)["id"])


def approved(plant: Plant, part_id: str, **recipe: Any) -> str:
    """A job that is proved, approved (overridden where the proof wants more) and on a table that is clear."""
    job = plant.client.submit(part_id, recipe={"process": "deposit", "tolerance_mm": 0.5, "cusp_mm": 0.2, **recipe})
    waiting = until(
        lambda: plant.state(job["id"]) in ("waiting_for_approval", "failed") and plant.client.job(job["id"]), PLANNED_S
    )
    assert waiting["state"] == "waiting_for_approval", waiting["error"]
    plant.client.approve(job["id"], because="test", override_reason="test piece", table_clear=True)
    return str(job["id"])


def is_running(plant: Plant, job_id: str, lines: int = 5) -> bool:
    snapshot = plant.client.snapshot()
    return snapshot["job"] is not None and snapshot["job"]["id"] == job_id and snapshot["lines"]["executed"] >= lines


def test_web_process_killed_during_a_run_does_not_disturb_it(plant: Plant, part_id: str) -> None:
    job_id = approved(plant, part_id)
    until(lambda: is_running(plant, job_id))
    before = plant.sim("state")["cnc"]["line"]
    web = plant.process("cellctl.api")
    os.kill(web, signal.SIGKILL)
    until(lambda: plant.sim("state")["cnc"]["line"] not in (before, 0) or plant.state(job_id) == "completed")
    until(lambda: plant.client.request("GET", "/healthz").status_code == 200)
    assert plant.process("cellctl.api") != web
    assert (
        until(lambda: plant.state(job_id) in ("completed", "failed", "held") and plant.state(job_id), DONE_S)
        == "completed"
    )
    events = plant.client.get("cell/events", limit=200, job=job_id)["items"]
    numbers = [event["seq"] for event in events]
    assert numbers == sorted(numbers, reverse=True) and len(set(numbers)) == len(numbers)
    record = plant.client.record(job_id)
    assert record["run"]["outcome"] == "completed" and record["run"]["last_line"] == record["run"]["total_lines"]
    assert any(row["laser_readback_max_w"] > 100.0 for row in record["layers"])


def test_cell_process_killed_during_a_run_leaves_an_interrupted_job_and_a_dark_laser(
    plant: Plant, part_id: str
) -> None:
    job_id = approved(plant, part_id)
    until(lambda: is_running(plant, job_id) and plant.sim("state")["laser"]["emission_w"] > 0.0)
    cell = plant.process("cellctl.cell")
    os.kill(cell, signal.SIGKILL)
    until(
        lambda: (
            plant.sim("state")["laser"]["emission_w"] == 0.0 and plant.sim("state")["feeder"]["rate_setpoint"] == 0.0
        ),
        10.0,
    )
    job = until(lambda: plant.state(job_id) == "interrupted" and plant.client.job(job_id))
    assert 0 < job["lines_executed"] < job["lines_total"] and f"line {job['lines_executed']}" in job["why"]
    assert plant.process("cellctl.cell") != cell
    until(lambda: plant.client.snapshot()["state"] in ("FAULT", "STOPPED", "IDLE", "UNHOMED"))
    recover(plant)


def recover(plant: Plant) -> None:
    """Bring the cell back to IDLE as an operator would."""

    def step() -> bool:
        state = plant.client.snapshot()["state"]
        verb = {"FAULT": "reset", "STOPPED": "reset", "UNHOMED": "home", "HELD": "abort"}.get(state)
        if verb is not None:
            plant.client.command(verb, "test")
        return bool(state == "IDLE")

    until(step)


def test_stop_over_the_listener_stops_without_sign_in(plant: Plant, part_id: str) -> None:
    job_id = approved(plant, part_id)
    until(lambda: is_running(plant, job_id))
    answer = httpx.post(plant.stop_url, json={"id": "1", "because": "test"}, trust_env=False)
    assert answer.json()["state"] == "STOPPED"
    until(lambda: plant.sim("state")["laser"]["emission_w"] == 0.0, 5.0)
    with pytest.raises(ServiceError) as refused:
        plant.client.command("resume", "test")
    assert refused.value.status == 409 and refused.value.hint
    recover(plant)
    assert plant.state(job_id) in ("aborted", "interrupted", "failed")


def test_job_waits_until_the_table_is_confirmed_clear(plant: Plant, part_id: str) -> None:
    job = plant.client.submit(part_id, recipe={"process": "deposit", "tolerance_mm": 0.5, "cusp_mm": 0.2})
    until(lambda: plant.state(job["id"]) == "waiting_for_approval", PLANNED_S)
    plant.client.approve(job["id"], override_reason="test piece")
    with pytest.raises(ServiceError) as refused:
        plant.client.command("start", "test", job=job["id"])
    assert refused.value.status == 409 and "table is clear" in refused.value.message
    assert plant.state(job["id"]) == "queued" and plant.client.snapshot()["state"] == "IDLE"
    assert plant.client.command("start", "test", job=job["id"], table_clear=True)["ok"]
    until(lambda: is_running(plant, job["id"]))
    plant.client.command("abort", "test")
    until(lambda: plant.state(job["id"]) == "aborted")
    recover(plant)


def test_service_that_ends_leaves_no_socket_and_no_port(plant: Plant) -> None:
    plant.service.terminate()
    assert plant.service.wait(END_S) == 0
    assert not (plant.folder / "run" / "cell.sock").exists()
    url = httpx.URL(plant.client.url)
    with socket.socket() as probe:
        assert probe.connect_ex((url.host, url.port or 0)) != 0
