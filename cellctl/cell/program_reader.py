"""Opens a Program for a run away from the event loop: its form if there is one, else a process of its own makes it first."""

from __future__ import annotations

import asyncio
import hashlib
import json
import shutil
import sys
from pathlib import Path

from cellctl.cell.opened_program import OpenedProgram, open_form
from cellctl.cell.program_form import form_beside
from planner.errors import FileFormatError
from planner.program import Program


class ProgramReader:
    """directory -> (Program, sha256 of its program.json, hex).  cell_file : that the forms are made for; forms : where those lie that are made here

    Raises FileFormatError.
    """

    def __init__(self, cell_file: str, forms: Path) -> None:
        self._cell_file = cell_file
        self._forms = forms

    async def __call__(self, directory: Path) -> tuple[Program, str]:
        """Open the Program; what was made ready when it was stored opens in a moment."""
        digest = await asyncio.to_thread(_digest, directory)
        opened = await asyncio.to_thread(open_form, form_beside(directory), digest)
        if opened is None:
            opened = await self._make(directory, digest)
        return opened, digest

    async def _make(self, directory: Path, digest: str) -> OpenedProgram:
        """The form of a Program that came without: made by a process of its own, so that the tick goes on beside it."""
        target = self._forms / digest
        await asyncio.to_thread(_forget_others, self._forms, digest)
        words = ["-m", "cellctl.cell.program_form", str(directory), str(target), "--cell", self._cell_file]
        maker = await asyncio.create_subprocess_exec(
            sys.executable, *words, stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE
        )
        try:
            said, _ = await maker.communicate()
        finally:
            if maker.returncode is None:
                maker.kill()
                await maker.wait()
        if maker.returncode:
            raise FileFormatError(*_refusal(said, directory, maker.returncode))
        opened = await asyncio.to_thread(open_form, target, digest)
        if opened is None:
            raise FileFormatError(f"{directory}: changed while it was opened", "start it again")
        return opened


def _digest(directory: Path) -> str:
    path = directory / "program.json"
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise FileFormatError(
            f"{path}: cannot be read: {error.strerror}", "name the directory that `cellctl post` wrote"
        ) from None


def _refusal(said: bytes, directory: Path, code: int) -> tuple[str, str]:
    try:
        message, hint = json.loads(said)
    except ValueError:
        return f"{directory}: could not be opened (code {code})", "look at the log of the cell process"
    return str(message), str(hint)


def _forget_others(forms: Path, digest: str) -> None:
    forms.mkdir(parents=True, exist_ok=True)
    for path in forms.iterdir():
        if path.name != digest:
            shutil.rmtree(path, ignore_errors=True)
