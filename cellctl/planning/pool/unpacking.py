"""An order as a task of the planning machine: its files under their names in a folder of the task's own."""

from __future__ import annotations

from pathlib import Path

import msgspec

from cellctl.planning.pool.cache import Cache
from cellctl.planning.pool.order import File, Order, check_file
from cellctl.planning.pool.packing import with_devices
from cellctl.planning.task import Link, Task
from cellctl.store.blobs import sha256_of

READ, MADE = "read", "made"  # folders of a task: what it reads, and where its results go


def unpacked(order: Order, cache: Cache, folder: Path, checkpoints: Path) -> Task:
    """The task with its files in `folder`. Blocks. Raises OrderError, OSError for a file that is gone from the cache, ConfigError for its cell."""
    read, made = folder / READ, folder / MADE
    made.mkdir(parents=True)
    cache.place([check_file(file) for file in order.files], read)

    def at(name: str) -> str:
        return str(read / name) if name else ""

    task = order.task
    if task.cell:
        with_devices(read / task.cell)
        _check_cell(order, read / task.cell)
    return msgspec.structs.replace(
        task,
        folder=str(made), checkpoints=str(checkpoints) if task.checkpoints else "", mesh=at(task.mesh), stock=at(task.stock),
        plan=at(task.plan), program=at(task.program), cell=at(task.cell),
        links=[Link(at(link.program), link.line, link.fraction) for link in task.links],
    )  # fmt: skip


def _check_cell(order: Order, path: Path) -> None:
    """Raises ConfigError where the cell reads otherwise here than at the service."""
    from config import ConfigError, load_cell

    cell = load_cell(path)
    if (cell.sha256, cell.twin_sha256) != (order.cell_sha256, order.twin_sha256):
        raise ConfigError("the cell's facts arrived other than they were sent", "install the same version of the software on both machines")


def results(made: Path) -> list[File]:
    """What a task wrote into its folder, with hashes; links out of it are none of it. Blocks."""
    files = (path for path in sorted(made.rglob("*")) if path.is_file() and not path.is_symlink())
    return [_told(path, made) for path in files if path.name != "material.toml" or path.parent != made]


def _told(path: Path, made: Path) -> File:
    return File(path.relative_to(made).as_posix(), sha256_of(path), path.stat().st_size)


def finished_so_far(made: Path, folder: str, seen: set[str]) -> list[File]:
    """Files of one folder of a task that still runs, without those that were told before. Blocks."""
    names = sorted(path for path in (made / folder).glob("*") if path.suffix != ".part" and f"{folder}/{path.name}" not in seen)
    return [_told(path, made) for path in names]
