"""The far end of a soak: the simulated cell in a process of its own, with a witness of its light; `python -m tests.bench.soak_far_end`."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import signal
from pathlib import Path

from config import load_cell
from sim.server import SimServer
from tests.cell.witness import PlantWitness

TOLD = "witness.json"
TELL_S = 1.0


class LightWitness(PlantWitness):
    """Sees the light of days: what lines the machine took is counted, not kept."""

    def _watch_lines(self) -> None:
        return

    @property
    def told(self) -> dict[str, float | str]:
        """What was seen so far; times of the wires (s)."""
        world = self._world
        return {
            "process_s": world.time_s, "wire_s": world.wire_time_s, "standstill_s": self.standstill_s,
            "standstill_w": self.max_standstill_emission_w, "unsafe_lit_s": max(self.unsafe_lit_s.values(), default=0.0),
            "lit_lines": len(self.burnt_lines), "unguarded": self.unguarded,
        }  # fmt: skip


async def far_end(cell: str, run: Path, time_scale: float) -> None:
    """Serve until SIGTERM; run/witness.json is written anew every second, and once more at the end."""
    server = SimServer(load_cell(cell), run, time_scale=time_scale)
    witness = LightWitness(server.world)
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, server.stop)
    await server.start()
    moving = asyncio.create_task(server.run())
    print(server.ready_line(), flush=True)
    try:
        while not moving.done():
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(asyncio.shield(moving), TELL_S)
            await asyncio.to_thread(_tell, run / TOLD, witness)
    finally:
        server.stop()
        await moving
        await server.close()


def _tell(path: Path, witness: LightWitness) -> None:
    fresh = path.with_suffix(".new")
    fresh.write_text(json.dumps(witness.told), encoding="utf-8")
    os.replace(fresh, path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cell", required=True)
    parser.add_argument("--run", required=True, type=Path)
    parser.add_argument("--time-scale", type=float, default=1.0)
    given = parser.parse_args()
    asyncio.run(far_end(given.cell, given.run, given.time_scale))
