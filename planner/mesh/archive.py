"""What a 3MF file, which is a ZIP archive of XML, may not be: full of entries, packed beyond reason, with paths that climb, or with a DTD."""

from __future__ import annotations

import io
import zipfile

from planner.errors import MeshError

MAX_ENTRIES = 1000
"""A 3MF file has one model, its relations, a picture, and settings of the program that wrote it."""
MAX_RATIO, RATIO_FROM_BYTES = 200, 20_000_000
"""Coordinates as text pack to a tenth or so; what packs to a two-hundredth holds nothing but repetition."""
_PROLOG_BYTES = 65_536
"""So far into an XML entry a DTD is looked for: it stands before the first element."""


def refuse_hostile(data: bytes) -> None:
    """Look at an archive's directory and the beginnings of its XML before anything is unpacked.

    data : the file.  Raises MeshError, one line; zipfile.BadZipFile and what zipfile raises for a damaged file.
    Source: 3MF Core Specification 1.3, 2.3 (paths) and 2.1.4 (no DTD).
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        entries = archive.infolist()
        if len(entries) > MAX_ENTRIES:
            raise MeshError(f"the 3MF file has {len(entries)} entries, more than {MAX_ENTRIES}", "export only what is to be built")
        unpacked = sum(entry.file_size for entry in entries)
        if unpacked > max(RATIO_FROM_BYTES, MAX_RATIO * len(data)):
            raise MeshError(
                f"the 3MF file unpacks from {len(data) / 1e6:.2g} MB to {unpacked / 1e6:.0f} MB", "no mesh packs like that: export it again"
            )
        for entry in entries:
            _refuse_path(entry.filename)
            if entry.filename.lower().endswith((".model", ".rels", ".xml")):
                with archive.open(entry) as opened:
                    if b"<!DOCTYPE" in opened.read(_PROLOG_BYTES).replace(b"\0", b""):
                        raise MeshError(f"the 3MF file holds a DTD ({entry.filename[:60]}), which the format forbids", "export the model again")


def _refuse_path(name: str) -> None:
    """Raise MeshError for an entry that would be outside of its folder."""
    steps = name.replace("\\", "/").split("/")
    if name.startswith(("/", "\\")) or ".." in steps or ":" in steps[0]:
        raise MeshError(f"the 3MF file holds an entry with the path {name[:60]!r}", "export the model again")
