"""`cellctl demo`: a simulated cell, the service, and one part from upload to measured result, over REST like anybody else's."""

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
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import tomli_w

from cellctl.cli import output
from cellctl.client import Client, ServiceError
from cellctl.client_documents import Job, JobError
from cellctl.demo_display import Display
from config import Cell, load_cell
from config.base import FACTS_DIR
from sim.proof import MISSING_SHARE

PART = FACTS_DIR / "parts" / "pipe.stl"
RECIPE = FACTS_DIR / "parts" / "pipe.toml"
START_S = 60.0
POLL_S = 0.2
SOCKET_PATH_MAX = 85  # of the run directory, so that the names of its sockets fit into 107 bytes
STUCK_S = 60.0
RECOVERIES = 5
PLANT_NICENESS = -10
ENDED = ("completed", "failed", "aborted", "interrupted", "cancelled")
Document = dict[str, Any]


class DemoError(Exception):
    """The demo did not get to its end. `message`, `hint` : one line each"""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


def to_be_simulated(cell: Cell) -> Document:
    """The facts of a cell with any free port for its TCP devices. Raises DemoError for a real cell."""
    if cell.mode != "sim":
        raise DemoError(
            f"{cell.name}: this is a real cell, the demo runs a simulated one", 'name a cell file with mode = "sim"'
        )
    facts = cell.model_dump(mode="json", exclude_none=True)
    for link in facts["links"].values():
        if link["transport"] == "tcp":
            link["tcp_port"] = 0
    return facts


def ask_sim(path: Path, command: Document, timeout_s: float = 120.0) -> Document:
    """One command over the simulator's control socket. Raises DemoError."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line:
        line.settimeout(timeout_s)
        try:
            line.connect(str(path))
            line.sendall(json.dumps(command).encode() + b"\n")
            answer: Document = json.loads(line.makefile("rb").readline() or b"{}")
        except (OSError, ValueError) as error:
            raise DemoError(
                f"the simulated cell does not answer: {error}", "look at its log in the demo's folder"
            ) from None
    if not answer.get("ok"):
        raise DemoError(
            f"the simulated cell refused {command['do']}: {answer.get('error', 'no answer')}",
            str(answer.get("hint", "")),
        )
    return answer


class Demo:
    """One demonstration. out : folder of store, logs and results, made afresh; `run` does it all"""

    def __init__(self, cell: str, time_scale: float, out: Path, *, keep: bool, as_json: bool) -> None:
        self._cell_name = cell
        self._time_scale = time_scale
        self._out = out.resolve()
        self._keep = keep
        self._as_json = as_json
        self._run_dir = self._out / "run"
        self._children: list[subprocess.Popen[bytes]] = []
        self._display = Display(quiet=as_json)
        self._recoveries = 0

    def run(self) -> int:
        """Exit code: 0 if the part as built is within its tolerance. Raises DemoError, ServiceError, ConfigError."""
        started = time.monotonic()
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
        try:
            with self._display:
                client = self._bring_up()
                with client:
                    result = self._build(client)
            result["seconds"] = round(time.monotonic() - started, 1)
            self._tell(result)
            if self._keep:
                self._say("everything is left up; Ctrl-C ends it")
                signal.pause()
        except KeyboardInterrupt:
            if not self._keep:
                raise
        finally:
            self._take_down()
        return 0 if result["passed"] else 1

    def _say(self, text: str) -> None:
        self._display.say(text)

    def _bring_up(self) -> Client:
        """Simulated cell and service, each its own process; a client with the operator's token."""
        cell = load_cell(self._cell_name)
        if self._out.exists():
            shutil.rmtree(self._out)
        self._out.mkdir(parents=True)
        if len(os.fsencode(self._run_dir)) > SOCKET_PATH_MAX:
            self._run_dir = Path(tempfile.mkdtemp(prefix="cellctl-demo-"))
        self._run_dir.mkdir(exist_ok=True)
        given = self._out / "simulated_cell.toml"
        given.write_text(tomli_w.dumps(to_be_simulated(cell)), encoding="utf-8")
        words = ["--cell", str(given), "--run", str(self._run_dir), "--time-scale", str(self._time_scale)]
        self._start(
            "sim",
            ["-m", "sim", *words],
            lambda: (self._run_dir / "sim.sock").exists() and (self._run_dir / "cell.toml").exists(),
        )
        self._say(f"simulated cell {cell.name}, process time {self._time_scale:g} × wall time")
        words = [
            "--cell",
            str(self._run_dir / "cell.toml"),
            "--store",
            str(self._out / "store"),
            "--run",
            str(self._run_dir),
        ]
        address = self._run_dir / "service.json"
        self._start(
            "serve", ["-m", "cellctl", "serve", *words, "--port", "0", "--stop-port", "0", "--json"], address.exists
        )
        url = str(json.loads(address.read_text(encoding="utf-8"))["url"])
        token = (self._out / "store" / "operator.token").read_text(encoding="ascii").strip()
        self._say(f"console {url}  (sign in with {token})")
        return Client(url, token, name="demo")

    def _start(self, name: str, words: list[str], is_ready: Callable[[], bool]) -> None:
        """Start a process and wait for what shows that it is ready. Raises DemoError with the last line of its log."""
        log = self._out / f"{name}.log"
        with log.open("wb") as file:
            child = subprocess.Popen(
                [sys.executable, *words], stdin=subprocess.DEVNULL, stdout=file, stderr=file, start_new_session=True
            )
        self._children.append(child)
        if name == "sim":  # it stands for hardware, which no busy computer slows down
            with suppress(PermissionError):
                os.setpriority(os.PRIO_PROCESS, child.pid, PLANT_NICENESS)
        until = time.monotonic() + START_S
        while not is_ready():
            if child.poll() is not None or time.monotonic() > until:
                lines = [line for line in log.read_text(errors="replace").splitlines() if line.strip()]
                raise DemoError(
                    f"{name} did not start: {lines[-1] if lines else 'it said nothing'}", f"its log is {log}"
                )
            time.sleep(POLL_S)

    def _build(self, client: Client) -> Document:
        """Upload, plan, post, prove, approve, run, measure."""
        part = client.upload(PART)
        low, high = part["bbox_mm"]
        size = " × ".join(f"{b - a:.4g}" for a, b in zip(low, high, strict=True))
        self._say(f"{PART.name}: {size} mm, {part['facets']} facets, {part['volume_mm3']:.0f} mm³")
        job = client.submit(part["id"], recipe_toml=RECIPE.read_text(encoding="utf-8"), name="pipe")
        job = self._until(client, job["id"], ("waiting_for_approval", *ENDED))
        if job["state"] != "waiting_for_approval":
            error = job["error"] or JobError(title=job["state"], detail=job["why"], hint="")
            raise DemoError(f"the job {job['state']}: {error['detail']}", error["hint"])
        proof = job["proof"] or {}
        self._say(
            f"planned {job['layers']} layers, posted {job['lines_total']} lines ({output.duration(job['duration_s'])}); "
            f"proof: 99 % within {proof['p99_mm']:.3f} mm of {proof['tolerance_mm']:g} mm"
        )
        if not proof["passed"]:
            reasons = client.get(f"jobs/{job['id']}/proof").get("reasons", [])
            raise DemoError(f"the proof did not pass: {'; '.join(reasons) or 'see the proof'}", "nothing was run")
        self._clamp(client, job, proof)
        client.approve(job["id"], because="demo", table_clear=True)
        job = self._until(client, job["id"], ENDED)
        if job["state"] != "completed":
            raise DemoError(
                f"the run {job['state']}: {job['why']}", f"the record is at {client.url}/api/v1/jobs/{job['id']}/record"
            )
        return self._measure(client, job)

    def _clamp(self, client: Client, job: Job, proof: Document) -> None:
        """A fresh plate into the simulated machine, and the part that it will be measured against."""
        plan = client.get(f"jobs/{job['id']}/plan")
        mesh = self._out / "part.stl"
        mesh.write_bytes(client.content(f"parts/{job['part_id']}/mesh"))
        command = {"do": "workpiece", "mesh": str(mesh), "build_from_part": plan["build_from_part"]}
        ask_sim(self._run_dir / "sim.sock", {**command, "material": job["material"], "cell_mm": proof["cell_mm"]})

    def _until(self, client: Client, job_id: str, states: tuple[str, ...]) -> Job:
        """Follow the job into one of these states; on a fault do what an operator would, once looked at.

        Raises DemoError if it stays held or queued.
        """
        stuck_since: float | None = None
        while True:
            job = client.job(job_id)
            snapshot = client.snapshot() if job["state"] in ("running", "held") else None
            self._display.show(job, snapshot)
            if job["state"] in states:
                return job
            stuck_since = (stuck_since or time.monotonic()) if job["state"] in ("held", "queued") else None
            if stuck_since is not None and time.monotonic() - stuck_since > STUCK_S:
                raise DemoError(f"the job is {job['state']}: {job['why']}", "look at the console")
            if snapshot is not None:
                self._recover(client, snapshot)
            time.sleep(POLL_S)

    def _recover(self, client: Client, snapshot: Document) -> None:
        """Reset a latched fault and resume the held job, as often as RECOVERIES; a busy machine can delay a read-back."""
        causes = "; ".join(alarm["cause"] for alarm in snapshot["alarms"])
        with suppress(ServiceError):  # refused as long as the cause is there, and asked again
            if snapshot["state"] == "FAULT" and self._recoveries < RECOVERIES:
                client.command("reset", f"demo: looked at it: {causes}")
                self._recoveries += 1
                self._say(
                    f"fault: {causes}; laser and powder were off; reset ({self._recoveries} of at most {RECOVERIES})"
                )
            elif snapshot["state"] == "HELD" and self._recoveries:
                client.command("resume", "demo: the fault is reset")

    def _measure(self, client: Client, job: Job) -> Document:
        """What stands in the simulated machine against the part, and the record."""
        folder = self._out / "result"
        tolerance_mm = job["recipe"]["tolerance_mm"]
        command = {"do": "as_built", "dir": str(folder), "name": "pipe", "tolerance_mm": tolerance_mm}
        deviation = ask_sim(self._run_dir / "sim.sock", command)["deviation"]
        (folder / "record.json").write_text(json.dumps(client.record(job["id"]), indent=1), encoding="utf-8")
        (folder / "record.html").write_bytes(client.content(f"jobs/{job['id']}/record", format="html"))
        within = (
            deviation["p99_mm"] <= tolerance_mm and deviation["missing_mm3"] <= MISSING_SHARE * deviation["part_mm3"]
        )
        files = sorted(path.name for path in folder.iterdir())
        seen = {"faults_reset": self._recoveries, "tolerance_mm": tolerance_mm, "deviation": deviation}
        return {"passed": within, "job": job["id"], "url": client.url, "folder": str(folder), "files": files, **seen}

    def _tell(self, result: Document) -> None:
        """The end: figures, files, verdict."""
        if self._as_json:
            output.as_json(result)
            return
        seen = result["deviation"]
        share = 100.0 * seen["missing_mm3"] / seen["part_mm3"]
        self._say(
            f"as built: mean {seen['mean_mm']:+.3f} mm, 99 % within {seen['p99_mm']:.3f} mm; missing {share:.2f} % of the part"
        )
        self._say(f"results in {result['folder']}: {', '.join(result['files'])}")
        verdict = "within" if result["passed"] else "NOT within"
        self._say(
            f"{verdict} the tolerance of {result['tolerance_mm']:g} mm, after {output.duration(result['seconds'])}"
        )

    def _take_down(self) -> None:
        """End every process that was started, the service first."""
        for child in reversed(self._children):
            if child.poll() is None:
                with suppress(ProcessLookupError):
                    child.terminate()
                try:
                    child.wait(20.0)
                except subprocess.TimeoutExpired:
                    child.kill()
                    child.wait()
        if not self._run_dir.is_relative_to(self._out):
            shutil.rmtree(self._run_dir, ignore_errors=True)
