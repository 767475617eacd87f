"""Programs on the disk of the cell's own host: the cell process reads from them while they run, and must wait for no network then."""

from __future__ import annotations

import shutil
from pathlib import Path

from cellctl.cell.program_form import form_beside
from cellctl.store import blobs
from cellctl.store.blobs import Blobs

KEPT = 20  # programs brought here, those that were started last; all are among the shared files still


def bring(kept: Blobs, sha256: str) -> Path:
    """The folder of a program with its form beside it, copied here first where the files are shared. Raises OSError."""
    source, here = kept.program(sha256), kept.program_at_hand(sha256)
    if here == source:
        return source
    here.parent.mkdir(parents=True, exist_ok=True)
    for path, target in ((form_beside(source), form_beside(here)), (source, here)):  # it is here once all of it is
        if not target.is_dir() and (path.is_dir() or path == source):
            _copy(path, target)
    here.touch()
    _forget_old(here.parent)
    return here


def _copy(source: Path, target: Path) -> None:
    """Durable, and in one step at the end. What a copy that broke off left is written over."""
    part = target.with_name(f".{target.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    shutil.copytree(source, part)
    blobs.place(part, target)


def _forget_old(folder: Path) -> None:
    programs = [path for path in folder.iterdir() if "." not in path.name]
    for path in sorted(programs, key=lambda one: one.stat().st_mtime, reverse=True)[KEPT:]:
        shutil.rmtree(path, ignore_errors=True)
        shutil.rmtree(form_beside(path), ignore_errors=True)
