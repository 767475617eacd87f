"""A simulated cell and the service before it, as processes of their own, for the page to talk to."""

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
import tomllib
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import tomli_w

from cellctl.client import Client, ServiceError
from cellctl.domain.jobs import ENDED, JobState
from config.base import FACTS_DIR

END_S = 60.0
ANSWER_S = 60.0
KNOWN_S = 180.0  # until the cell stands ready, whatever a test did to it
POLL_S = 0.1
READY = ("sim ready", "Ctrl-C stops the service")
# The browser draws in software on the same cores: a device may be late here without being dead.
PATIENCE = {"timeout_s": 1.0, "dead_man_s": 3.0, "stale_s": 2.5, "status_stale_s": 2.0}
TIME_SCALE = 4.0
# What brings the cell a step nearer to IDLE; in states that are not here it gets there by itself.
NEXT_VERB = {
    "FAULT": "reset", "STOPPED": "reset", "UNHOMED": "home", "HELD": "abort", "HOLDING": "abort", "PREPARING": "abort",
    "RUNNING": "abort", "RESUMING": "abort", "JOGGING": "hold", "PURGING": "hold",
}  # fmt: skip


def patient(table: Any) -> Any:
    """A device's facts with every limit of time at least as long as PATIENCE says."""
    if isinstance(table, list):
        return [patient(item) for item in table]
    if not isinstance(table, dict):
        return table
    longer = {name: max(value, PATIENCE[name]) for name, value in table.items() if name in PATIENCE}
    return {**{name: patient(value) for name, value in table.items()}, **longer}


class RunningCell:
    """`python -m sim` and `cellctl serve` in a directory of their own. Use as a context manager."""

    def __init__(self, **simulation: Any) -> None:
        """simulation : facts of the simulated plant beside the shipped cell file's"""
        self._simulation = simulation
        self.shares: tuple[str, ...] = ()
        self.folder = Path(tempfile.mkdtemp(prefix="console-"))
        self.run = self.folder / "run"
        self.url = ""
        self.stop_url = ""
        self._children: list[subprocess.Popen[str]] = []

    def __enter__(self) -> RunningCell:
        with ExitStack() as undo:
            undo.callback(self.__exit__)
            given = str(self._cell_file())
            self._start("sim", "--cell", given, "--run", str(self.run), "--time-scale", str(TIME_SCALE))
            self._serve()
            undo.pop_all()
        return self

    def _serve(self) -> None:
        words = ("--cell", str(self.run / "cell.toml"), "--store", str(self.store), "--run", str(self.run), *self.shares)
        self._start("cellctl", "serve", *words, "--port", "0", "--stop-port", "0")
        address = json.loads((self.run / "service.json").read_text(encoding="utf-8"))
        self.url, self.stop_url = address["url"], address["stop_url"]

    def __exit__(self, *_error: object) -> None:
        for child in reversed(self._children):
            child.send_signal(signal.SIGTERM)
        for child in reversed(self._children):
            try:
                child.communicate(timeout=END_S)
            except subprocess.TimeoutExpired:
                child.kill()
                child.communicate()
        shutil.rmtree(self.folder, ignore_errors=True)

    @property
    def store(self) -> Path:
        return self.folder / "store"

    @property
    def token(self) -> str:
        return (self.store / "operator.token").read_text(encoding="ascii").strip()

    def _cell_file(self) -> Path:
        facts = tomllib.loads((FACTS_DIR / "cells" / "trunnion_tcp.toml").read_text(encoding="utf-8"))
        for link in facts["links"].values():
            device = tomllib.loads((FACTS_DIR / "devices" / f"{link['device']}.toml").read_text(encoding="utf-8"))
            path = self.folder / f"{link['device']}.toml"
            path.write_text(tomli_w.dumps(patient(device)), encoding="utf-8")
            link.update(device=str(path), tcp_port=0)
        facts = patient(facts)
        facts["simulation"] = {**facts.get("simulation", {}), **self._simulation}
        path = self.folder / "given.toml"
        path.write_text(tomli_w.dumps(facts), encoding="utf-8")
        return path

    def _start(self, module: str, *words: str) -> None:
        """Start a process and read what it says until it is ready."""
        child = subprocess.Popen(
            [sys.executable, "-u", "-m", module, *words],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        self._children.append(child)
        assert child.stdout is not None
        said: list[str] = []
        while not any(word in "".join(said) for word in READY):
            line = child.stdout.readline()
            assert line, f"{module} ended: {''.join(said)}"
            said.append(line)

    def sim(self, do: str, **arguments: Any) -> dict[str, Any]:
        """A hand at the simulated cell."""
        with socket.socket(socket.AF_UNIX) as wire, wire.makefile("rw") as lines:
            wire.settimeout(ANSWER_S)
            wire.connect(str(self.run / "sim.sock"))
            lines.write(json.dumps({"do": do, **arguments}) + "\n")
            lines.flush()
            answer: dict[str, Any] = json.loads(lines.readline())
        assert answer["ok"], answer
        return answer

    def get(self, path: str) -> Any:
        """What REST says."""
        answer = httpx.get(f"{self.url}/api/v1{path}", headers={"Authorization": f"Bearer {self.token}"}, timeout=ANSWER_S)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def reaches(self, state: str) -> bool:
        """Whether REST tells this state of the cell within the patience; a command is answered before it is told."""
        end = time.monotonic() + END_S
        while self.get("/cell")["state"] != state:
            if time.monotonic() > end:
                return False
            time.sleep(POLL_S)
        return True

    def make_ready(self) -> None:
        """Bring plant and service to where every test begins: doors closed, nothing latched, no job at work, IDLE.

        Raises AssertionError with one line about what stands in the way.
        """
        for module in ("cellctl.cell", "cellctl.api"):
            self.thaw(module)
        self.sim("release_estop")
        self.sim("close_door")
        with Client(self.url, self.token) as client:
            self.make_ready_with(client)

    def make_ready_with(self, client: Client) -> None:
        """As somebody at the page brings it there. Raises AssertionError."""
        seen = "nothing was heard of the cell"
        end = time.monotonic() + KNOWN_S
        while time.monotonic() < end:
            try:
                self._cancel_jobs(client)
                snapshot = client.snapshot()
                alarms = "; ".join(alarm["cause"] for alarm in snapshot["alarms"])
                seen = f"{snapshot['state']} because {snapshot['because']}; alarms: {alarms or 'none'}"
                if snapshot["state"] == "IDLE" and not snapshot["alarms"]:
                    client.take_control("the next test begins")
                    client.release_control()
                    return
                if (verb := NEXT_VERB.get(snapshot["state"])) is not None:
                    client.take_control("the next test begins")
                    client.command(verb, "the next test begins")
            except ServiceError as error:  # a reset while it comes to rest, a service that starts again: next time
                seen = f"{seen}; {error.message}"
            time.sleep(POLL_S)
        raise AssertionError(f"the cell cannot be made ready for the next test within {KNOWN_S:g} s: {seen}")

    def _cancel_jobs(self, client: Client) -> None:
        """Cancel what waits or is planned; the job on the cell is aborted there."""
        for job in client.get("jobs", limit=100)["items"]:
            if JobState(job["state"]) not in ENDED and job["state"] not in ("running", "held"):
                client.cancel(job["id"], "the next test begins")

    def process(self, module: str) -> int:
        """Number of the service's process that runs this module."""
        service = self._children[-1].pid
        for status in Path("/proc").glob("[0-9]*/cmdline"):
            try:
                words = status.read_bytes().split(b"\0")
                parent = int((status.parent / "stat").read_text().rpartition(")")[2].split()[1])
            except (OSError, IndexError):
                continue
            if parent == service and module.encode() in words:
                return int(status.parent.name)
        raise AssertionError(f"the service runs no {module}")

    def freeze(self, module: str) -> None:
        """The process does nothing any more, and its sockets stay open."""
        os.kill(self.process(module), signal.SIGSTOP)

    def thaw(self, module: str) -> None:
        os.kill(self.process(module), signal.SIGCONT)
