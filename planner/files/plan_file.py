"""The plan file: HDF5 with the same bytes for the same plan, behind a first block that carries version and checksum."""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from planner.errors import FileFormatError
from planner.files.plan_tables import UNITS, layer_from, plan_from, tables_of
from planner.plan import PLAN_SCHEMA, Layer, Plan

Table = NDArray[Any]

MAGIC = b"hybridcell plan, schema "
HEAD_BYTES = 512  # the HDF5 user block: text that says what the file is and the checksum of all that follows
_HDF5 = ("earliest", "v110")  # oldest layout: no time stamps, read by every HDF5 since 1.8
_AGAIN = "plan the part again, or copy the file again"
_MALFORMED = (OSError, RuntimeError, LookupError, ValueError, ArithmeticError, TypeError, AttributeError)
"""What h5py and numpy raise for content that does not fit, checksums or not."""


def plan_sha256(plan: Plan) -> str:
    """Hash (hex) of a plan's content: all its tables in the order of their names. Equal plans, equal hashes."""
    return _content_hash(plan.schema, tables_of(plan))


def _content_hash(schema: int, tables: Mapping[str, Table]) -> str:
    digest = hashlib.sha256(f"schema {schema}".encode())
    for name in sorted(tables):
        table = np.ascontiguousarray(tables[name])
        digest.update(f"\n{name} {table.dtype.str} {table.shape}\n".encode())
        digest.update(table.tobytes())
    return digest.hexdigest()


def plan_bytes(plan: Plan) -> bytes:
    """The plan file's bytes: the same for the same plan."""
    tables = tables_of(plan)
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", libver=_HDF5, userblock_size=HEAD_BYTES) as file:
        file.attrs["schema"] = plan.schema
        file.attrs["sha256"] = _content_hash(plan.schema, tables)
        file.attrs["frame"] = "build frame: z along the build direction, mm, s, W; see planner.plan"
        for name in sorted(tables):
            dataset = file.create_dataset(name, data=tables[name], track_times=False)
            if name in UNITS:
                dataset.attrs["unit"] = UNITS[name]
    body = buffer.getvalue()[HEAD_BYTES:]
    return _head(plan.schema, body) + body


def _head(schema: int, body: bytes) -> bytes:
    return (MAGIC + f"{schema}, sha256 {hashlib.sha256(body).hexdigest()}\n".encode()).ljust(HEAD_BYTES, b" ")


def write_plan(plan: Plan, path: str | Path) -> None:
    """Write a plan; an older file of that name is replaced in one step.

    Raises FileFormatError, one line, if the file cannot be written.
    """
    target = Path(path)
    beside = target.with_name(target.name + ".part")
    try:
        beside.write_bytes(plan_bytes(plan))
        os.replace(beside, target)
    except OSError as error:
        raise FileFormatError(f"{target}: cannot be written: {error.strerror}", "name a writable place") from None


def read_plan(path: str | Path) -> Plan:
    """Read and check a plan file.

    Raises FileFormatError, one line, if it is absent, no plan, of another version, cut short or changed.
    """
    return plan_from_bytes(_read(path), str(path))


def plan_from_bytes(data: bytes, source: str = "plan") -> Plan:
    """As `read_plan`, from the file's bytes.  source : what the error line calls it."""
    _check(data, source)
    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            tables = {name: file[name][()] for name in _names(file, len(data))}
            if file.attrs["sha256"] != _content_hash(int(file.attrs["schema"]), tables):
                raise FileFormatError(f"{source}: the checksum of its content does not fit", _AGAIN)
        return plan_from(tables)
    except _MALFORMED as error:
        raise FileFormatError(f"{source}: not a whole plan: {_one_line(error)}", _AGAIN) from None


def read_layer(path: str | Path, number: int) -> Layer:
    """Read one layer of a plan file; of the tables only its own rows are unpacked.

    Raises FileFormatError as `read_plan`, and if there is no such layer.
    """
    data = _read(path)
    _check(data, str(path))
    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            count = len(file["layers/index"])
            if not 0 <= number < count:
                raise FileFormatError(f"{path}: no layer {number}: it has 0 … {count - 1}", "ask for one of them")
            notes = json.loads(file["plan/words"][()].tobytes())["notes"]
            return layer_from(lambda name, first, last: np.asarray(file[name][first:last]), number, notes)
    except _MALFORMED as error:
        raise FileFormatError(f"{path}: not a whole plan: {_one_line(error)}", _AGAIN) from None


def _read(path: str | Path) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}", "name an existing plan file") from None


def _check(data: bytes, source: str) -> None:
    """Raise FileFormatError unless the first block is ours, of this version, and its checksum fits the rest."""
    if not data.startswith(MAGIC):
        raise FileFormatError(f"{source}: not a plan file", "a plan file is written by `cellctl plan`")
    version = data[len(MAGIC) : len(MAGIC) + 10].split(b",")[0].decode("ascii", "replace")
    if version != str(PLAN_SCHEMA):
        raise FileFormatError(
            f"{source}: plan version {version}, this program reads {PLAN_SCHEMA}", "plan the part again"
        )
    if data[:HEAD_BYTES] != _head(PLAN_SCHEMA, data[HEAD_BYTES:]):
        raise FileFormatError(f"{source}: the checksum does not fit: the file is cut short or was changed", _AGAIN)


def _names(file: h5py.File, size: int) -> list[str]:
    """Of all tables. Raises ValueError for one that states more bytes than the file has: ours are not packed."""
    found: list[h5py.Dataset] = []
    file.visititems(lambda _, item: found.append(item) if isinstance(item, h5py.Dataset) else None)
    for table in found:
        if table.nbytes > size:
            raise ValueError(f"{table.name} states {table.nbytes} bytes, more than the file has")
    return [table.name.lstrip("/") for table in found]


def _one_line(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__
