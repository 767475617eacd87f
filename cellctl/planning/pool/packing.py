"""A task of this machine as an order for another: every file it reads by name, size and hash, its cell with all that the cell's file names."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from cellctl.planning.pool.order import File, check_name
from cellctl.planning.task import Link, Task
from cellctl.store.blobs import sha256_of

CELL_FILE = "cell/cell.toml"
_UNFIT = re.compile(r"[^A-Za-z0-9._-]")


@dataclass
class Hashes:
    """Hashes of files that were read before and have not changed since, by inode, size and time of change."""

    known: dict[tuple[int, int, int, int], str] = field(default_factory=dict)

    def of(self, path: Path) -> tuple[str, int]:
        """(sha256 hex, bytes) of a file. Raises OSError."""
        seen = path.stat()
        key = (seen.st_dev, seen.st_ino, seen.st_size, seen.st_mtime_ns)
        if key not in self.known:
            if len(self.known) > 10_000:
                self.known.clear()
            self.known[key] = sha256_of(path)
        return self.known[key], seen.st_size


@dataclass(frozen=True)
class Packed:
    """task : its paths are names of files   files : all that it reads   paths : where they lie here, by hash"""

    task: Task
    files: list[File]
    paths: dict[str, Path]
    cell_sha256: str
    twin_sha256: str


class Packing:
    """One task being packed. root : folder of the store's files, which other machines may see as well   scratch : for files that are written here"""

    def __init__(self, root: Path | None, scratch: Path, hashes: Hashes) -> None:
        self._root = root.resolve() if root is not None else None
        self._scratch = scratch
        self._hashes = hashes
        self._files: dict[str, File] = {}
        self._paths: dict[str, Path] = {}

    def pack(self, task: Task) -> Packed:
        """Blocks while large files are hashed. Raises OSError, ConfigError."""
        links = [
            Link(self._folder(link.program, f"link{number}"), link.line, link.fraction) for number, link in enumerate(task.links)
        ]
        cell, cell_sha256, twin_sha256 = self._cell(task.cell)
        packed = msgspec.structs.replace(
            task,
            folder="", parent=0, memory_bytes=0, checkpoints="checkpoints" if task.checkpoints else "",
            mesh=self._file(task.mesh, "mesh"), stock=self._file(task.stock, "stock"), plan=self._file(task.plan, "plan"),
            program=self._folder(task.program, "before"), links=links, cell=cell,
        )  # fmt: skip
        return Packed(packed, list(self._files.values()), self._paths, cell_sha256, twin_sha256)

    def _add(self, path: Path, name: str) -> str:
        sha256, size = self._hashes.of(path)
        self._files[check_name(name)] = File(name, sha256, size, self._shared(path))
        self._paths[sha256] = path
        return name

    def _shared(self, path: Path) -> str:
        whole = path.resolve()
        if self._root is None or not whole.is_relative_to(self._root):
            return ""
        return whole.relative_to(self._root).as_posix()

    def _file(self, path: str, where: str) -> str:
        """The name keeps the file's own: messages tell it."""
        return self._add(Path(path), f"{where}/{_fit(Path(path).name)}") if path else ""

    def _folder(self, path: str, where: str) -> str:
        """A program's folder, file by file; its name is the program's hash."""
        if not path:
            return ""
        folder = Path(path)
        name = f"{where}/{_fit(folder.name)}"
        inside = sorted(one for one in folder.rglob("*") if one.is_file())
        if not inside:
            raise FileNotFoundError(2, "No such program", str(folder))
        for one in inside:
            self._add(one, f"{name}/{one.relative_to(folder).as_posix()}")
        return name

    def _cell(self, path: str) -> tuple[str, str, str]:
        """The cell as a document of its own: shapes and register maps lie beside it. Raises ConfigError."""
        if not path:
            return "", "", ""
        import tomli_w

        from config import load_cell

        cell = load_cell(path)
        document: dict[str, Any] = cell.model_dump(mode="json", exclude_none=True)
        for number, solid in enumerate(document.get("machine", {}).get("solids", [])):
            if solid.get("shape") == "stl":
                solid["file"] = Path(self._add(Path(solid["file"]), f"cell/solid_{number}.stl")).name
        for role, link in document["links"].items():
            if Path(link["device"]).suffix == ".toml":
                link["device"] = Path(self._add(Path(link["device"]), f"cell/device_{_fit(role)}.toml")).name
        text = tomli_w.dumps(document).encode()
        written = self._scratch / "cell.toml"
        written.write_bytes(text)
        return self._add(written, CELL_FILE), cell.sha256, cell.twin_sha256


def _fit(name: str) -> str:
    """A file's own name without what other machines may not take."""
    return _UNFIT.sub("_", name).lstrip(".-")[-120:] or "file"


def with_devices(cell_file: Path) -> None:
    """Where a packed cell names register maps beside it, name them by their whole path: such names are looked for from where a process runs."""
    import tomli_w

    document = tomllib.loads(cell_file.read_text(encoding="utf-8"))
    beside = {one.name for one in cell_file.parent.glob("device_*.toml")}
    named = [link for link in document["links"].values() if link["device"] in beside]
    for link in named:
        link["device"] = str(cell_file.parent / link["device"])
    if named:
        part = cell_file.with_suffix(".part")  # the file itself may be one with the cache's
        part.write_text(tomli_w.dumps(document), encoding="utf-8")
        part.replace(cell_file)
