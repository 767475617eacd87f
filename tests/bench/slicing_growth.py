"""One measurement of slicing in a process of its own, so that the peak of memory is its own: bands and planes as words."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from planner.mesh import Mesh
from planner.slicing import slice_mesh

RADIUS_MM = 20.0


def ball(bands: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices and facets of a ball of `bands` rings of 4 · `bands` vertices between its poles: 8 bands² facets."""
    around = 4 * bands
    turn = 2.0 * np.pi * np.arange(around) / around
    tilt = np.pi * np.arange(1, bands + 1)[:, None] / (bands + 1)
    rings = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt) + 0.0 * turn], axis=-1)
    vertices = RADIUS_MM * np.vstack([rings.reshape(-1, 3), [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]])
    number = np.arange(around * bands).reshape(bands, around)
    after = np.roll(number, -1, axis=1)
    top, low = np.full(around, around * bands), np.full(around, around * bands + 1)
    parts = [(number[1:], after[1:], after[:-1]), (number[1:], after[:-1], number[:-1])]
    parts += [(number[0], after[0], top), (after[-1], number[-1], low)]
    return vertices, np.vstack([np.column_stack([corner.ravel() for corner in part]) for part in parts])


def memory_bytes(field: str) -> int:
    """What /proc says of this process: VmRSS, memory held now, or VmHWM, the most since the peak was last reset."""
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith(field + ":"):
            return 1024 * int(line.split()[1])
    raise LookupError(f"/proc/self/status has no {field}")


def main(bands: int, count: int) -> None:
    """Print facets, crossed pairs, ms of the first cut, of pairing alone, of a later cut, bytes of mesh and of growth."""
    heights = RADIUS_MM * (np.arange(count) + 0.5) / count * 2.0 - RADIUS_MM
    planes = np.column_stack([np.zeros((count, 2)), heights, np.tile([0.0, 0.0, 1.0], (count, 1))])
    small = Mesh(*ball(8))
    slice_mesh(small, planes)
    vertices, facets = ball(bands)
    mesh = Mesh(vertices, facets)
    del vertices, facets
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the peak starts anew from what is held
    held = memory_bytes("VmRSS")
    started = time.process_time()
    sections = slice_mesh(mesh, planes)
    first_ms = 1e3 * (time.process_time() - started)
    growth = memory_bytes("VmHWM") - held
    crossed = sum(len(loop.points) for section in sections for loop in section.loops)
    del sections
    pair_ms = least_ms(lambda: Mesh(mesh.vertices, mesh.facets).across)
    ours_ms = least_ms(lambda: slice_mesh(mesh, planes))
    print(len(mesh.facets), crossed, first_ms, pair_ms, ours_ms, mesh.vertices.nbytes + mesh.facets.nbytes, growth)


def least_ms(work: Callable[[], object]) -> float:
    """Least CPU time of three runs, ms."""
    times = []
    for _ in range(3):
        started = time.process_time()
        work()
        times.append(time.process_time() - started)
    return 1e3 * min(times)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
