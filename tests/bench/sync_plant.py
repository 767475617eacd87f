"""A simulated cell in a process of its own whose plant is exact in time: it is brought up to the instant of every write and every query.

`python -m tests.bench.sync_plant CELL RUN_DIR TRACE.json DELAY_S JITTER_S AT_BAUD`: until SIGTERM, then the edges of light are written.
"""

from __future__ import annotations

import asyncio
import json
import random
import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from config.cell import load_cell
from sim.server import LAG_MAX_S, SimServer
from tests.bench.sync_edges import Light

PACE_S = 0.002


class ExactServer(SimServer):
    """Time goes on at least every PACE_S, and before anything from outside takes effect."""

    def __init__(self, *args: Any, delay_s: float, jitter_s: float, **options: Any) -> None:
        super().__init__(*args, **options)
        self.light = Light(self.cell.placement.part_origin_mm)
        self.world.metal = self.light
        self._delay_s, self._jitter_s, self._random = delay_s, jitter_s, random.Random(5)
        self._last = time.monotonic()
        bank, receive = self.world.banks["laser"], self.world.cnc.receive
        write = bank.write

        def exact_write(table: str, address: int, values: Sequence[int]) -> None:
            self.catch_up()
            write(table, address, values)

        def exact_receive(data: bytes) -> None:
            if b"?" in data:
                self.catch_up()
            receive(data)

        bank.write = exact_write  # type: ignore[method-assign]
        self.world.cnc.receive = exact_receive  # type: ignore[method-assign]

    def catch_up(self) -> float:
        """Bring the world to now; how far it went (s)."""
        now = time.monotonic()
        passed, self._last = min(now - self._last, LAG_MAX_S), now
        for role in ("laser", "feeder"):
            self.world.wires[role].delay_s = self._delay_s + self._jitter_s * self._random.random()
        if passed > 0.0:
            self.world.step(passed)
        return passed

    async def run(self) -> None:
        """Until `stop`."""
        while not self._stopping.is_set():
            await asyncio.sleep(PACE_S)
            passed = self.catch_up()
            await self._wires.tend()
            self._wires.pace(passed)


async def main(cell: str, run_dir: Path, trace: Path, delay_s: float, jitter_s: float, at_baud: bool) -> None:
    """Serve until told to end, then write what was seen."""
    server = ExactServer(load_cell(cell), run_dir, delay_s=delay_s, jitter_s=jitter_s, at_baud=at_baud)
    stop: Callable[[], None] = server.stop
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stop)
    await server.start()
    print(server.ready_line(), flush=True)
    await server.run()
    await server.close()
    trace.write_text(json.dumps({"edges": server.light.edges, "moving": server.light.moving[::5]}), encoding="utf-8")


if __name__ == "__main__":
    words = sys.argv[1:]
    asyncio.run(main(words[0], Path(words[1]), Path(words[2]), float(words[3]), float(words[4]), words[5] == "1"))
