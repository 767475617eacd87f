"""The simulated cell on free ports, and mbpoll (Debian) as a Modbus master of its own make."""

from __future__ import annotations

import asyncio
import re
import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from config import Cell, load_cell
from sim.server import SimServer

needs_mbpoll = pytest.mark.skipif(shutil.which("mbpoll") is None, reason="mbpoll (Debian package) is not installed")
WAIT_S = 60.0  # until something has come about, on a machine that others use too
PATIENT = ("-o", "5")  # time-out of mbpoll for a device that does answer
HASTY = ("-o", "0.2")


def free_cell(name: str = "trunnion_tcp", **links: dict[str, Any]) -> Cell:
    """A shipped cell on any free ports."""
    cell = load_cell(name)
    changed = {role: link.model_copy(update={"tcp_port": 0, **links.get(role, {})}) for role, link in cell.links.items()}
    return cell.model_copy(update={"links": changed})


@asynccontextmanager
async def running(cell: Cell, run_dir: Path, **options: Any) -> AsyncIterator[SimServer]:
    server = SimServer(cell, run_dir, **options)
    await server.start()
    task = asyncio.create_task(server.run())
    try:
        yield server
    finally:
        server.stop()
        await task
        await server.close()


async def mbpoll(*arguments: str) -> tuple[int, str]:
    process = await asyncio.create_subprocess_exec(
        "mbpoll", *arguments, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
    )
    try:
        output, _ = await asyncio.wait_for(process.communicate(), WAIT_S)
    finally:
        if process.returncode is None:
            process.kill()
            await process.communicate()
    return process.returncode or 0, output.decode(errors="replace")


def values_in(output: str) -> list[float]:
    return [float(value) for value in re.findall(r"^\[\d+\]:\s+(-?[\d.]+)", output, re.M)]
