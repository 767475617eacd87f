"""A served cell whose processes, disk and supply fail: what is brought about, watched at the plant, and asked of the record."""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import socket
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cellctl.cell.ipc import HEADER, encode
from cellctl.client import Client, ServiceError
from cellctl.demo import ask_sim
from cellctl.domain.messages import PROTOCOL, Command, Hello
from config.cell import Cell, load_cell
from planner.files import write_program
from tests.bench.served import start_sim
from tests.cell.jobs import one_wall

START_S = 240.0  # a loaded machine takes its time
TIME_SCALE = 4.0
LIT_W = 1.0
STILL_MM_S = 0.05
LOOK_S = 0.002
ENDED_S = 30.0
STEPS = {"FAULT": "reset", "STOPPED": "reset", "UNHOMED": "home", "HELD": "abort", "RUNNING": "abort", "PREPARING": "abort"}
"""What an operator does in a state to get to IDLE."""
REST = frozenset({"IDLE", "UNHOMED"})


class Witness(threading.Thread):
    """Stands before the plant: (process time s, emission W, tip speed mm/s) as often as the simulator tells."""

    def __init__(self, path: Path) -> None:
        super().__init__(daemon=True, name="witness")
        self._path = path
        self.seen: list[tuple[float, float, float]] = []
        self.is_over = False

    def run(self) -> None:
        """Until `is_over`."""
        while not self.is_over:
            with contextlib.suppress(OSError, ValueError):
                state = ask_sim(self._path, {"do": "state"})
                self.seen.append((state["time_s"], state["laser"]["emission_w"], state["tip_speed_mm_s"]))
            time.sleep(LOOK_S)

    def lit_after_s(self, since: float) -> float:
        """Wire seconds from a process time to the last light that was seen behind it."""
        lit = [at for at, watts, _ in self.seen if at > since and watts > LIT_W]
        return (lit[-1] - since) / TIME_SCALE if lit else 0.0

    def standing_s(self) -> float:
        """Longest light at standstill, wire seconds."""
        longest, began = 0.0, None
        for at, watts, speed in self.seen:
            if watts > LIT_W and speed < STILL_MM_S:
                began = at if began is None else began
                longest = max(longest, at - began)
            else:
                began = None
        return longest / TIME_SCALE


@dataclass
class Outcome:
    """Of one run. lit_s : light behind the strike; told : what the operator reads"""

    fault: str
    situation: str
    lit_s: float = 0.0
    standing_s: float = 0.0
    back_s: float = 0.0
    told: str = ""
    wrong: list[str] = field(default_factory=list)


class Site:
    """A simulated cell that stays, and a service that may be killed and started anew."""

    def __init__(self, folder: Path) -> None:
        self.run, self.store = folder / "run", folder / "store"
        self.run.mkdir()
        self.store.mkdir(exist_ok=True)
        self.sim = start_sim(self.run, TIME_SCALE)
        self.service: subprocess.Popen[bytes] | None = None
        self.cell: Cell = load_cell(str(self.run / "cell.toml"))
        self.jobs = 0
        self.aimed: dict[str, int] = {}
        for name, shape in (("depositing", {"length_mm": 160.0, "pieces": 400, "mill": False}), ("milling", {"length_mm": 12.0, "pieces": 20})):
            write_program(one_wall(self.cell, layers=1, **shape), folder / name)  # type: ignore[arg-type]
        self.folder = folder

    # -- processes -----------------------------------------------------------------------------------------------------

    def start(self) -> float:
        """`cellctl serve` until it answers; seconds that took."""
        began = time.monotonic()
        words = ["--cell", str(self.run / "cell.toml"), "--store", str(self.store), "--run", str(self.run)]
        words += ["--port", str(self._port()), "--stop-port", "0"]
        with (self.folder / "serve.log").open("ab") as log:
            self.service = subprocess.Popen([sys.executable, "-m", "cellctl", "serve", *words], stdout=log, stderr=log)
        until(lambda: (self.run / "service.json").exists() and self._is_of(self.service), "the service's start")
        self.client = Client(self._document()["url"], (self.store / "operator.token").read_text().strip(), name="bench")
        return time.monotonic() - began

    def _port(self) -> int:
        """The same one again, as an installed service has it."""
        if not hasattr(self, "port"):
            with socket.socket() as probe:
                probe.bind(("127.0.0.1", 0))
                self.port = int(probe.getsockname()[1])
        return self.port

    def _document(self) -> dict[str, Any]:
        document: dict[str, Any] = json.loads((self.run / "service.json").read_text())
        return document

    def _is_of(self, service: subprocess.Popen[bytes] | None) -> bool:
        try:
            return service is not None and self._document()["pid"] == service.pid
        except (OSError, ValueError):
            return False

    def aim(self) -> None:
        """Look for the processes that may be killed: what a strike does then takes no time."""
        self.aimed = {module: self.pid(module) for module in ("cellctl.cell", "cellctl.api")}

    def pid(self, module: str) -> int:
        """Of the process that runs a module for this site, 0 without one."""
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                with contextlib.suppress(OSError):
                    words = (entry / "cmdline").read_bytes().split(b"\0")
                    if module.encode() in words and any(str(self.folder).encode() in word for word in words):
                        return int(entry.name)
        return 0

    def end(self) -> None:
        """End what is left."""
        for process in (self.service, self.sim):
            if process is not None and process.poll() is None:
                process.terminate()
                process.wait(ENDED_S)
        if self.sim.stdout is not None:
            self.sim.stdout.close()

    # -- asking --------------------------------------------------------------------------------------------------------

    def plant(self, do: str = "state", **fields: Any) -> dict[str, Any]:
        """Of the simulator."""
        return ask_sim(self.run / "sim.sock", {"do": do, **fields})

    def snapshot(self) -> dict[str, Any]:
        """Over REST; empty while nobody answers."""
        try:
            return self.client.snapshot()
        except ServiceError:
            return {}

    def state(self) -> str:
        """Of the cell; empty while nobody answers."""
        return str(self.snapshot().get("state", ""))

    def rows(self, query: str) -> list[tuple[Any, ...]]:
        """Of the store."""
        with closing(sqlite3.connect(self.store / "store.db", timeout=30.0)) as db:
            return db.execute(query).fetchall()

    # -- situations ----------------------------------------------------------------------------------------------------

    def begin(self, kind: str) -> str:
        """Start a program at the cell's socket as the service does; the job's name."""
        self.jobs += 1
        job = f"job-{self.jobs}"
        args = {"job": job, "name": job, "program": str(self.folder / kind)}
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as link:
            link.settimeout(START_S)
            link.connect(str(self.run / "cell.sock"))
            command = Command(f"start-{job}", "start", "operator", "bench", args, client="operator/bench")
            link.sendall(encode(Hello(PROTOCOL, "bench")) + encode(command))
            until(lambda: self._has_command(link, f"start-{job}"), "the start")
        return job

    @staticmethod
    def _has_command(link: socket.socket, ident: str) -> bool:
        head = link.recv(HEADER.size, socket.MSG_WAITALL)
        body = link.recv(HEADER.unpack(head)[0], socket.MSG_WAITALL)
        return ident.encode() in body and b"Reply" in body

    def bring(self, situation: str, dice: random.Random) -> str:
        """Bring it about, and a random while of it; the job, "" without one."""
        if situation == "idle":
            time.sleep(dice.uniform(0.0, 0.5))
            return ""
        job = self.begin("milling" if situation == "milling" else "depositing")
        if situation == "preparing":
            until(lambda: self.state() == "PREPARING", "preparing")
        elif situation == "milling":
            until(lambda: (now := self.plant())["cnc"]["spindle_rpm"] > 5000 and now["tip_speed_mm_s"] > 5.0, "milling")
        else:
            until(lambda: self.plant()["laser"]["emission_w"] > LIT_W, "depositing")
        time.sleep(dice.uniform(0.0, 0.4))
        if situation == "held":
            self.client.command("hold", "bench")
            until(lambda: self.state() == "HELD", "held")
        return job

    def bring_back(self) -> str:
        """What an operator does until the cell is IDLE without a job; the last refusal, "" if none."""
        said = ""
        end = time.monotonic() + START_S
        while time.monotonic() < end:
            state = self.state()
            verb = STEPS.get(state)
            if state == "IDLE":
                return ""
            if verb is not None:
                try:
                    self.client.command(verb, "bench")
                except ServiceError as error:
                    said = f"{verb}: {error.message}"
            time.sleep(0.1)
        return f"not back at IDLE: {self.state()}, {said}"

    def record_is_wrong(self, job: str) -> Iterator[str]:
        """What is missing in the record, or there twice."""
        seqs = [row[0] for row in self.rows("SELECT seq FROM events ORDER BY seq")]
        if seqs != list(range(1, len(seqs) + 1)):
            yield "a gap in the numbers of events"
        twice = self.rows("SELECT json_extract(data, '$.id'), count(*) FROM events WHERE kind = 'command' GROUP BY 1 HAVING count(*) > 1")
        if twice:
            yield f"commands written twice: {twice[:3]}"
        if job:
            runs = self.rows(f"SELECT outcome, ended_at IS NOT NULL FROM cell_runs WHERE job = '{job}'")
            if len(runs) != 1 or not runs[0][1]:
                yield f"the run of {job} is in the record as {runs}"


def until(holds: Callable[[], Any], what: str, seconds: float = START_S) -> Any:
    """What `holds` gives once it is true. Raises TimeoutError."""
    end = time.monotonic() + seconds
    while not (found := holds()):
        if time.monotonic() > end:
            raise TimeoutError(f"{what} took more than {seconds:g} s")
        time.sleep(0.01)
    return found


@contextmanager
def small_disk(folder: Path, megabytes: int) -> Iterator[bool]:
    """A disk of its own under a folder; False where this user may not mount one."""
    folder.mkdir(exist_ok=True)
    command = ["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(folder)]
    made = subprocess.run(command, capture_output=True, check=False).returncode == 0
    try:
        yield made
    finally:
        if made:
            subprocess.run(["umount", "-l", str(folder)], check=False)


def kill(pid: int) -> None:
    """-9."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)
