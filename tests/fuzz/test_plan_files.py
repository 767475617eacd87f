"""Whatever bytes a plan or program file has, also under right checksums, it is read or refused in one line."""

from __future__ import annotations

import hashlib
import io
import json
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from config.cell import load_cell
from planner.errors import PlannerError
from planner.files.plan_file import HEAD_BYTES, _content_hash, _head, plan_bytes, plan_from_bytes, read_layer
from planner.files.plan_tables import tables_of
from planner.files.program_file import INDEX, TABLES, _json, _own_sum, program_files, read_program
from planner.plan import PLAN_SCHEMA, Plan
from planner.post import post
from planner.program import Program
from tests.unit.planner.hand_plan import hybrid_plan

FEW = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
VALUES = [-1, 0, 1, 255, 2**31 - 1, 2**62, -(2**62), float("nan"), float("inf"), 1e308]


@cache
def whole_plan() -> bytes:
    return plan_bytes(hybrid_plan())


@cache
def whole_program() -> dict[str, bytes]:
    return program_files(post(hybrid_plan(), load_cell("trunnion_tcp")))


def assert_given_or_one_line(read: Callable[[], Any], kind: type) -> None:
    """Whether reading gives the kind, or a PlannerError of one line; anything else passes through."""
    try:
        found = read()
    except PlannerError as error:
        assert error.message and "\n" not in error.message, repr(error.message)
    else:
        assert isinstance(found, kind)


def sealed(tables: dict[str, np.ndarray[Any, Any]]) -> bytes:
    """A plan file of any tables with checksums that fit."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w", userblock_size=HEAD_BYTES) as file:
        file.attrs["schema"], file.attrs["sha256"] = PLAN_SCHEMA, _content_hash(PLAN_SCHEMA, tables)
        for name, table in tables.items():
            file.create_dataset(name, data=table)
    body = buffer.getvalue()[HEAD_BYTES:]
    return _head(PLAN_SCHEMA, body) + body


def changed(draw: st.DrawFn, data: bytes) -> bytes:
    """Bytes flipped, cut out, doubled or cut off."""
    found = bytearray(data)
    at, width = draw(st.integers(0, len(found) - 1)), draw(st.integers(0, 16))
    kind = draw(st.sampled_from(["bytes", "cut", "double", "end"]))
    if kind == "bytes":
        found[at : at + width] = draw(st.binary(min_size=width, max_size=width))
    elif kind == "cut":
        del found[at : at + width]
    elif kind == "double":
        found[at:at] = found[at : at + width]
    else:
        del found[at:]
    return bytes(found)


@st.composite
def damaged_plans(draw: st.DrawFn) -> bytes:
    """A plan file whose body was changed under a head that fits, or another head."""
    data = changed(draw, whole_plan())
    return _head(PLAN_SCHEMA, data[HEAD_BYTES:]) + data[HEAD_BYTES:] if draw(st.booleans()) else data


@st.composite
def wrong_tables(draw: st.DrawFn) -> bytes:
    """A sealed plan with a table left out, of another type, another shape, or with a number that cannot be."""
    tables = dict(tables_of(hybrid_plan()))
    for _ in range(draw(st.integers(1, 2))):
        name = draw(st.sampled_from(sorted(tables)))
        table = tables[name]
        kind = draw(st.sampled_from(["value", "left out", "type", "shape", "short", "words"]))
        if kind == "left out":
            del tables[name]
        elif kind == "type":
            tables[name] = table.astype(draw(st.sampled_from(["S4", "<f4", "<i8", "?"])))
        elif kind == "shape":
            tables[name] = table.reshape(-1) if table.ndim > 1 else table[:, None]
        elif kind == "short":
            tables[name] = table[: len(table) // 2]
        elif kind == "words":
            words = json.loads(tables_of(hybrid_plan())["plan/words"].tobytes())
            words[draw(st.sampled_from(sorted(words)))] = draw(
                st.sampled_from([None, 3, "x", [], {}, [1], {"a": None}])
            )
            tables["plan/words"] = np.frombuffer(json.dumps(words).encode(), dtype="u1")
        elif table.size and table.dtype.kind in "iuf":
            copy = table.copy()
            with np.errstate(all="ignore"):
                chosen = np.array(draw(st.sampled_from(VALUES)), dtype=np.float64).astype(copy.dtype)
            copy.reshape(-1)[draw(st.integers(0, copy.size - 1))] = chosen
            tables[name] = copy
    return sealed(tables)


@FEW
@given(damaged_plans())
def test_a_damaged_plan_file_is_a_plan_or_one_line(data: bytes) -> None:
    assert_given_or_one_line(lambda: plan_from_bytes(data), Plan)


@settings(FEW, max_examples=100)
@given(wrong_tables())
def test_tables_that_do_not_fit_are_one_line_even_under_right_checksums(data: bytes) -> None:
    assert_given_or_one_line(lambda: plan_from_bytes(data), Plan)


@settings(FEW, max_examples=40)
@given(wrong_tables())
def test_single_layers_of_such_plans_are_a_layer_or_one_line(data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.h5"
        path.write_bytes(data)
        assert_given_or_one_line(lambda: read_layer(path, 1), object)


@st.composite
def wrong_programs(draw: st.DrawFn) -> dict[str, bytes]:
    """A program directory with a file changed or an entry of its index of another kind, sealed again or not."""
    files = dict(whole_program())
    index = json.loads(files[INDEX])
    if draw(st.booleans()):
        name = draw(st.sampled_from(sorted(files)))
        files[name] = changed(draw, files[name])
    else:
        name = draw(st.sampled_from(sorted(index)))
        index[name] = draw(st.sampled_from([None, 3, -1.5, "x", [], {}, [[1, 2]], [None], {"a": 1}, {TABLES: 3}]))
        if draw(st.booleans()):
            index.pop(name)
    if draw(st.booleans()) and isinstance(index.get("sha256"), dict):
        for name in files.keys() - {INDEX}:
            index["sha256"][name] = hashlib.sha256(files[name]).hexdigest()
        index["sha256"][INDEX] = _own_sum(index)
        files[INDEX] = _json(index)
    return files


@settings(FEW, max_examples=80)
@given(wrong_programs())
def test_a_changed_program_directory_is_a_program_or_one_line(files: dict[str, bytes]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            (Path(folder) / name).write_bytes(content)
        assert_given_or_one_line(lambda: read_program(folder), Program)
