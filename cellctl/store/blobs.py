"""Files named by the hash of their content: written beside their place, made durable, then moved in one step."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

KINDS = ("parts", "plans", "programs", "proofs", "records", "attachments")
CHUNK_BYTES = 1 << 20


class Blobs:
    """The folder of files. Names come from hashes only, never from a user.

    own : of this host alone, where `folder` is shared; host : the word by which its unfinished files are known there
    """

    def __init__(self, folder: Path, own: Path | None = None, host: str = "") -> None:
        self.folder = folder
        self._own = own or folder
        self._host = host

    def make_folders(self) -> None:
        """Make what is missing."""
        for path in (*(self.folder / kind for kind in KINDS), self.unfinished, self.checkpoints, self.uploads):
            path.mkdir(parents=True, exist_ok=True)

    @property
    def unfinished(self) -> Path:
        """On the file system of what is kept, so that it can be moved there in one step; each host has its own."""
        return self.folder / "staging" / self._host

    def clear_staging(self) -> None:
        """Remove unfinished files of this host; called once, before any writer starts."""
        for path in self.unfinished.iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()

    @contextmanager
    def staging(self) -> Iterator[Path]:
        """A folder of one's own on the same file system, removed afterwards."""
        path = Path(tempfile.mkdtemp(dir=self.unfinished))
        try:
            yield path
        finally:
            shutil.rmtree(path, ignore_errors=True)

    @property
    def checkpoints(self) -> Path:
        """States of proofs at layers, for all parts: the proofs themselves keep the folder to its size. It may be emptied at any time."""
        return self._own / "checkpoints"

    @property
    def uploads(self) -> Path:
        """What has come so far of uploads that can be resumed, a file each, named by the upload's id."""
        return self.folder / "uploads"

    def part(self, sha256: str, suffix: str) -> Path:
        """The uploaded file."""
        return self.folder / "parts" / f"{sha256}{suffix}"

    def mesh(self, mesh_sha256: str) -> Path:
        """The mended mesh as binary STL in mm."""
        return self.folder / "parts" / f"{mesh_sha256}.mesh.stl"

    def thumbnail(self, mesh_sha256: str) -> Path:
        """A small picture of the mended mesh, PNG; made again if it is gone."""
        return self.folder / "parts" / f"{mesh_sha256}.png"

    def figures(self, sha256: str) -> Path:
        """The plan in figures, JSON; made again if it is gone."""
        return self.folder / "plans" / f"{sha256}.figures.json"

    def plan(self, sha256: str) -> Path:
        """plan.h5"""
        return self.folder / "plans" / f"{sha256}.h5"

    def view(self, sha256: str) -> Path:
        """The plan as the console draws it: a folder."""
        return self.folder / "plans" / f"{sha256}.view"

    def program(self, sha256: str) -> Path:
        """The program's folder."""
        return self.folder / "programs" / sha256

    def program_at_hand(self, sha256: str) -> Path:
        """Where the program's folder lies on this host's own disk; the same one where nothing is shared."""
        return self._own / "programs" / sha256

    def proof(self, sha256: str) -> Path:
        """The proof's JSON."""
        return self.folder / "proofs" / f"{sha256}.json"

    def picture(self, sha256: str) -> Path:
        """The proof's picture."""
        return self.folder / "proofs" / f"{sha256}.png"

    def surface(self, sha256: str) -> Path:
        """The as-built surface of the proof, as the console draws it; proofs of earlier versions have none."""
        return self.folder / "proofs" / f"{sha256}.surface"

    def attachment(self, sha256: str) -> Path:
        """A file that somebody left at a job."""
        return self.folder / "attachments" / sha256

    def report(self, sha256: str) -> Path:
        """The proof's report: one HTML file."""
        return self.folder / "proofs" / f"{sha256}.html"

    def record(self, manifest_sha256: str) -> Path:
        """The sealed record's folder."""
        return self.folder / "records" / manifest_sha256


def sha256_of(path: Path) -> str:
    """Hash (hex) of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def copy_hashed(source: BinaryIO, target: Path) -> tuple[str, int]:
    """Copy a stream into a new file, chunk by chunk; returns (sha256 hex, bytes)."""
    digest, size = hashlib.sha256(), 0
    with target.open("xb") as file:
        while chunk := source.read(CHUNK_BYTES):
            digest.update(chunk)
            size += len(chunk)
            file.write(chunk)
    return digest.hexdigest(), size


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def place(source: Path, target: Path) -> None:
    """Make a file or folder durable and move it to its place in one step. The same content may be there already."""
    inside = sorted(source.rglob("*")) if source.is_dir() else []
    for path in (*inside, source):
        _sync(path)
    if source.is_dir():
        if target.is_dir():
            return
        try:
            source.rename(target)
        except OSError:  # another writer was first with the same content
            if not target.is_dir():
                raise
    else:
        source.replace(target)
    _sync(target.parent)
