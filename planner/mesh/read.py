"""From a file's bytes to vertices and facets as they stand in it; STL read here, the other formats by trimesh."""

from __future__ import annotations

import io

import numpy as np
import trimesh
from numpy.typing import NDArray

from planner.errors import MeshError
from planner.mesh.archive import refuse_hostile
from planner.mesh.facets import bounds_of
from planner.mesh.findings import place_text
from planner.mesh.placements import MAX_PLACED, placed_bodies

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FORMATS = (".stl", ".3mf", ".obj", ".ply")
MM_PER_UNIT = {"mm": 1.0, "inch": 25.4}
MAX_FILE_BYTES = 1_000_000_000
"""A binary STL of this size holds 20 million facets; loading it takes about 10 GB of memory."""
MAX_UNPACKED_BYTES = 400_000_000
"""A 3MF model of this size holds about 4 million facets; parsing it takes about ten times as much memory."""
MAX_EXTENT_MM = 1.0e4
MIN_EXTENT_MM = 1.0e-2
"""No cell of this kind builds a part larger than 10 m or smaller than one powder grain: the unit is wrong."""
_STL_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_HEAD = 84
_UNITS_OF_3MF = {"millimeter": "mm", "millimeters": "mm", "inch": "inch"}


def read_geometry(data: bytes, suffix: str, units: str) -> tuple[Floats, Ints]:
    """Vertices (n, 3) in mm and facets (m, 3) of a mesh file, unchecked but for finite, sensible numbers.

    data : the file;  suffix : ".stl", ".3mf", ".obj" or ".ply";  units : "mm" or "inch", what the file's numbers mean
    Raises MeshError, one line, for anything that is no such file, is cut off, empty, not finite or of absurd size.
    """
    if units not in MM_PER_UNIT:
        raise MeshError(f"unknown unit {units!r}", 'state units "mm" or "inch"')
    kind = suffix.lower() if suffix.startswith(".") else f".{suffix.lower()}"
    if kind not in FORMATS:
        raise MeshError(f"cannot read {kind or 'a file without suffix'} files", f"export as one of {' '.join(FORMATS)}")
    if not data:
        raise MeshError("the file is empty (0 bytes)", "export the model again")
    if len(data) > MAX_FILE_BYTES:
        raise MeshError(
            f"the file has {len(data) / 1e6:.0f} MB, more than {MAX_FILE_BYTES / 1e6:.0f} MB",
            "export with a coarser tolerance",
        )
    vertices, facets = _read_stl(data) if kind == ".stl" else _read_with_trimesh(data, kind, units)
    if not len(facets):
        raise MeshError(f"the {kind[1:].upper()} file holds no facets", "export a solid, not points or curves")
    _refuse_bad_numbers(vertices, facets)
    scaled = vertices if units == "mm" else vertices * MM_PER_UNIT[units]
    _refuse_absurd_size(bounds_of(scaled, facets), units)
    return scaled, facets


def _read_stl(data: bytes) -> tuple[Floats, Ints]:
    """Corner by corner: (3m, 3) vertices and (m, 3) facets of a binary or ASCII STL."""
    count = int.from_bytes(data[80:_STL_HEAD], "little") if len(data) >= _STL_HEAD else -1
    if count >= 0 and len(data) == _STL_HEAD + 50 * count:
        return _facets_of(_binary_corners(data, count))
    head = data[:1000].lstrip().lower()
    if head.startswith(b"solid") and (b"facet" in data[:4000].lower() or b"endsolid" in data[:4000].lower()):
        return _facets_of(_ascii_corners(data))
    if count < 0:
        raise MeshError(f"not an STL file: {len(data)} bytes, and not ASCII STL", "check which file was picked")
    held = (len(data) - _STL_HEAD) // 50
    if held >= count:
        extra = len(data) - _STL_HEAD - 50 * count
        raise MeshError(
            f"the binary STL states {count} facets but {extra} more bytes follow them: damaged or not an STL file",
            "export the model again",
        )
    raise MeshError(
        f"the file is cut off or no STL: it states {count} facets and holds {held}", "copy or export the file again"
    )


def _binary_corners(data: bytes, count: int) -> Floats:
    """(m, 3, 3) float corners of a binary STL whose size agrees with its count."""
    records = np.frombuffer(data, dtype=_STL_RECORD, count=count, offset=_STL_HEAD)
    return records["corners"].astype(np.float64)


def _ascii_corners(data: bytes) -> Floats:
    """(m, 3, 3) float corners of an ASCII STL.  Raises MeshError naming the first line that is not as it should be."""
    lines = data.lower().split(b"\n")
    words = [line.split() for line in lines]
    rows = [number for number, line in enumerate(words) if line and line[0] == b"vertex"]
    loops = sum(1 for line in words if line and line[0] == b"endloop")
    if not any(line and line[0] == b"endsolid" for line in words) or len(rows) != 3 * loops:
        raise MeshError(
            f"the ASCII STL is cut off or damaged: {len(rows)} vertices in {loops} complete facets, {len(lines)} lines",
            "copy or export the file again",
        )
    values = np.empty((len(rows), 3), dtype=np.float64)
    for i, number in enumerate(rows):
        try:
            values[i, 0], values[i, 1], values[i, 2] = (float(word) for word in words[number][1:4])
        except ValueError:
            text = lines[number].decode("ascii", "replace").strip()[:60]
            raise MeshError(f"line {number + 1} of the ASCII STL is no vertex: {text!r}", "export again") from None
    return values.reshape(-1, 3, 3)


def _facets_of(corners: Floats) -> tuple[Floats, Ints]:
    """Corners (m, 3, 3) as (3m, 3) vertices and (m, 3) facets that share none yet."""
    return corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int64).reshape(-1, 3)


def _read_with_trimesh(data: bytes, kind: str, units: str) -> tuple[Floats, Ints]:
    """All triangles of a 3MF, OBJ or PLY file, instances placed."""
    name = kind[1:].upper()
    if kind == ".obj":
        data = data.decode("latin-1").encode()  # names may be in any encoding, numbers are ASCII in all of them
    placed: int | None = None
    if kind == ".3mf":
        _refuse_swollen(data)
    try:
        if kind == ".3mf":
            refuse_hostile(data)
        placed = _placed(data) if kind == ".3mf" else None
        scene = trimesh.load_scene(io.BytesIO(data), file_type=kind[1:], process=False, skip_materials=True)
        stated = _UNITS_OF_3MF.get(str(scene.units), str(scene.units)) if kind == ".3mf" and scene.units else units
        pieces = [piece for piece in scene.dump(concatenate=False) if isinstance(piece, trimesh.Trimesh)]
        arrays = [(np.asarray(piece.vertices, np.float64), np.asarray(piece.faces, np.int64)) for piece in pieces]
    except MeshError:
        raise
    except Exception as error:  # the edge to trimesh, which raises anything on a damaged file
        reason = " ".join(str(error).split())[:120]
        raise MeshError(
            f"not a readable {name} file ({type(error).__name__}: {reason})",
            "check which file was picked, export again",
        ) from error
    if stated != units:
        raise MeshError(
            f"the 3MF file states its unit as {stated}, asked for was {units}",
            f"use units {stated}" if stated in MM_PER_UNIT else "export it in millimetres",
        )
    bodies = sum(1 for _, facets in arrays if len(facets))
    if placed is not None and bodies < placed:
        raise MeshError(
            f"the 3MF file places {placed} bodies, of which {bodies} could be read",
            "export it without components in components, or as STL",
        )
    if not arrays:
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
    shift = np.cumsum([0] + [len(vertices) for vertices, _ in arrays])
    for vertices, facets in arrays:
        if vertices.ndim != 2 or vertices.shape[1] != 3 or facets.ndim != 2 or facets.shape[1] != 3:
            raise MeshError(
                f"not every vertex of the {name} file has three coordinates, or not every facet three corners",
                "export the model again",
            )
        if len(facets) and (facets.min() < 0 or facets.max() >= len(vertices)):
            raise MeshError(f"a facet of the {name} file names a vertex that is not there", "export the model again")
    moved = [facets + start for (_, facets), start in zip(arrays, shift[:-1], strict=True)]
    return np.vstack([vertices for vertices, _ in arrays]), np.vstack(moved)


def _placed(data: bytes) -> int | None:
    """As `placed_bodies`.  Raises MeshError if they are too many to be meant."""
    count = placed_bodies(data)
    if count is not None and count > MAX_PLACED:
        raise MeshError(f"the 3MF file places more than {MAX_PLACED} bodies", "export only what is to be built")
    return count


def _refuse_swollen(data: bytes) -> None:
    """Raise MeshError if the entries of a ZIP archive unpack to more than MAX_UNPACKED_BYTES.

    What the central directory states is what unpackers go by. Source: PKWARE APPNOTE 4.3.12 and 4.3.16.
    """
    end = data.rfind(b"PK\x05\x06")
    at = int.from_bytes(data[end + 16 : end + 20], "little") if end >= 0 else len(data)
    total = 0
    while data[at : at + 4] == b"PK\x01\x02":
        total += int.from_bytes(data[at + 24 : at + 28], "little")
        at += 46 + sum(int.from_bytes(data[at + k : at + k + 2], "little") for k in (28, 30, 32))
    if total > MAX_UNPACKED_BYTES:
        raise MeshError(
            f"the 3MF file unpacks to {total / 1e6:.0f} MB, more than {MAX_UNPACKED_BYTES / 1e6:.0f} MB",
            "export with a coarser tolerance, or as binary STL",
        )


def _refuse_bad_numbers(vertices: Floats, facets: Ints) -> None:
    """Raise MeshError if a corner of a facet is NaN or infinite."""
    if np.isfinite(vertices).all():
        return
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(vertices).all(axis=1))[facets]
    bad = np.flatnonzero(~finite.all(axis=1))
    if len(bad):
        sound = vertices[facets[bad[0]]][finite[bad[0]]]
        where = f", which has a corner at {place_text(sound[0])}" if len(sound) else ""
        raise MeshError(
            f"{len(bad)} of {len(facets)} facets have coordinates that are not numbers (NaN or infinite), "
            f"first facet {bad[0]}{where}",
            "export the model again",
        )


def _refuse_absurd_size(bounds: Floats, units: str) -> None:
    """Raise MeshError if the part's largest extent, bounds (2, 3) mm, cannot be meant."""
    size = bounds[1] - bounds[0]
    text = " x ".join(f"{value:.4g}" for value in size)
    if size.max() > MAX_EXTENT_MM:
        raise MeshError(f"the part is {text} mm, larger than {MAX_EXTENT_MM:g} mm", f"are its numbers in {units}?")
    if size.max() < MIN_EXTENT_MM:
        raise MeshError(f"the part is {text} mm, smaller than {MIN_EXTENT_MM:g} mm", f"are its numbers in {units}?")
