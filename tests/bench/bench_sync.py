"""Set-points at their arc length: light against the plant's position, power against speed, powder at passes' begin, dwells kept."""

from __future__ import annotations

import asyncio
import os
import tempfile
from collections.abc import Coroutine
from pathlib import Path

import numpy as np

from planner.program import Program
from tests.bench.sync_by_wire import by_wire
from tests.bench.sync_edges import Light, edge_errors_mm, rows_program
from tests.bench.sync_memory import SLOW_S, STEP_S, FineCell, cell_of
from tests.bench.table import Cell, Table
from tests.cell.jobs import POWDER_G_MIN, POWER_W

Seen = tuple[Program, Light, float]
ROWS = 12
DWELL_S = 0.4
RAMPS_S = 0.01  # five time constants of the laser's own ramp, which no power set-point can follow
EDGES = ("far end", "gate", "feed mm/s", "answers after ms", "edges", "on p50", "on p99", "off p50", "off p99", "greatest mm", "learnt ms")
GATE = ("feed mm/s", "edges", "off p50 mm", "off at most mm", "one step of the plant mm")
IN_MEMORY = (
    *(("trunnion_tcp", gate, feed, 0.001, 0.0) for gate in (True, False) for feed in (5.0, 10.0, 15.0, 20.0)),
    ("trunnion_tcp", False, 15.0, 0.010, 0.0),
    ("trunnion_tcp", False, 15.0, 0.040, 0.0),
    ("trunnion_tcp", False, 15.0, 0.005, 0.010),
    ("trunnion_rtu", False, 15.0, 0.001, 0.001),
    ("trunnion_rtu 19200", False, 15.0, 0.001, 0.001),
)  # cell and baud of its RTU line, gate in the stream, feed, delay and jitter of laser's and feeder's answers
BY_WIRE = (
    ("trunnion_tcp", True, 15.0, 0.0, 0.0), ("trunnion_tcp", False, 15.0, 0.0, 0.0),
    ("trunnion_tcp", False, 15.0, 0.010, 0.0), ("trunnion_rtu", False, 15.0, 0.0, 0.0),
)  # fmt: skip


async def in_memory(
    name: str, gate: bool, feed: float, delay_s: float, jitter_s: float, *, dwell_s: float = 0.0, override: int = 100, ramp_s: float | None = None
) -> Seen:
    """The Program, the plant's light and what was learnt of switching on (s). ramp_s : of the plant's laser, which no map knows of"""
    with tempfile.TemporaryDirectory() as place:
        shipped, _, baud = name.partition(" ")
        facts = cell_of(shipped, Path(place), gate=gate, slow=delay_s + jitter_s > SLOW_S, baud=int(baud or 0))
        cell = FineCell(Path(place) / "s.db", facts, delay_s, jitter_s)
        if ramp_s is not None:
            cell.sim.laser.ramp_s = ramp_s
        async with cell:
            program = rows_program(cell.facts, rows=ROWS, feed_mm_s=feed, dwell_s=dwell_s)
            if override != 100:
                cell.sim.cnc.receive(b"\x90" + (b"\x92" if override < 100 else b"\x91") * (abs(100 - override) // 10))
            await cell.build(program)
            assert cell.controller.drivers is not None
            return program, cell.light, cell.controller.drivers.laser.client.latency.on.value_s


def edge_row(where: str, gate: bool, feed: float, delay_s: float, jitter_s: float, seen: Seen) -> tuple[Cell, ...]:
    """One line of the table of edges."""
    program, light, learnt_s = seen
    on, off = (np.array(each) for each in edge_errors_mm(program, light))
    answers = f"{1e3 * delay_s:g}" + (f" to {1e3 * (delay_s + jitter_s):g}" if jitter_s else "")
    figures = [float(np.percentile(each, q)) for each in (on, off) for q in (50, 99)]
    return where, "stream" if gate else "Modbus", feed, answers, len(on) + len(off), *figures, float(np.abs(np.r_[on, off]).max()), 1e3 * learnt_s


def tried(where: str, gate: bool, feed: float, delay_s: float, jitter_s: float, work: Coroutine[None, None, Seen]) -> tuple[Cell, ...]:
    """The line of one run; a run that failed says why."""
    try:
        return edge_row(where, gate, feed, delay_s, jitter_s, asyncio.run(work))
    except (AssertionError, TimeoutError) as error:
        return where, "stream" if gate else "Modbus", feed, f"{1e3 * delay_s:g}", 0, *["-"] * 5, f"failed: {str(error)[:80]}"


async def wired(name: str, gate: bool, feed: float, delay_s: float, jitter_s: float) -> Seen:
    """The same by pty and Modbus, the plant in a process of its own."""
    with tempfile.TemporaryDirectory() as place:
        program, light, last = await by_wire(
            Path(place), name, gate=gate, rows=ROWS, feed_mm_s=feed, delay_s=delay_s, jitter_s=jitter_s
        )
        return program, light, last.laser.latency.on_s


def power_rows() -> list[tuple[Cell, ...]]:
    """Emission over set power against speed over feed, behind the laser's own ramp; powder while there is light."""
    rows: list[tuple[Cell, ...]] = []
    for override in (100, 150, 70, 50):
        _, light, _ = asyncio.run(in_memory("trunnion_tcp", False, 15.0, 0.001, 0.0, override=override))
        seen = np.array(light.moving)
        edges = np.array([at for _, at, _ in light.edges])
        from_edge_s = np.abs(seen[:, :1] - edges[None, :]).min(axis=1)
        is_well_on = (seen[:, 2] > 0.2 * POWER_W * min(override / 100.0, 1.0)) & (from_edge_s > RAMPS_S)
        share, speed = seen[is_well_on, 2] / POWER_W, np.minimum(seen[is_well_on, 1] / 15.0, 1.0)
        off = 100.0 * np.abs(share / speed - 1.0)
        powder = 100.0 * np.abs(seen[:, 3] / POWDER_G_MIN - 1.0)
        begins = [powder[np.searchsorted(seen[:, 0], at).clip(0, len(seen) - 1)] for is_on, at, _ in light.edges if is_on]
        figures = [float(np.percentile(off, q)) for q in (50, 95, 99)]
        rows.append((override, *figures, float(max(begins)), float(powder.max())))
    return rows


def dwell_rows() -> list[tuple[Cell, ...]]:
    """Time without light between passes with a dwell, less that without one, against the dwell."""
    gaps = []
    for dwell_s in (0.0, DWELL_S):
        _, light, _ = asyncio.run(in_memory("trunnion_tcp", False, 15.0, 0.001, 0.0, dwell_s=dwell_s))
        times = [at for _, at, _ in light.edges]
        gaps.append(np.array(times[2::2]) - np.array(times[1:-1:2]))
    longer_ms = 1e3 * (gaps[1] - gaps[0] - DWELL_S)
    return [(1e3 * DWELL_S, len(longer_ms), float(longer_ms.min()), float(np.median(longer_ms)), float(longer_ms.max()))]


def gate_rows() -> list[tuple[Cell, ...]]:
    """The wired gate itself, in the stream: where it switched against the Program; the laser's own ramp comes behind it."""
    rows: list[tuple[Cell, ...]] = []
    for feed in (5.0, 15.0, 20.0):
        program, light, _ = asyncio.run(in_memory("trunnion_tcp", True, feed, 0.001, 0.0))
        off = np.abs(np.concatenate(edge_errors_mm(program, light, of_gate=True)))
        rows.append((feed, len(off), float(np.percentile(off, 50)), float(off.max()), feed * STEP_S))
    return rows


def run() -> list[Table]:
    """All of it."""
    load = f"; load of this machine {os.getloadavg()[0]:.1f}"
    rows = [tried(f"{one[0]}, memory", *one[1:], in_memory(*one)) for one in IN_MEMORY]
    slow = in_memory("trunnion_tcp", False, 15.0, 0.001, 0.0, ramp_s=0.015)
    rows.append(tried("laser with a ramp of 15 ms, memory", False, 15.0, 0.001, 0.0, slow))
    rows += [tried(f"{one[0]}, wire", *one[1:], wired(*one)) for one in BY_WIRE]
    note = "mm along the pass, late is positive; the plant's trace, light at half power; nothing of the far end's latency is in the register map"
    power = ("override %", "off p50 %", "off p95 %", "off p99 %", "powder off at passes' begin %", "powder off at most %")
    dwell = ("dwell ms", "gaps", "longer by at least ms", "median ms", "at most ms")
    return [
        Table("Light at its arc length", EDGES, rows, note + load),
        Table("Gate in the stream", GATE, gate_rows(), "the gate's own edges"),
        Table("Power against speed", power, power_rows(), "Modbus level, 15 mm/s; light that is on for longer than the laser's own ramp"),
        Table("Dwells", dwell, dwell_rows(), "dark time between passes"),
    ]
