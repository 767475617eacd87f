"""How many times real time the simulated cell runs: firmware, motion, laser, powder, Modbus banks and trace, without metal."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

from config import load_cell, load_device
from sim.world import World
from tests.bench.table import Table

LINES = 3000
STEPS_S = (0.005, 0.05, 0.5)


def deposition(segment_mm: float) -> Iterator[bytes]:
    """A ring of 20 mm radius at 10 mm/s in G93, all five axes moving, gate in the stream."""
    yield b"G21 G90 G93\n"
    yield b"M62 P0\n"
    for i in range(LINES):
        angle = (i + 1) * segment_mm / 20.0
        words = f"X{20 * math.cos(angle):.3f} Y{20 * math.sin(angle):.3f} Z{200 + i * 1e-3:.3f} A{5 * math.sin(angle / 3):.3f} C{i * 0.01:.3f}"
        yield f"N{i + 1} {'G1 ' if not i else ''}{words} F{60 / (segment_mm / 10.0) if i else 20:.2f}\n".encode()
    yield b"M63 P0\n"


def measure(segment_mm: float, step_s: float) -> tuple[float, float]:
    """Process time and CPU time of the whole program, fed without a wire."""
    cell = load_cell("trunnion_tcp")
    world = World(cell, {role: load_device(link.device) for role, link in cell.links.items()}, dead_man=False)
    for name, value in (("power_setpoint", 1000.0), ("enable", 1.0), ("emission_permit", 1.0)):
        world.laser.write(name, value)
    world.feeder.write("carrier_gas_setpoint", 5.0)
    world.feeder.write("rate_setpoint", 6.0)
    lines = deposition(segment_mm)
    world.cnc.supply = lambda free: next(lines, b"")
    world.step(1e-3)
    started = time.process_time()
    while world.cnc.machine.motion.count:
        world.step(step_s)
    return world.time_s, time.process_time() - started


def run() -> list[Table]:
    """One row per segment length and step."""
    measure(0.3, 0.5)
    rows = []
    for segment_mm in (0.1, 0.3, 1.0):
        for step_s in STEPS_S:
            process_s, wall_s = measure(segment_mm, step_s)
            rows.append((segment_mm, step_s * 1e3, process_s, wall_s, process_s / wall_s, wall_s / LINES * 1e6))
    columns = ("segment mm", "step ms", "process s", "CPU s", "times real time", "us a line")
    return [Table("Simulated cell against real time", columns, rows, f"{LINES} lines of G93 in five axes at 10 mm/s.")]
