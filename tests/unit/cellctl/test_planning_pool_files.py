"""What a planning pool moves and refuses, without processes: orders, their files by hash, the cache of a machine, addresses."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
import tomli_w
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from cellctl.planning.pool.cache import Cache
from cellctl.planning.pool.connection import Connection
from cellctl.planning.pool.machine import refusal
from cellctl.planning.pool.order import (
    CHUNK_BYTES,
    RESULTS,
    File,
    Machine,
    Order,
    OrderError,
    check_name,
    check_results,
)
from cellctl.planning.pool.packing import CELL_FILE, Hashes, Packing
from cellctl.planning.pool.unpacking import results, unpacked
from cellctl.planning.pool.wire import PoolError, PoolWire, check_pool
from cellctl.planning.task import Link, Task
from cellctl.tls import TlsError
from config import load_cell
from config.base import FACTS_DIR
from tests.unit.cellctl import certificates


def file_of(content: bytes, name: str = "mesh/part.stl", shared: str = "") -> File:
    return File(name, hashlib.sha256(content).hexdigest(), len(content), shared)


def task_of(folder: Path, **fields: object) -> Task:
    return Task(kind="prove", folder=str(folder), parent=1, memory_bytes=1, **fields)  # type: ignore[arg-type]


def arrived(cache: Cache, file: File, content: bytes, run: str = "run") -> bool:
    pieces = [content[k : k + CHUNK_BYTES] for k in range(0, len(content), CHUNK_BYTES)] or [b""]
    return [cache.put(run, file, k * CHUNK_BYTES, piece) for k, piece in enumerate(pieces)][-1]


@pytest.mark.parametrize("size", [0, 1, CHUNK_BYTES, CHUNK_BYTES + 1, 3 * CHUNK_BYTES])
def test_file_that_came_in_pieces_is_there_whole_and_not_asked_for_again(tmp_path: Path, size: int) -> None:
    cache, content = Cache(tmp_path / "files", 1 << 30), bytes(size)
    file = file_of(content)
    assert cache.missing([file, file]) == [file]
    assert arrived(cache, file, content)
    assert cache.missing([file]) == []
    cache.place([file], tmp_path / "task")
    assert (tmp_path / "task" / "mesh" / "part.stl").read_bytes() == content


def test_file_that_is_not_what_was_announced_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    cache, file = Cache(tmp_path, 1 << 30), file_of(b"as announced")
    with pytest.raises(OrderError, match="its hash is"):
        cache.put("run", file, 0, b"as_announced")
    with pytest.raises(OrderError, match="more came"):
        cache.put("run", file, 0, b"as announced and more")
    cache.put("run", file, 0, b"as ")
    with pytest.raises(OrderError, match="lost on the way"):
        cache.put("run", file, 5, b"nnounced")
    assert cache.missing([file]) == [file]
    assert arrived(cache, file, b"as announced", "another run")


def test_file_that_was_damaged_in_the_cache_is_fetched_anew(tmp_path: Path) -> None:
    cache, file = Cache(tmp_path, 1 << 30), file_of(b"content")
    arrived(cache, file, b"content")
    (tmp_path / file.sha256).write_bytes(b"c0ntent")
    assert cache.missing([file]) == [file]


def test_file_in_the_shared_folder_is_taken_from_there_only_if_its_hash_is_the_same(tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    (shared / "parts").mkdir(parents=True)
    (shared / "parts" / "same.stl").write_bytes(b"same")
    (shared / "parts" / "other.stl").write_bytes(b"0ther")
    (tmp_path / "outside").write_bytes(b"outside")
    cache = Cache(tmp_path / "files", 1 << 30, shared)
    same, other = file_of(b"same", shared="parts/same.stl"), file_of(b"other", shared="parts/other.stl")
    outside, gone = file_of(b"outside", shared="../outside"), file_of(b"gone", shared="parts/gone.stl")
    assert cache.missing([same, other, outside, gone]) == [other, outside, gone]


def test_cache_keeps_to_its_bound_and_drops_what_was_used_least_recently(tmp_path: Path) -> None:
    cache = Cache(tmp_path / "files", 2500)
    files = [file_of(bytes([k]) * 1000, f"mesh/{k}") for k in range(3)]
    for k, file in enumerate(files):
        arrived(cache, file, bytes([k]) * 1000)
    cache.place(files[:1], tmp_path / "task")
    for file, at in zip(files, (1, 3, 2), strict=True):
        os.utime(tmp_path / "files" / file.sha256, (at, at))
    cache.sweep()
    assert [file.sha256 for file in cache.missing(files)] == [files[0].sha256]
    assert (tmp_path / "task" / "mesh" / "0").read_bytes() == bytes(1000)


@given(st.text(max_size=30))
def test_name_of_a_result_never_leaves_its_folder(text: str) -> None:
    try:
        name = check_name(text)
    except OrderError:
        return
    assert (Path("/a/b") / name).resolve().is_relative_to("/a/b") and not name.startswith("/")


@pytest.mark.parametrize("name", ["../plan.h5", "/etc/passwd", "view/../../x", "view//x", "view/.hidden", "", "a/b/c/d/e", "view/x\n"])
def test_name_that_leads_elsewhere_is_refused(name: str) -> None:
    with pytest.raises(OrderError):
        check_name(name)


def test_results_are_those_that_stages_make_and_no_more_than_they_could(tmp_path: Path) -> None:
    for name in RESULTS:
        check_results([file_of(b"", name)])
    for wrong in ([file_of(b"", "operator.token")], [File("plan.h5", "0" * 63, 1)], [File("plan.h5", "0" * 64, 1 << 60)]):
        with pytest.raises(OrderError):
            check_results(wrong)
    (tmp_path / "plan.h5").write_bytes(b"plan")
    (tmp_path / "material.toml").write_text("x = 1")
    (tmp_path / "leak").symlink_to("/etc/passwd")
    assert [file.name for file in results(tmp_path)] == ["plan.h5"]


def test_cell_with_shapes_and_register_maps_of_its_own_arrives_as_the_same_cell(tmp_path: Path) -> None:
    home, far = tmp_path / "home", tmp_path / "far"
    (home / "shapes").mkdir(parents=True)
    trimesh.creation.box((30.0, 20.0, 10.0)).export(home / "shapes" / "clamp.stl")
    (home / "my laser.toml").write_bytes((FACTS_DIR / "devices" / "laser_generic.toml").read_bytes())
    document = load_cell("trunnion_tcp").model_dump(mode="json", exclude_none=True)
    clamp = {"name": "clamp", "carrier": document["machine"]["solids"][0]["carrier"], "shape": "stl", "file": "shapes/clamp.stl"}
    document["machine"]["solids"].append(clamp)
    document["links"]["laser"]["device"] = str(home / "my laser.toml")
    (home / "cell.toml").write_text(tomli_w.dumps(document))
    program = home / ("ab" * 32)
    program.mkdir()
    (program / "program.json").write_text("{}")
    (home / "part.stl").write_bytes(b"mesh")
    links = [Link(str(program), 3, 0.5)]
    task = task_of(home, cell=str(home / "cell.toml"), mesh=str(home / "part.stl"), program=str(program), links=links, checkpoints="/somewhere")
    packed = Packing(home, tmp_path, Hashes()).pack(task)
    assert str(tmp_path) not in msgspec.json.encode([packed.task, packed.files]).decode()
    assert {file.shared for file in packed.files} >= {"part.stl", "shapes/clamp.stl", f"{program.name}/program.json"}
    cache = Cache(far / "files", 1 << 30)
    for file in cache.missing(packed.files):
        arrived(cache, file, packed.paths[file.sha256].read_bytes())
    order = Order("id", "key", "topic", "software", "version", packed.task, packed.files, packed.cell_sha256, packed.twin_sha256)
    there = unpacked(order, cache, far / "task", far / "checkpoints")
    given, got = load_cell(home / "cell.toml"), load_cell(there.cell)
    assert (got.sha256, got.twin_sha256) == (given.sha256, given.twin_sha256) and packed.task.cell == CELL_FILE
    assert Path(got.links["laser"].device).read_bytes() == (home / "my laser.toml").read_bytes()
    assert Path(there.program).name == program.name and Path(there.links[0].program, "program.json").read_text() == "{}"
    assert Path(there.mesh).name == "part.stl" and there.checkpoints == str(far / "checkpoints")


def test_file_that_changed_since_is_hashed_anew(tmp_path: Path) -> None:
    hashes, path = Hashes(), tmp_path / "file"
    path.write_bytes(b"one")
    first = hashes.of(path)
    path.write_bytes(b"other")
    assert hashes.of(path) == (hashlib.sha256(b"other").hexdigest(), 5) != first


def connection_with(*machines: Machine) -> Connection:
    made = Connection(None, PoolWire("tcp://127.0.0.1:8786"), "a" * 64, "0.1.0")
    made.machines = {machine.name: machine for machine in machines}
    return made


def test_machine_of_another_version_is_told_with_both_and_takes_nothing() -> None:
    old, same = Machine("old", "0.0.9", "b" * 64, 4), Machine("same", "0.1.0", "a" * 64, 2)
    assert "planner-worker" in connection_with().why_none
    why = connection_with(old).why_none
    assert "old has 0.0.9 (bbbbbbbbbbbb)" in why and "0.1.0 (aaaaaaaaaaaa)" in why and connection_with(old).places == 0
    assert connection_with(old, same).why_none == "" and connection_with(old, same).places == 2
    order = Order("id", "key", "topic", "a" * 64, "0.1.0", task_of(Path()), [])
    detail = refusal(order, old).detail
    assert "0.0.9 (bbbbbbbbbbbb)" in detail and "0.1.0 (aaaaaaaaaaaa)" in detail


def test_pool_without_tls_beyond_this_machine_is_refused_unless_that_is_said(tmp_path: Path) -> None:
    cert, key = certificates.make(tmp_path)
    assert check_pool(PoolWire("tcp://127.0.0.1:8786")) == "" == check_pool(PoolWire("tls://far.example:8786", cert, key))
    assert "run code" in check_pool(PoolWire("tcp://far.example:8786", plain=True))
    for wire, word in (
        (PoolWire("tcp://far.example:8786"), "run code"),
        (PoolWire("tls://far.example:8786"), "without a certificate"),
        (PoolWire("tls://far.example:8786", cert), "without a certificate"),
        (PoolWire("tcp://127.0.0.1:8786", cert, key), "without TLS"),
        *((PoolWire(text), "no address") for text in ("", "far.example", "http://a:1", "tcp://far.example", "tcp://:1", "tcp://a:b", "tls://a:1/x")),
    ):
        with pytest.raises(PoolError, match=word) as caught:
            check_pool(wire)
        assert caught.value.hint and "\n" not in caught.value.message
    with pytest.raises(TlsError):
        check_pool(PoolWire("tls://far.example:8786", cert, tmp_path / "no.key"))


def test_commands_and_service_start_without_dask() -> None:
    code = "import sys, cellctl.cli.app, cellctl.api.app; sys.exit(any(name in sys.modules for name in ('distributed', 'dask')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
