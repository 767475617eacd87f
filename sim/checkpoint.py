"""Checkpoints of a proof: states at the begins of layers, in files named after everything that they depend on; the least that differs is written.

A file is a NumPy archive without pickled objects: plain data as JSON and arrays. What is read can therefore hold wrong figures but no code;
a folder of checkpoints is to be trusted as far as the proofs that are made from it. A file that is damaged, cut short or of another run is
not used.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from config import Cell, Device, Material
from sim.job import Job
from sim.process.clamping import TriangleMesh
from sim.state import StateError

SCHEMA = 1
SUFFIX = ".proof-checkpoint.npz"
KEY_LENGTH = 40  # characters of a key that name its file
FOLDER_BYTES_MAX = 1 << 30  # of all checkpoints in one folder
CHAIN_MAX = 4096  # files that one state is put together from
FILE_BYTES_MAX = 1 << 31  # unpacked: what claims to be larger is damaged
DIRECTORY = "directory"  # array that says where the rows of its neighbours belong: rows are told apart by place, not by number
COMMENT = re.compile(r"\([^)\n]*\)")  # does nothing: a header that tells the plan's hash and time leaves the run as it is

Arrays = dict[str, NDArray[Any]]
Say = Callable[[str], None]
DAMAGED = (OSError, ValueError, KeyError, IndexError, TypeError, EOFError, zipfile.BadZipFile, zlib.error, RecursionError, StateError)


class Place(NamedTuple):
    """A point of the Program where its state may be kept: before line `line` (N-word), which begins `layer`."""

    line: int
    layer: int
    key: str


class Checkpoints:
    """The checkpoints of one run in one folder.

    say : gets one line when something is not used or not kept
    Raises OSError when the folder cannot be made.
    """

    def __init__(self, folder: Path, say: Say) -> None:
        self._folder, self.say = folder, say
        self._last: tuple[str, Arrays] | None = None
        self._used: set[Path] = set()
        self._is_full = False
        folder.mkdir(parents=True, exist_ok=True)

    def latest(self, places: list[Place]) -> Iterator[tuple[Place, Any]]:
        """States that fit, the latest first: (place, tree as it was kept). The caller takes the first that it can use."""
        for place in reversed(places):
            path = self._path(place.key)
            if not path.exists():
                continue
            try:
                tree, arrays, chain = self._read(place.key)
            except DAMAGED as error:
                self.say(f"checkpoint of layer {place.layer} ({path.name}) is damaged and not used: {_one_line(error)}")
                continue
            self._last = place.key, arrays
            self._used.update(chain)
            yield place, _graft(tree, arrays)

    def keep(self, place: Place, tree: Any) -> None:
        """Write the state at a place, as what differs from the one before. Says so once when it cannot be written or the folder is full."""
        if self._is_full:
            return
        arrays: Arrays = {}
        plain = _prune(tree, "", arrays)
        parent, before = self._last or ("", {})
        members = _difference(before, arrays)
        head = {"schema": SCHEMA, "key": place.key, "parent": parent, "layer": place.layer, "tree": plain}
        members["head"] = np.frombuffer(json.dumps(head).encode(), dtype=np.uint8)
        size = sum(member.nbytes for member in members.values())
        try:
            if self._bytes_of(self._used) + size > FOLDER_BYTES_MAX:
                self._is_full = True
                self.say(f"checkpoints fill {FOLDER_BYTES_MAX >> 20} MB: later layers keep none")
                return
            self._write(self._path(place.key), members)
        except OSError as error:
            self._is_full = True
            self.say(f"checkpoints cannot be written in {self._folder}: {error.strerror or error}")
            return
        self._last = place.key, arrays

    def sweep(self) -> None:
        """Remove the oldest files of other runs until the folder keeps to its size. Files that vanish meanwhile are fine."""
        others = []
        for path in self._folder.glob("*" + SUFFIX):
            if path not in self._used:
                with contextlib.suppress(OSError):
                    seen = path.stat()
                    others.append((seen.st_mtime_ns, path.name, seen.st_size, path))
        total = self._bytes_of(self._used) + sum(size for _, _, size, _ in others)
        for _, _, size, path in sorted(others):
            if total <= FOLDER_BYTES_MAX:
                return
            with contextlib.suppress(OSError):
                path.unlink()
                total -= size

    def _path(self, key: str) -> Path:
        return self._folder / (key[:KEY_LENGTH] + SUFFIX)

    @staticmethod
    def _bytes_of(paths: set[Path]) -> int:
        total = 0
        for path in paths:
            with contextlib.suppress(OSError):
                total += path.stat().st_size
        return total

    def _write(self, path: Path, members: Arrays) -> None:
        """Under another name first: a file that is there is whole."""
        draft = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            with draft.open("wb") as file:
                np.savez(file, **members)  # type: ignore[arg-type]
            draft.replace(path)
        finally:
            draft.unlink(missing_ok=True)
        self._used.add(path)

    def _read(self, key: str) -> tuple[Any, Arrays, set[Path]]:
        """Plain data and arrays of a checkpoint, put together from its first file on. Raises one of DAMAGED."""
        chain: list[tuple[dict[str, Any], Arrays]] = []
        paths: set[Path] = set()
        while key:
            path = self._path(key)
            head, members = _load(path)
            if head["schema"] != SCHEMA or head["key"] != key or len(chain) >= CHAIN_MAX or path in paths:
                raise StateError("it belongs to another state")
            chain.append((head, members))
            paths.add(path)
            key = head["parent"]
        arrays: Arrays = {}
        for _, members in reversed(chain):
            arrays = _apply(arrays, members)
        return chain[0][0]["tree"], arrays, paths


def _one_line(error: BaseException) -> str:
    text = str(error).splitlines()
    return text[0] if text else type(error).__name__


def _load(path: Path) -> tuple[dict[str, Any], Arrays]:
    """Head and arrays of one file."""
    with zipfile.ZipFile(path) as archive:
        if sum(member.file_size for member in archive.infolist()) > FILE_BYTES_MAX:
            raise StateError("it claims to be larger than any checkpoint")
    with np.load(path, allow_pickle=False) as file:
        members = {name: file[name] for name in file.files}
    head = json.loads(members.pop("head").tobytes())
    if not isinstance(head, dict):
        raise StateError("its head is no table")
    return head, members


def _prune(tree: Any, path: str, arrays: Arrays) -> Any:
    """The tree with its arrays taken out by name."""
    if isinstance(tree, np.ndarray):
        arrays[path] = tree
        return {"array": path}
    if isinstance(tree, dict):
        return {name: _prune(item, f"{path}/{name}", arrays) for name, item in tree.items()}
    if isinstance(tree, (list, tuple)):
        return [_prune(item, f"{path}/{n}", arrays) for n, item in enumerate(tree)]
    return tree.item() if isinstance(tree, np.generic) else tree


def _graft(tree: Any, arrays: Arrays) -> Any:
    """The arrays put back."""
    if isinstance(tree, dict):
        if set(tree) == {"array"}:
            return arrays[tree["array"]]
        return {name: _graft(item, arrays) for name, item in tree.items()}
    return [_graft(item, arrays) for item in tree] if isinstance(tree, list) else tree


def _places(arrays: Arrays, name: str) -> NDArray[np.int64]:
    """What identifies each row of an array: its place in the directory beside it, if that has as many blocks, else its number."""
    rows = len(arrays[name])
    directory = arrays.get(name.rpartition("/")[0] + "/" + DIRECTORY)
    if directory is not None and not name.endswith("/" + DIRECTORY):
        blocks = np.flatnonzero(directory.ravel() >= 0)
        if len(blocks) == rows:
            return blocks
    return np.arange(rows)


def _difference(before: Arrays, now: Arrays) -> Arrays:
    """What is needed to make `now` of `before`: whole arrays, or the rows that differ."""
    members: Arrays = {}
    for name, array in now.items():
        old = before.get(name)
        if old is None or array.ndim == 0 or old.ndim == 0 or old.dtype != array.dtype or old.shape[1:] != array.shape[1:]:
            members["whole:" + name] = array
            continue
        old_places, places = _places(before, name), _places(now, name)
        at = np.minimum(np.searchsorted(old_places, places), max(0, len(old_places) - 1))
        known = old_places[at] == places if len(old_places) else np.zeros(len(places), dtype=bool)
        differs = ~known
        if known.any():
            width = max(1, int(np.prod(array.shape[1:])))
            differs[known] = (_bits(array[known]).reshape(-1, width) != _bits(old[at[known]]).reshape(-1, width)).any(axis=1)
        chosen = np.flatnonzero(differs)
        members["rows:" + name] = np.concatenate(([len(array)], chosen))
        members["values:" + name] = array[chosen]
    return members


def _bits(array: NDArray[Any]) -> NDArray[Any]:
    """Floats as whole numbers of the same bits, so that NaN equals itself and -0 does not equal 0."""
    if array.dtype.kind != "f":
        return array
    return np.ascontiguousarray(array).view(np.dtype(f"u{array.dtype.itemsize}"))


def _apply(before: Arrays, members: Arrays) -> Arrays:
    """Undo `_difference`. Directories come first: they say where rows belong."""
    now: Arrays = {name.partition(":")[2]: array for name, array in members.items() if name.startswith("whole:")}
    names = [name.partition(":")[2] for name in members if name.startswith("rows:")]
    for name in sorted(names, key=lambda name: not name.endswith("/" + DIRECTORY)):
        old, values = before[name], members["values:" + name]
        count, chosen = int(members["rows:" + name][0]), members["rows:" + name][1:]
        array = np.empty((count, *old.shape[1:]), dtype=old.dtype)
        now[name] = array
        old_places, places = _places(before, name), _places(now, name)
        kept = np.ones(count, dtype=bool)
        kept[chosen] = False
        at = np.searchsorted(old_places, places[kept])
        if (at >= len(old_places)).any() or (old_places[at] != places[kept]).any():
            raise StateError("rows are missing")
        array[kept], array[chosen] = old[at], values
    return now


class Prefix:
    """Hash of everything that the state before a line depends on: facts that stand for the whole run, then lines, table and schedule."""

    def __init__(self, facts: list[bytes]) -> None:
        self._digest = hashlib.sha256()
        for fact in facts:
            self._add(fact)

    def _add(self, data: bytes) -> None:
        self._digest.update(len(data).to_bytes(8, "little"))
        self._digest.update(data)

    def places(self, lines: tuple[str, ...], table: NDArray[np.void], schedule: NDArray[np.void], begins: list[int]) -> list[Place]:
        """A Place for each line of `begins` (N-words, rising)."""
        found = []
        done, entry = 0, 0
        entry_lines = schedule["n"]
        waits = set(entry_lines[schedule["barrier"] == 1].tolist())
        for begin in begins:
            upto = int(np.searchsorted(entry_lines, begin, side="left"))
            self._add(COMMENT.sub("", "\n".join(lines[done : begin - 1])).encode())
            self._add(b"".join(table[name][done : begin - 1].astype("<i8").tobytes() for name in ("kind", "layer", "operation")))
            self._add(schedule[entry:upto].tobytes())
            self._add(bytes([begin in waits]))
            done, entry = begin - 1, upto
            layer = int(table["layer"][begin - 1])
            found.append(Place(begin, layer, self._digest.hexdigest()))
        return found


def facts_of_run(
    program: Job, cell: Cell, devices: Mapping[Any, Device], material: Material, mesh: TriangleMesh, stock: TriangleMesh | None, cell_mm: float
) -> list[bytes]:
    """What the whole run depends on besides lines, table and schedule, and the code that makes it."""
    wires: dict[str, bool | set[str]] = {"mode": True, "cnc": {"port", "baud"}, "links": True, "service": True}
    texts = [cell.model_dump_json(exclude=wires), cell.twin_sha256, material.model_dump_json(), repr(cell_mm), program.process, program.gate]
    texts += [repr(program.tolerance_mm), repr(program.stock_allowance_mm)]
    texts += [device.model_dump_json() for _, device in sorted(devices.items())]
    arrays = [program.machine_from_build, program.build_from_part, program.work_offset]
    for shape in (mesh, stock):
        if shape is not None:
            arrays += [np.asarray(shape.vertices, dtype=np.float64), np.asarray(shape.facets, dtype=np.int64)]
    return [code_sha256(), *(text.encode() for text in texts), *(np.ascontiguousarray(array).tobytes() for array in arrays)]


@cache
def code_sha256() -> bytes:
    """Hash of the code that makes a proof and of the NumPy under it: another version begins anew. Read once: the code that runs is loaded."""
    digest = hashlib.sha256(np.__version__.encode())
    root = Path(__file__).parent
    for path in sorted((*root.rglob("*.py"), *(root.parent / "config").glob("*.py"))):
        digest.update(path.relative_to(root.parent).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.digest()
