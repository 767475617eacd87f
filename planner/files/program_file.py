"""A Program as a directory: G-code per layer (whole for some controls), tables in HDF5, everything else and the checksums in program.json."""

from __future__ import annotations

import hashlib
import io
import itertools
import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from planner.errors import FileFormatError
from planner.program import LINE_DTYPE, PROGRAM_SCHEMA, SCHEDULE_DTYPE, Continues, ProcessWindow, Program

INDEX = "program.json"
TABLES = "lines.h5"
_DATASETS = {"table": LINE_DTYPE, "schedule": SCHEDULE_DTYPE, "layer_starts": np.dtype("<i8")}
_UNITS = "mm, s, deg; W, g/min, L/min in the schedule"
_MATRICES = {"machine_from_build": (4, 4), "build_from_part": (4, 4), "work_offset": (-1,)}
_TUPLES = ("axis_letters", "tools")
_OPTIONAL = ("continues", "window")
_APART = {"lines", *_DATASETS}
_HINT = "post the plan again"
_WHOLE = {"siemens": "program.mpf", "fanuc": "program.nc", "heidenhain": "program.h", "apt": "program.apt"}
"""Dialects whose controls take a program as one file; the others' text is in a file per layer."""
_SWOLLEN = 1100  # deflate packs at most 1,032 to 1


def program_files(program: Program) -> dict[str, bytes]:
    """Name and content of every file of a Program's directory; the same Program gives the same bytes."""
    files = {name: _text(lines) for name, lines in _layers(program)}
    files[TABLES] = _tables(program)
    index = {field.name: _plain(getattr(program, field.name)) for field in fields(program) if field.name not in _APART}
    for name in _OPTIONAL:
        if index[name] is None:
            del index[name]
    index["sha256"] = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    index["sha256"][INDEX] = _own_sum(index)
    files[INDEX] = _json(index)
    return files


def program_sha256(program: Program) -> str:
    """Content hash (hex) of a Program: of its program.json, which holds the checksums of all other files."""
    return hashlib.sha256(program_files(program)[INDEX]).hexdigest()


def write_program(program: Program, directory: str | Path) -> None:
    """Write a Program's directory; files of an earlier program in it are replaced, program.json last.

    Raises FileFormatError if the directory cannot be written.
    """
    folder = Path(directory)
    files = program_files(program)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / INDEX).unlink(missing_ok=True)
        for old in (*folder.glob("layer_*.ngc"), *(folder / name for name in _WHOLE.values())):
            if old.name not in files:
                old.unlink(missing_ok=True)
        for name, content in files.items():
            (folder / name).write_bytes(content)
    except OSError as error:
        raise FileFormatError(
            f"{folder}: cannot be written: {error.strerror}", "name a directory that can be written"
        ) from None


def read_program(directory: str | Path) -> Program:
    """Read a Program's directory and verify every checksum.

    Raises FileFormatError with one line: absent, damaged, of another version, or not a program.
    """
    folder = Path(directory)
    index = _index(folder)
    sums = index.pop("sha256")
    del sums[INDEX]
    contents = {}
    for name, expected in sorted(sums.items()):
        contents[name] = _content(folder / name)
        if hashlib.sha256(contents[name]).hexdigest() != expected:
            raise FileFormatError(f"{folder / name}: damaged (its checksum is not the one in {INDEX})", _HINT)
    try:
        lines = [line for name in sorted(contents) if name != TABLES for line in contents[name].decode().splitlines()]
        values: dict[str, Any] = dict(index)
        for name, shape in _MATRICES.items():
            values[name] = np.array(index[name], dtype=np.float64).reshape(shape)
        for name in _TUPLES:
            values[name] = tuple(index[name])
        if "continues" in index:
            values["continues"] = Continues(**index["continues"])
        if "window" in index:
            values["window"] = ProcessWindow.from_document(index["window"])
        program = Program(lines=tuple(lines), **_read_tables(contents[TABLES]), **values)
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError, OSError, RuntimeError) as error:
        first = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FileFormatError(f"{folder}: not a program: {first}", _HINT) from None
    if len(program.table) != len(program.lines):
        raise FileFormatError(f"{folder}: {len(program.lines)} lines, but a table of {len(program.table)}", _HINT)
    return program


def _layers(program: Program) -> list[tuple[str, tuple[str, ...]]]:
    """File name and lines of the set-up and of each layer, or of everything."""
    if program.dialect in _WHOLE:
        return [(_WHOLE[program.dialect], program.lines)]
    edges = [0, *program.layer_starts.tolist()]
    edges[-1] = len(program.lines)
    return [
        (f"layer_{k:04d}.ngc", program.lines[begin:end]) for k, (begin, end) in enumerate(itertools.pairwise(edges))
    ]


def _text(lines: tuple[str, ...]) -> bytes:
    return "".join(line + "\n" for line in lines).encode("ascii")


def _tables(program: Program) -> bytes:
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", track_order=False) as file:
        file.attrs["schema"] = PROGRAM_SCHEMA
        file.attrs["units"] = _UNITS
        for name, dtype in _DATASETS.items():
            values = np.ascontiguousarray(getattr(program, name), dtype=dtype)
            packed = {"compression": "gzip", "compression_opts": 4, "shuffle": True} if values.size else {}
            file.create_dataset(name, data=values, track_times=False, **packed)
    return buffer.getvalue()


def _read_tables(content: bytes) -> dict[str, Any]:
    with h5py.File(io.BytesIO(content), "r") as file:
        for name in _DATASETS:
            if file[name].nbytes > _SWOLLEN * len(content):
                raise ValueError(f"{name} states {file[name].nbytes} bytes, more than its file can hold")
        return {name: np.asarray(file[name][...], dtype=dtype) for name, dtype in _DATASETS.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Continues | ProcessWindow):
        return asdict(value)
    return list(value) if isinstance(value, tuple) else value


def _index(folder: Path) -> dict[str, Any]:
    path = folder / INDEX
    try:
        index = json.loads(_content(path))
        _json(index)
    except ValueError:
        raise FileFormatError(f"{path}: damaged (not JSON)", _HINT) from None
    if not isinstance(index, dict) or not isinstance(index.get("sha256"), dict) or TABLES not in index["sha256"]:
        raise FileFormatError(f"{path}: not a program", "name the directory that `cellctl post` wrote")
    if index.get("schema") != PROGRAM_SCHEMA:
        raise FileFormatError(f"{path}: schema {index.get('schema')!r}, this version reads {PROGRAM_SCHEMA}", _HINT)
    if index["sha256"].get(INDEX) != _own_sum(index):
        raise FileFormatError(f"{path}: damaged (its own checksum does not fit)", _HINT)
    if any(Path(name).name != name for name in index["sha256"]):
        raise FileFormatError(f"{path}: names a file outside its directory", _HINT)
    return index


def _json(index: dict[str, Any]) -> bytes:
    return (json.dumps(index, indent=1, sort_keys=True, allow_nan=False) + "\n").encode()


def _own_sum(index: dict[str, Any]) -> str:
    """Checksum of program.json itself, but for the line that holds it."""
    others = {name: value for name, value in index["sha256"].items() if name != INDEX}
    return hashlib.sha256(_json({**index, "sha256": others})).hexdigest()


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise FileFormatError(
            f"{path}: cannot be read: {error.strerror}", "name the directory that `cellctl post` wrote"
        ) from None
