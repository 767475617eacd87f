"""A served cell with a simulated one at the far end of its wires, all in processes of their own, for benches."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from config.base import find_facts

START_S = 180.0  # a loaded machine takes its time to import
END_S = 30.0


@dataclass
class Served:
    """Processes that run. run : their directory, with cell.sock and sim.sock"""

    run: Path
    store: Path
    sim: subprocess.Popen[str]
    service: subprocess.Popen[bytes]
    url: str
    token: str

    def cell_pid(self) -> int:
        """Process id of the cell process that is there now."""
        wanted = str(self.run).encode()
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit():
                try:
                    words = (entry / "cmdline").read_bytes().split(b"\0")
                except OSError:
                    continue
                if b"cellctl.cell" in words and wanted in words:
                    return int(entry.name)
        raise LookupError("no cell process")


def as_hardware(pid: int) -> None:
    """The far end of a wire is a machine of its own: it does not wait for ours to have time, where that is permitted."""
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, pid, -15)


def until(holds: Any, what: str, seconds: float = START_S) -> None:
    """Wait until holds() is true. Raises TimeoutError."""
    end = time.monotonic() + seconds
    while not holds():
        if time.monotonic() > end:
            raise TimeoutError(f"{what} took more than {seconds:g} s")
        time.sleep(0.02)


def start_sim(run: Path, time_scale: float = 1.0, cell: str = "trunnion_tcp") -> subprocess.Popen[str]:
    """A simulated cell on free ports; its cell file is run/cell.toml."""
    shipped = find_facts("cells", cell).read_text(encoding="utf-8")
    (run / "given.toml").write_text(re.sub(r"tcp_port = \d+", "tcp_port = 0", shipped), encoding="utf-8")
    command = [sys.executable, "-m", "sim", "--cell", str(run / "given.toml"), "--run", str(run), "--time-scale", f"{time_scale:g}"]
    sim = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert sim.stdout is not None
    sim.stdout.readline()
    as_hardware(sim.pid)
    return sim


@contextmanager
def tapped(run: Path, baud: int, log: Path) -> Iterator[None]:
    """The CNC's wire goes through a tap that writes down in `log` when real-time bytes arrive; the cell file names the tap."""
    file = run / "cell.toml"
    port = re.search(r'^port = "(.*)"$', file.read_text(encoding="utf-8"), re.MULTILINE)
    assert port is not None
    with log.open("w") as output:
        command = [sys.executable, "-m", "tests.bench.serial_tap", str(run / "tap"), str(run / port[1]), str(baud)]
        tap = subprocess.Popen(command, stdout=output)
        try:
            as_hardware(tap.pid)
            until(lambda: log.read_text().startswith("ready"), "the tap's start")
            file.write_text(file.read_text(encoding="utf-8").replace(port[0], 'port = "tap"'), encoding="utf-8")
            yield
        finally:
            tap.terminate()
            tap.wait(END_S)


@contextmanager
def serve(run: Path, store: Path, sim: subprocess.Popen[str]) -> Iterator[Served]:
    """`cellctl serve` for a simulated cell that is there, ended afterwards. A cell process that listens already is adopted."""
    words = ["--cell", str(run / "cell.toml"), "--store", str(store), "--run", str(run)]
    command = [sys.executable, "-m", "cellctl", "serve", *words, "--port", "0", "--stop-port", "0"]
    service = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        address = run / "service.json"
        until(lambda: address.exists() and address.read_text(), "the service's start")
        url = json.loads(address.read_text())["url"]
        token = (store / "operator.token").read_text().strip()
        yield Served(run, store, sim, service, url, token)
    finally:
        service.terminate()
        service.wait(END_S)


@contextmanager
def served(time_scale: float = 1.0, tap_baud: int = 0) -> Iterator[Served]:
    """A simulated cell and its service, ended afterwards.  tap_baud : the CNC's wire goes through a tap, its log is run/tap.log"""
    with tempfile.TemporaryDirectory(prefix="bench-served-") as place, ExitStack() as ends:
        folder = Path(place)
        run = folder / "run"
        run.mkdir()
        sim = start_sim(run, time_scale)
        ends.callback(_end, sim)
        if tap_baud:
            ends.enter_context(tapped(run, tap_baud, run / "tap.log"))
        yield ends.enter_context(serve(run, folder / "store", sim))


def _end(sim: subprocess.Popen[str]) -> None:
    sim.terminate()
    sim.wait(END_S)
    if sim.stdout is not None:
        sim.stdout.close()


def cpu_s(pid: int) -> float:
    """CPU time that a process has used so far, s."""
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
