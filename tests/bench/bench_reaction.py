"""From each cause to the laser off at the plant, by wire: p50, p99 and greatest, against 30 ms plus one request of the link."""

from __future__ import annotations

import asyncio
import os
import random
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from config.cell import load_cell
from config.device import load_device
from sim.world import World
from tests.bench.reaction_cell import ReactionCell
from tests.bench.table import Cell, Table

BOUND_MS = 30.0
REQUEST_MS = {"trunnion_tcp": 1.0, "trunnion_rtu": 8.0}  # the longest request of the link: on RTU 21 characters each way and two gaps
SAMPLES = int(os.environ.get("REACTION_SAMPLES", "25"))
Act = Callable[[World], None]


@dataclass(frozen=True)
class Cause:
    """One cause: how it is set and mended at the plant; `after_ms`: what has to go by before any software can know."""

    name: str
    act: Act
    mend: Act
    after_ms: float = 0.0
    why: str = ""
    share: float = 1.0  # of SAMPLES


def level(name: str) -> tuple[Act, Act]:
    """A contact of the I/O coupler alone: nothing hangs on it by wire."""

    def to(value: bool) -> Act:
        def act(world: World) -> None:
            setattr(world.io, name, value)
            world.io.show()

        return act

    return to(False), to(True)


def fault(kind: str, mend: str) -> tuple[Act, Act]:
    """A fault and its end by the simulator's words."""
    return lambda world: world.faults.add(kind), lambda world: world.faults.add(mend) if mend else None


def head(world: World) -> None:
    """The head's slide is pushed off its stop."""
    world.io.slide = 0.5
    world.io.show()


def feeder(bits: int) -> Act:
    """The feeder's fault word."""

    def act(world: World) -> None:
        world.feeder.faults = bits
        world.feeder.show()

    return act


def causes(name: str) -> list[Cause]:
    """Every cause for one cell."""
    cell = load_cell(name)
    stale = {role: load_device(link.device).registers for role, link in cell.links.items()}
    status_ms = 1e3 * cell.cnc.status_period_s
    return [
        Cause("door, I/O coupler", *level("door_closed")),
        Cause("E-stop, I/O coupler", *level("estop_ok"), share=0.4),
        Cause("chiller, I/O coupler", *level("chiller_ok")),
        Cause("gas pressure, I/O coupler", *level("gas_pressure_ok")),
        Cause("fume extraction, I/O coupler", *level("fume_extraction_ok")),
        Cause("head off its stop", head, lambda world: None, share=0.4),
        Cause("laser interlock (fibre)", *fault("fibre_open", "fibre_close")),
        Cause("laser fault", *fault("laser_fault", "")),
        Cause("feeder fault", feeder(8), feeder(0)),
        Cause("CNC alarm", *fault("alarm 1", ""), share=0.4),
        Cause("feed hold at the CNC", *fault("feed_hold", ""), status_ms, "one status period"),
        Cause("door input of the CNC", lambda w: w.cnc.machine.door(True), lambda w: w.cnc.machine.door(False), status_ms, "one status period"),
        Cause("serial line unplugged", *fault("serial_unplug", "serial_plug"), share=0.3),
        Cause("CNC silent", *fault("serial_silent", "serial_ok"), 1e3 * cell.limits.status_stale_s, "stale limit", 0.3),
        Cause("I/O coupler silent", *fault("modbus_silent io", "modbus_ok io"), 1e3 * stale["io"]["door_closed"].stale_s, "stale limit", 0.4),
        Cause("feeder silent", *fault("modbus_silent feeder", "modbus_ok feeder"), 1e3 * stale["feeder"]["fault_word"].stale_s, "stale limit", 0.4),
        Cause("laser silent", *fault("modbus_silent laser", "modbus_ok laser"), 1e3 * load_device(cell.links["laser"].device).dead_man_s,
              "its dead-man", 0.4),
    ]  # fmt: skip


async def measured(name: str, chosen: str = "") -> list[tuple[Cell, ...]]:
    """Rows of one cell."""
    rng, rows = random.Random(7), []
    with tempfile.TemporaryDirectory(prefix="reaction-") as folder:
        async with ReactionCell(Path(folder), name) as cell:
            for cause in causes(name):
                if chosen in cause.name:
                    rows.append(await sampled(cell, cause, name, rng))
                    print(*rows[-1], flush=True)
            if cell.unasked:
                rows.append((name, "faults that nobody caused", len(cell.unasked), *["-"] * 5, "no", cell.unasked[0]))
                print(*rows[-1], flush=True)
    return rows


def number(value: float) -> Cell:
    """A figure, or a word where nothing was seen."""
    return float(value) if np.isfinite(value) else "never"


async def sampled(cell: ReactionCell, cause: Cause, name: str, rng: random.Random) -> tuple[Cell, ...]:
    """The row of one cause; a cell that does not come back is told as such."""
    found: list[tuple[float, float]] = []
    why = ""
    bound = cause.after_ms + BOUND_MS + REQUEST_MS[name]
    for _ in range(max(3, round(SAMPLES * cause.share))):
        try:
            await cell.deposit()
            await asyncio.sleep(rng.uniform(0.05, 0.3))
            if not cell.is_lit():
                await cell.deposit()
            found.append(await cell.react(cause.act, 1e-3 * cause.after_ms + 2.0))
            cause.mend(cell.world)
            await cell.until(lambda: cell.snapshot.state in ("FAULT", "HELD"), 5.0)
            await asyncio.sleep(0.15)
        except TimeoutError as error:
            why = str(error)
            cause.mend(cell.world)
            break
    if not found:
        return (name, cause.name, 0, *["-"] * 4, bound, "no", why)
    dark, stop = (np.array(values) for values in zip(*found, strict=True))
    p99 = float(np.percentile(dark, 99))
    is_within = p99 <= bound and not why
    told = stop[np.isfinite(stop)]
    return (
        name, cause.name, len(found), number(np.median(dark)), number(p99), number(dark.max()),
        number(np.median(told)) if len(told) else "never", bound,
        "yes" if is_within else "no", why or cause.why,
    )  # fmt: skip


COLUMNS = ("cell", "cause", "n", "dark p50 ms", "p99 ms", "max ms", "hold p50 ms", "bound ms", "within", "why so long")


def run() -> list[Table]:
    """Both ways of wiring: TCP with the gate in the stream, RTU at 115200 baud with the gate by Modbus."""
    rows = [row for name in REQUEST_MS for row in asyncio.run(measured(name))]
    note = (
        "Cause and darkness are seen in the plant's own process: dark is the instant at which the laser's pump level is 0 (its ramp of 2 ms "
        "comes after); hold is the first hold or reset byte at the firmware. Contacts of the coupler are opened alone, so that nothing is "
        "cut by hard wire; a laser's own interlock or fault cuts itself (dark at 0), the hold tells how soon the software has seen it. "
        f"Bound: {BOUND_MS:g} ms and one request of the link, after what no software can know sooner (last column)."
    )
    return [Table("From cause to laser off", COLUMNS, rows, note)]


if __name__ == "__main__":
    asyncio.run(measured(sys.argv[1] if len(sys.argv) > 1 else "trunnion_tcp", sys.argv[2] if len(sys.argv) > 2 else ""))
