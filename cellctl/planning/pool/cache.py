"""Files that a planning machine keeps, named by the hash of their content: checked when they arrive and whenever they are used, bounded in size."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable
from pathlib import Path

from cellctl.planning.pool.order import CHUNK_BYTES, File, OrderError
from cellctl.store.blobs import copy_hashed, sha256_of


class Cache:
    """folder : of the files   limit_bytes : of all of them; what was used least recently goes first

    shared : the store's files, where this machine sees them
    """

    def __init__(self, folder: Path, limit_bytes: int, shared: Path | None = None) -> None:
        self._folder, self._limit_bytes = folder, limit_bytes
        self._shared = shared.resolve() if shared is not None else None
        folder.mkdir(parents=True, exist_ok=True)
        for unfinished in folder.glob("*.part"):
            unfinished.unlink(missing_ok=True)

    def _path(self, sha256: str) -> Path:
        return self._folder / sha256

    def missing(self, files: Iterable[File]) -> list[File]:
        """Those that are neither here nor in the shared folder, each content once; what is in the shared folder is taken over. Blocks."""
        unique = {file.sha256: file for file in files}
        return [file for file in unique.values() if not self._is_whole(file) and not self._taken_over(file)]

    def _is_whole(self, file: File) -> bool:
        path = self._path(file.sha256)
        try:
            if path.stat().st_size == file.size and sha256_of(path) == file.sha256:
                os.utime(path)
                return True
        except FileNotFoundError:
            return False
        path.unlink(missing_ok=True)  # what is damaged is fetched anew
        return False

    def _taken_over(self, file: File) -> bool:
        """Copy a file out of the shared folder, if it holds the same content there."""
        if self._shared is None or not file.shared:
            return False
        source = (self._shared / file.shared).resolve()
        part = self._folder / f"{file.sha256}.{os.getpid()}.shared.part"
        part.unlink(missing_ok=True)
        try:
            if not source.is_relative_to(self._shared) or source.stat().st_size != file.size:
                return False
            with source.open("rb") as stream:
                found, _ = copy_hashed(stream, part)
            if found != file.sha256:
                return False
            part.replace(self._path(file.sha256))
        except OSError:
            return False
        finally:
            part.unlink(missing_ok=True)
        return True

    def put(self, run: str, file: File, offset: int, data: bytes) -> bool:
        """Take the next piece of a file in; with the last one it is checked and is there. Whether it is.

        run : who fetches it; several may fetch the same at once   Raises OrderError if it is not what was announced, OSError.
        """
        part = self._folder / f"{file.sha256}.{run}.part"
        with part.open("wb" if offset == 0 else "r+b") as target:
            if offset and target.seek(0, os.SEEK_END) != offset:
                raise OrderError(f"{file.name}: a piece of it was lost on the way")
            target.write(data)
        if len(data) > CHUNK_BYTES or offset + len(data) > file.size:
            part.unlink()
            raise OrderError(f"{file.name}: more came than its {file.size} bytes")
        if offset + len(data) == file.size:
            if (found := sha256_of(part)) != file.sha256:
                part.unlink()
                raise OrderError(f"{file.name}: its hash is {found[:12]}, announced was {file.sha256[:12]}: it is damaged, or was changed meanwhile")
            part.replace(self._path(file.sha256))
            return True
        return False

    def place(self, files: Iterable[File], folder: Path) -> None:
        """Put files into a task's folder under their names: as links, so that one that is swept meanwhile stays. Raises OSError."""
        for file in files:
            target = folder / file.name
            target.parent.mkdir(parents=True, exist_ok=True)
            try:
                os.link(self._path(file.sha256), target)
            except OSError:
                if not self._path(file.sha256).exists():
                    raise
                shutil.copyfile(self._path(file.sha256), target)

    def sweep(self) -> None:
        """Remove what was used least recently until the folder keeps to its bound."""
        seen = sorted((path.stat().st_mtime_ns, path.stat().st_size, path) for path in self._folder.iterdir() if path.suffix != ".part")
        total = sum(size for _, size, _ in seen)
        for _, size, path in seen:
            if total <= self._limit_bytes:
                return
            path.unlink(missing_ok=True)
            total -= size
