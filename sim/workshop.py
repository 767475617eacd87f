"""The metal of a running simulated cell: clamps a plate, follows the motion in a thread of its own, measures what was built."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from config import Cell, ConfigError, load_material
from sim import as_built
from sim.control import Answer, CommandError
from sim.process.clamping import SAMPLE_MM, clamp_block, metal_for
from sim.process.metal import Metal
from sim.process.target import Target
from sim.trace import Trace
from sim.world import World

DEFAULT_MATERIAL = "316L"
MM_PER_UNIT = {"mm": 1.0, "inch": 25.4}


class Workshop:
    """One workpiece at a time. Traces queue up and are worked off in a thread, so that the wires never wait for the metal."""

    def __init__(self, world: World, cell_mm: float) -> None:
        self._world, self._cell_mm = world, cell_mm
        self._thread: ThreadPoolExecutor | None = None
        self._name = ""
        self._metal: Metal | None = None
        self._target: Target | None = None
        self._waiting: list[Trace] = []
        self._work: asyncio.Task[None] | None = None

    async def clamp(self, command: dict[str, Any]) -> Answer:
        """A fresh plate for a part: "mesh" (file), "units", "build_from_part" ((4, 4), default identity), "material", "cell_mm".

        "box_allowance_mm", if given, clamps a box of metal as well, so much larger than the part's on every side but the bottom.
        Raises CommandError when the mesh or the material cannot be read.
        """
        await self._rest()
        cell_mm = float(command.get("cell_mm", self._cell_mm))
        if self._thread is None:
            self._thread = ThreadPoolExecutor(1, thread_name_prefix="metal")
        loop = asyncio.get_running_loop()
        arguments = (
            str(command.get("mesh", "")),
            str(command.get("units", "mm")),
            command.get("build_from_part"),
            str(command.get("material", DEFAULT_MATERIAL)),
            cell_mm,
        )
        metal, target = await loop.run_in_executor(self._thread, _prepare, self._world.cell, *arguments)
        if "box_allowance_mm" in command:
            clamp_block(metal.stock, target.bounds, float(command["box_allowance_mm"]))
        self._metal, self._target, self._name = metal, target, Path(arguments[0]).stem
        self._world.metal = self
        return {"cells": int(np.prod(metal.stock.field.shape)), "cell_mm": cell_mm}

    def apply(self, trace: Trace) -> None:
        """Take a trace of the world; called in every step."""
        if not len(trace) or (not trace.emission_w.any() and np.array_equal(trace.tip0, trace.tip1)):
            return
        self._waiting.append(trace)
        if self._work is None or self._work.done():
            self._work = asyncio.get_running_loop().create_task(self._work_off())

    async def _work_off(self) -> None:
        while self._waiting and self._metal is not None:
            batch, self._waiting = self._waiting, []
            await asyncio.get_running_loop().run_in_executor(self._thread, _apply_all, self._metal, batch)

    async def _rest(self) -> None:
        while self._work is not None and not self._work.done():
            await asyncio.shield(self._work)

    async def measure(self, command: dict[str, Any]) -> Answer:
        """Compare as-built with the part and write as_built.stl, .json and .png to "dir" ("name" and "tolerance_mm" of the part).

        "field": true writes as_built.npz as well: the metal itself, for `sim.as_built.read_field`.
        Raises CommandError when no workpiece is clamped.
        """
        if self._metal is None or self._target is None:
            raise CommandError("no workpiece is clamped: send 'workpiece' with 'mesh' first")
        await self._rest()
        folder = Path(str(command.get("dir", ".")))
        loop = asyncio.get_running_loop()
        name, tolerance_mm = str(command.get("name", self._name)), float(command.get("tolerance_mm", self._cell_mm))
        arguments = self._metal, self._target, folder, name, tolerance_mm, command.get("field") is True
        figures = await loop.run_in_executor(self._thread, _write, *arguments)
        return {"dir": str(folder), "deviation": figures, "passed": figures["passed"]}

    async def close(self) -> None:
        """Finish what waits and end the thread."""
        await self._rest()
        self._world.metal = None
        if self._thread is not None:
            self._thread.shutdown(wait=True)
            self._thread = None


def _apply_all(metal: Metal, traces: list[Trace]) -> None:
    for trace in traces:
        metal.apply(trace)


def _prepare(cell: Cell, mesh: str, units: str, build_from_part: Any, material: str, cell_mm: float) -> tuple[Metal, Target]:
    """Target, plate and stock for a mesh. Raises CommandError."""
    if units not in MM_PER_UNIT:
        raise CommandError(f"workpiece: units {units!r} are unknown; known: {', '.join(MM_PER_UNIT)}")
    try:
        loaded = trimesh.load_mesh(mesh)
        powder = load_material(material)
        transform = (
            np.eye(4) if build_from_part is None else np.asarray(build_from_part, dtype=np.float64).reshape(4, 4)
        )
    except ConfigError as error:
        raise CommandError(error.message) from None
    except (OSError, ValueError, TypeError, NotImplementedError) as error:
        raise CommandError(f"workpiece {mesh!r}: cannot be read: {str(error).splitlines()[0]}") from None
    if not isinstance(loaded, trimesh.Trimesh) or not len(loaded.faces):
        raise CommandError(f"workpiece {mesh!r}: holds no triangles")
    vertices = np.asarray(loaded.vertices) * MM_PER_UNIT[units] @ transform[:3, :3].T + transform[:3, 3]
    target = Target(vertices, np.asarray(loaded.faces, dtype=np.int64), SAMPLE_MM)
    return metal_for(cell, target.bounds, cell_mm, powder), target


def _write(metal: Metal, target: Target, folder: Path, name: str, tolerance_mm: float, with_field: bool) -> dict[str, float | bool]:
    """Measure, and write surface, figures and picture. Raises CommandError when the folder cannot be written."""
    metal.finish()
    try:
        if with_field:
            as_built.write_field(metal.stock.field, folder)
        return as_built.write(metal.stock, target, tolerance_mm, folder, name)
    except OSError as error:
        raise CommandError(f"as_built: {folder}: cannot be written: {error.strerror}") from None
