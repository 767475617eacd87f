"""A working day at 20 times its speed through real wires, on a cell with the gate in the stream and on one with the gate on Modbus.

SOAK_HOURS says how many simulated hours (both cells together): 8 are 24 minutes.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import tomli_w

from cellctl.cell.program_form import form_beside, write_form
from cellctl.demo import to_be_simulated
from cellctl.store.engine import DATABASE
from config.cell import Cell as Facts
from config.cell import load_cell
from planner.files import write_program
from planner.program import Program
from tests.bench.served import END_S, Served, as_hardware, serve
from tests.bench.soak_books import errors_in, outcomes, sizes
from tests.bench.soak_day import Day
from tests.bench.soak_watch import Watch, picture
from tests.bench.table import RESULTS, Cell, Table
from tests.cell.jobs import one_wall

HOURS = 8.0
TIME_SCALE = 20.0
CELLS = {"gate in the stream": "trunnion_tcp", "gate on Modbus": "trunnion_rtu"}
IN_PROCESS_TIME = {"response": ("powder_delay_s", "powder_settle_s"), "limits": ("purge_s",)}
"""What the cell process waits for on the clock although it goes with the process, which is faster here."""

WALLS = ((6, 120.0, 60), (3, 90.0, 400), (8, 60.0, 20))
"""Layers, length (mm) and lines per bead of the programs that take turns, the first from a file; each is milled at the end."""

GROWTH_MB_H = 1.0  # per simulated hour behind the warm-up: 8 h then cost less than a tenth of what a process holds
MORE_DESCRIPTORS = 4  # between the fewest of the first and of the last quarter: two connections of a pool, less than one per run
JUDGED_H = 1.0  # of simulated time behind the warm-up; in less, the first jobs are all that grows
LOG_MB = 16.0  # four times what SQLite lets its log grow to before it is written back
MISSED_SHARE = 1e-3
STANDSTILL_S = 0.03  # light at standstill, wire time: the bound from a cause to laser off


def far_end(run: Path, name: str) -> subprocess.Popen[str]:
    """A simulated cell with a witness; its cell file is run/cell.toml, and says what the powder's way takes at this speed."""
    facts = to_be_simulated(load_cell(name))
    for part, fields in IN_PROCESS_TIME.items():
        facts[part] |= {field: facts[part][field] / TIME_SCALE for field in fields}
    (run / "given.toml").write_text(tomli_w.dumps(facts), encoding="utf-8")
    words = ["--cell", str(run / "given.toml"), "--run", str(run), "--time-scale", f"{TIME_SCALE:g}"]
    sim = subprocess.Popen([sys.executable, "-m", "tests.bench.soak_far_end", *words], stdout=subprocess.PIPE, text=True)
    assert sim.stdout is not None
    sim.stdout.readline()
    as_hardware(sim.pid)
    return sim


def child(parent: int, module: str) -> int:
    """Process id of a child that runs a module. Raises LookupError."""
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            is_child = int((entry / "stat").read_text().rpartition(")")[2].split()[1]) == parent
            if is_child and module.encode() in (entry / "cmdline").read_bytes().split(b"\0"):
                return int(entry.name)
        except OSError:
            continue
    raise LookupError(f"no process runs {module}")


@contextmanager
def site(cell: str) -> Iterator[tuple[Served, list[Path], Watch]]:
    """A served cell with programs that are made for it, and what watches its processes."""
    with tempfile.TemporaryDirectory(prefix="soak-") as place, ExitStack() as ends:
        folder = Path(place)
        run = folder / "run"
        run.mkdir()
        sim = far_end(run, cell)
        ends.callback(_end, sim)
        facts = load_cell(str(run / "cell.toml"))
        programs = []
        for k, (layers, length_mm, pieces) in enumerate(WALLS):
            programs.append(folder / f"program-{k}")
            _store_program(one_wall(facts, layers=layers, length_mm=length_mm, pieces=pieces, dwell_s=1.0), facts, programs[-1], is_ready=k > 0)
        with serve(run, folder / "store", sim) as service:
            pids = {
                "far end": sim.pid, "cell": service.cell_pid(), "web": child(service.service.pid, "cellctl.api"),
                "supervisor": service.service.pid,
            }  # fmt: skip
            yield service, programs, Watch(pids, service.store / f"{DATABASE}-wal")


def _store_program(program: Program, cell: Facts, folder: Path, *, is_ready: bool) -> None:
    """Write a Program as the service stores it, with the form that a run opens; not ready, it comes from a file and the start makes its form."""
    write_program(program, folder)
    if is_ready:
        write_form(program, cell, form_beside(folder), hashlib.sha256((folder / "program.json").read_bytes()).hexdigest())


def _end(sim: subprocess.Popen[str]) -> None:
    sim.terminate()
    sim.wait(END_S)
    if sim.stdout is not None:
        sim.stdout.close()


Rows = list[list[Cell]]


def memory_rows(name: str, watch: Watch) -> Rows:
    """One row per process: where it began and ended behind its warm-up, and how it grows."""
    rows: Rows = []
    keep = watch.warm()
    for process in watch.held:
        memory = watch.series(process, "memory")[keep]
        grows = watch.growth(process, "memory")
        row: list[Cell] = [name, process, float(memory[: len(memory) // 4 + 1].mean()), float(memory[-(len(memory) // 4 + 1) :].mean()), grows]
        for column in ("descriptors", "sockets", "threads"):
            count = watch.series(process, column)[keep]
            row.append(f"{int(count[: len(count) // 2].max())} → {int(count[len(count) // 2 :].max())}")
        hours = np.array(watch.hours)[keep]
        is_long = hours[-1] - hours[0] >= JUDGED_H
        is_flat = grows <= GROWTH_MB_H and watch.floor_rise(process, "descriptors") <= MORE_DESCRIPTORS
        rows.append([*row, "too short" if not is_long else "yes" if is_flat else "NO"])
    return rows


def soak(name: str, hours: float) -> tuple[Watch, Rows, Rows, list[str]]:
    """One cell: its watch, rows of memory, rows of figures, and what was not as it has to be."""
    with site(CELLS[name]) as (service, programs, watch):
        day = Day(service, programs, watch, hours)
        day.spend()
        ended = day.link.snapshot
        witness, database = day.witness, service.store / DATABASE
        kept = tempfile.TemporaryDirectory(prefix="soak-books-")
        service.service.terminate()
        service.service.wait(END_S)
        if day.planning is not None:
            day.planning.join(END_S)
        with kept as place:
            copy = Path(place) / DATABASE
            for suffix in ("", "-wal"):
                source = database.with_name(database.name + suffix)
                if source.exists():
                    copy.with_name(copy.name + suffix).write_bytes(source.read_bytes())
            wrong = errors_in(copy, day.started, day.sent, day.events)
            ends, rows_in = outcomes(copy), sizes(copy)
    assert ended is not None and day.first is not None, day.broke_off
    ticks, missed = ended.tick.count - day.first.tick.count, ended.tick.missed - day.first.tick.missed
    figures: list[tuple[str, Cell, str, bool]] = [
        (f"simulated hours{day.broke_off and '; broke off: '}{day.broke_off}", float(witness["process_s"]) / 3600.0, f"{hours:g}", not day.broke_off),
        ("jobs: " + ", ".join(f"{count} {word}" for word, count in sorted(ends.items())), len(day.started), "", len(day.started) > 0),
        ("commands answered: " + ", ".join(f"{n} {verb}" for verb, n in sorted(day.sent.items())), day.sent.total(), "", True),
        ("plans made meanwhile: " + ", ".join(f"{n} {word}" for word, n in day.plans.items()), day.plans.total(), "", True),
        ("consoles that came", day.consoles, "", True),
        ("faults that nobody asked for" + "".join(f"; {text}" for text in day.faults[:3]), len(day.faults), "0", not day.faults),
        ("rows: " + ", ".join(f"{n} {table}" for table, n in rows_in.items()), sum(rows_in.values()), "", True),
        ("books that do not agree" + "".join(f"; {text}" for text in wrong[:4]), len(wrong), "0", not wrong),
        ("write-ahead log, largest MB", max(watch.log_mb), f"{LOG_MB:g}", max(watch.log_mb) <= LOG_MB),
        ("ticks", ticks, "", True),
        ("ticks missed", missed, f"{MISSED_SHARE:g} of them", missed <= MISSED_SHARE * ticks),
        ("jitter p99, worst 30 s, ms", day.jitter_ms, "3", day.jitter_ms < 3.0),
        ("longest time between two ticks, ms", day.longest_ms, "", True),
        ("light at standstill, longest, ms", 1e3 * witness["standstill_s"], f"{1e3 * STANDSTILL_S:g}", witness["standstill_s"] <= STANDSTILL_S),
        ("light behind an unsafe level, longest, ms", 1e3 * witness["unsafe_lit_s"], "30", witness["unsafe_lit_s"] <= STANDSTILL_S),
        (f"light without its head {witness['unguarded']}", int(bool(witness["unguarded"])), "0", not witness["unguarded"]),
    ]  # fmt: skip
    rows: Rows = [[name, what, value, limit, "yes" if ok else "NO"] for what, value, limit, ok in figures]
    return watch, memory_rows(name, watch), rows, [f"{name}: {what}" for what, _, _, ok in figures if not ok]


def run() -> list[Table]:
    """Both cells, one after the other. Raises RuntimeError behind the tables if something is not as it has to be."""
    hours = float(os.environ.get("SOAK_HOURS", HOURS)) / len(CELLS)
    watches, memory, figures, wrong = {}, [], [], []
    for name in CELLS:
        watch, held, rows, failed = soak(name, hours)
        watches[f"{name}, {CELLS[name]}"] = watch
        memory += held
        figures += rows
        wrong += failed + [f"{row[1]} of {name} is not flat: {row[4]:.2f} MB/h, descriptors {row[5]}" for row in held if row[-1] == "NO"]
    picture(watches, RESULTS / "soak_memory.png")
    note = f"{TIME_SCALE:g} times as fast as the clock; load of the machine at the end {os.getloadavg()[0]:.1f}; Python {sys.version.split()[0]}"
    tables = [
        Table("Soak", ["cell", "what", "measured", "limit", "met"], figures, note),
        Table(
            "Soak: what processes hold",
            ["cell", "process", "MB, begin", "MB, end", "MB per simulated hour", "descriptors", "sockets", "threads", "flat"],
            memory,
            f"behind a warm-up of 30 %, at most {GROWTH_MB_H:g} MB per hour, judged from {JUDGED_H:g} h on; anonymous memory; "
            "descriptors, sockets, threads: most in the first and in the second half, "
            f"of descriptors the fewest rise by {MORE_DESCRIPTORS} at most; "
            "picture in soak_memory.png",
        ),
    ]
    if wrong:
        for table in tables:
            table.write()
            print(table.markdown())
        raise RuntimeError("; ".join(wrong))
    return tables
