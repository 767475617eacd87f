"""Backup and restore of a store: one tar file, taken while the service runs, complete or refused.

Of a store that is shared it holds what this host has for itself: what its cell process wrote, and the key. The shared database is backed
up by `pg_dump`, the shared files by a copy that is taken after it: who restores both has all that the dump names.

The database comes first, as one state of it (SQLite's online backup), then the files that it names: they are named by their
content, written before the row that names them and never changed, so that every row of the copy finds its file. The manifest at
the end holds the hash of every member. A restore checks all of it beside its place and moves it there in one step.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import sqlite3
import tarfile
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from cellctl.store.blobs import KINDS
from cellctl.store.engine import DATABASE, StoreError
from cellctl.store.shared import shared_of

SCHEMA = 1
MANIFEST = "backup.json"
BESIDE = ("record.key",)
"""Files beside the database that cannot be made anew. Who reads a backup can sign records in this service's name: keep it as safe as the store."""
CHUNK_BYTES = 1 << 20
Told = Callable[[str, float], None]


@dataclass(frozen=True)
class Backup:
    """What a backup holds. at : Unix time (s); revision : of the schema; bytes : of all members; not_in_it : what is to be backed up besides"""

    at: float
    revision: str
    files: int
    bytes: int
    not_in_it: str = ""


class _Hashing:
    """A reader that hashes what goes through it."""

    def __init__(self, source: IO[bytes]) -> None:
        self._source = source
        self.digest = hashlib.sha256()

    def read(self, size: int = -1) -> bytes:
        """The next bytes."""
        data = self._source.read(size)
        self.digest.update(data)
        return data


def back_up(store: Path, target: Path, at: float, told: Told = lambda _stage, _share: None) -> Backup:
    """Write a backup of a store into a new file. Raises StoreError; then there is no file."""
    if not (store / DATABASE).is_file():
        raise StoreError(f"{store}: there is no store here", "name its folder with --store")
    shared = shared_of(store)
    if target.exists():
        raise StoreError(f"{target}: is there already", "name a new file; a backup is never written over another")
    beside = target.with_name(f".{target.name}.part")
    try:
        with tempfile.TemporaryDirectory(dir=target.parent) as scratch:
            copy = Path(scratch) / DATABASE
            revision = _copy_database(store / DATABASE, copy, told)
            with beside.open("xb") as raw, tarfile.open(fileobj=raw, mode="w", format=tarfile.PAX_FORMAT) as tar:
                hashes = _add_all(tar, copy, store, shared is None, told)
                size = sum(entry["bytes"] for entry in hashes.values())
                document = {"schema": SCHEMA, "at": at, "revision": revision, "files": hashes}
                _add_bytes(tar, MANIFEST, json.dumps(document, indent=1).encode())
                tar.close()
                raw.flush()
                os.fsync(raw.fileno())
        os.link(beside, target)
    except FileExistsError:
        line = f"{target}: is there already, or a backup to it is under way ({beside.name})"
        raise StoreError(line, "name another file, or remove what is left") from None
    except (OSError, sqlite3.Error, tarfile.TarError) as error:
        raise StoreError(f"{target}: the backup cannot be written: {error}", "make room, or name a place that can be written") from None
    finally:
        beside.unlink(missing_ok=True)
    if shared is None:
        return Backup(at, revision, len(hashes), size)
    line = f"jobs, people and the audit trail in {shared.database.render_as_string()} (pg_dump), then the files in {shared.files}"
    return Backup(at, revision, len(hashes), size, line)


def _copy_database(source: Path, target: Path, told: Told) -> str:
    """One state of the database, beside writers; its schema's revision."""
    with closing(sqlite3.connect(f"file:{source}?mode=ro", uri=True)) as live, closing(sqlite3.connect(target)) as copy:
        told("database", 0.0)
        live.backup(copy)  # in one step: a copy in several begins anew with every commit of another process; in WAL nobody waits for a reader
        copy.execute("PRAGMA journal_mode=DELETE")
        row = copy.execute("SELECT version_num FROM alembic_version").fetchone()
    return str(row[0])


def _add_all(tar: tarfile.TarFile, database: Path, store: Path, has_files: bool, told: Told) -> dict[str, dict[str, Any]]:
    """Database, key and blobs; name -> {sha256, bytes}."""
    beside = [(name, store / name) for name in BESIDE if (store / name).is_file()]
    members = [(DATABASE, database), *beside, *(_blobs(store / "blobs") if has_files else ())]
    hashes = {}
    for k, (name, path) in enumerate(members):
        told("files", k / len(members))
        info = tar.gettarinfo(path, name)
        info.uid = info.gid = 0
        info.uname = info.gname = ""
        with path.open("rb") as file:
            source = _Hashing(file)
            tar.addfile(info, source)
        hashes[name] = {"sha256": source.digest.hexdigest(), "bytes": info.size}
    return hashes


def _blobs(folder: Path) -> Iterator[tuple[str, Path]]:
    for kind in KINDS:
        for path in sorted((folder / kind).rglob("*")):
            if path.is_file():
                yield f"blobs/{path.relative_to(folder).as_posix()}", path


def _add_bytes(tar: tarfile.TarFile, name: str, data: bytes) -> None:
    info = tarfile.TarInfo(name)
    info.size = len(data)
    tar.addfile(info, io.BytesIO(data))


def restore(source: Path, store: Path, told: Told = lambda _stage, _share: None) -> Backup:
    """Make a store from a backup; the folder must not be there yet, or be empty. Raises StoreError; then nothing was made."""
    if store.exists() and (not store.is_dir() or any(store.iterdir())):
        raise StoreError(f"{store}: is not empty", "name a new folder; then serve with --store, or move the old one away first")
    store.parent.mkdir(parents=True, exist_ok=True)
    beside = Path(tempfile.mkdtemp(dir=store.parent, prefix=f".{store.name}."))
    try:
        document = _unpack(source, beside, told)
        _check_database(source, beside / DATABASE)
        if store.exists():
            store.rmdir()
        beside.rename(store)
    except (OSError, tarfile.TarError, EOFError, ValueError, KeyError) as error:
        raise StoreError(f"{source}: cannot be restored: {error}", "take another backup") from None
    finally:
        shutil.rmtree(beside, ignore_errors=True)
    files = document["files"]
    return Backup(document["at"], document["revision"], len(files), sum(entry["bytes"] for entry in files.values()))


def _unpack(source: Path, folder: Path, told: Told) -> dict[str, Any]:
    """All members into the folder; the manifest. Raises ValueError where one is not what the manifest says."""
    found: dict[str, str] = {}
    document: dict[str, Any] | None = None
    total = max(source.stat().st_size, 1)
    with source.open("rb") as raw, tarfile.open(fileobj=raw, mode="r|") as tar:
        for member in tar:
            told("files", raw.tell() / total)
            stream = tar.extractfile(member)
            if stream is None or not member.isfile():
                raise ValueError(f"{member.name}: is no file")
            if member.name == MANIFEST:
                document = json.loads(stream.read())
                continue
            found[member.name] = _write(stream, _inside(folder, member.name))
    if document is None:
        raise ValueError("it ends before its manifest: the file was cut off")
    if document["schema"] > SCHEMA:
        raise ValueError(f"it was written by a newer version (schema {document['schema']})")
    wanted = {name: entry["sha256"] for name, entry in document["files"].items()}
    wrong = sorted(name for name in wanted.keys() | found.keys() if wanted.get(name) != found.get(name))
    if wrong:
        raise ValueError(f"{wrong[0]}: is not what was backed up" + (f", and {len(wrong) - 1} more" if len(wrong) > 1 else ""))
    return document


def _inside(folder: Path, name: str) -> Path:
    """Where a member goes. Raises ValueError for a name that leads elsewhere."""
    parts = name.split("/")
    known = name == DATABASE or name in BESIDE or (parts[0] == "blobs" and len(parts) >= 3 and parts[1] in KINDS)
    if not known or any(part in ("", ".", "..") or "\\" in part or "\0" in part for part in parts):
        raise ValueError(f"{name[:80]!r}: has no place in a store")
    return folder / name


def _write(stream: IO[bytes], path: Path) -> str:
    """A new file, durable; its SHA-256 (hex)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    digest = hashlib.sha256()
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "wb") as file:
        while chunk := stream.read(CHUNK_BYTES):
            digest.update(chunk)
            file.write(chunk)
        file.flush()
        os.fsync(file.fileno())
    return digest.hexdigest()


def _check_database(source: Path, database: Path) -> None:
    """Raises StoreError if the copy is damaged."""
    try:
        with closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True)) as copy:
            told = [str(row[0]) for row in copy.execute("PRAGMA integrity_check")]
    except sqlite3.Error as error:
        told = [str(error)]
    if told != ["ok"]:
        raise StoreError(f"{source}: its database is damaged: {told[0]}", "take another backup")
