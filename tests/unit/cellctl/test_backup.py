"""A backup of a store that is written to, and what is restored from it: every row, every file, or nothing."""

from __future__ import annotations

import hashlib
import io
import sqlite3
import tarfile
import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from cellctl.record.seal import open_seal
from cellctl.store import Store, audit, open_store, upgrade
from cellctl.store.audit import Deed
from cellctl.store.backup import back_up, restore
from cellctl.store.engine import DATABASE, StoreError

DEED = Deed("erin", "engineer", "127.0.0.1", "upload", "part-1", "")


def keep(store: Store, data: bytes) -> str:
    """A file under its hash, as an upload leaves it, then the row that names it."""
    sha256 = hashlib.sha256(data).hexdigest()
    store.blobs.part(sha256, ".stl").write_bytes(data)
    with store.write() as rows:
        audit.add(rows, Deed(**{**DEED.__dict__, "target": sha256}), 1.0, "ok")
    return sha256


def rows_of(database: Path) -> dict[str, list[tuple[object, ...]]]:
    with closing(sqlite3.connect(database)) as db:
        names = [row[0] for row in db.execute("SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite%' ORDER BY name")]
        return {name: db.execute(f'SELECT * FROM "{name}" ORDER BY rowid').fetchall() for name in names}


def test_a_restored_store_has_every_row_every_file_and_the_key(store: Store, tmp_path: Path) -> None:
    shas = [keep(store, f"part {k}".encode() * 1000) for k in range(5)]
    (store.blobs.program("c" * 64)).mkdir()
    (store.blobs.program("c" * 64) / "layer_0001.ngc").write_text("G1 X1\n")
    key = open_seal(store.folder).fingerprint
    made = back_up(store.folder, tmp_path / "b.tar", 5.0)
    back = restore(tmp_path / "b.tar", tmp_path / "again" / "store")
    assert back == made and made.files == 8
    assert rows_of(tmp_path / "again" / "store" / DATABASE) == rows_of(store.folder / DATABASE)
    upgrade(tmp_path / "again" / "store")
    other = open_store(tmp_path / "again" / "store")
    try:
        for sha in shas:
            assert hashlib.sha256(other.blobs.part(sha, ".stl").read_bytes()).hexdigest() == sha
        assert (other.blobs.program("c" * 64) / "layer_0001.ngc").read_text() == "G1 X1\n"
    finally:
        other.close()
    assert open_seal(tmp_path / "again" / "store").fingerprint == key


def test_a_backup_beside_writers_names_no_file_that_it_does_not_hold(store: Store, tmp_path: Path) -> None:
    stop, written = threading.Event(), threading.Event()

    def write() -> None:
        k = 0
        while not stop.is_set():
            keep(store, f"{k}".encode() * 500)
            k += 1
            if k == 20:
                written.set()

    writer = threading.Thread(target=write)
    writer.start()
    try:
        assert written.wait(30.0)
        for k in range(5):
            back_up(store.folder, tmp_path / f"{k}.tar", 1.0)
    finally:
        stop.set()
        writer.join()
    for k in range(5):
        restore(tmp_path / f"{k}.tar", tmp_path / f"store{k}")
        named = {str(row[6]) for row in rows_of(tmp_path / f"store{k}" / DATABASE)["audit"]}
        there = {path.stem for path in (tmp_path / f"store{k}" / "blobs" / "parts").iterdir()}
        assert len(named) >= 20 and named <= there


def cut_off(data: bytes) -> bytes:
    return data[: len(data) // 2]


def change_a_bit(data: bytes) -> bytes:
    place = data.index(b"part 3part 3")
    return data[:place] + b"P" + data[place + 1 :]


def lead_out(data: bytes) -> bytes:
    """A member more, whose name leads out of the folder."""
    out = io.BytesIO()
    with tarfile.open(fileobj=io.BytesIO(data)) as old, tarfile.open(fileobj=out, mode="w") as new:
        for member in old:
            new.addfile(member, old.extractfile(member))
        info = tarfile.TarInfo("blobs/parts/../../../escaped")
        info.size = 4
        new.addfile(info, io.BytesIO(b"evil"))
    return out.getvalue()


def link_out(data: bytes) -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w") as new:
        info = tarfile.TarInfo("blobs/parts/link")
        info.type, info.linkname = tarfile.SYMTYPE, "/etc/passwd"
        new.addfile(info)
    return out.getvalue()


@pytest.mark.parametrize("spoil", [cut_off, change_a_bit, lead_out, link_out, lambda _data: b"no tar at all"])
def test_a_backup_that_is_not_whole_leaves_nothing_behind(store: Store, tmp_path: Path, spoil: Callable[[bytes], bytes]) -> None:
    for k in range(5):
        keep(store, f"part {k}".encode() * 1000)
    back_up(store.folder, tmp_path / "b.tar", 5.0)
    (tmp_path / "bad.tar").write_bytes(spoil((tmp_path / "b.tar").read_bytes()))
    before = sorted(path.name for path in tmp_path.iterdir())
    with pytest.raises(StoreError, match=r"bad\.tar: cannot be restored"):
        restore(tmp_path / "bad.tar", tmp_path / "again")
    assert sorted(path.name for path in tmp_path.iterdir()) == before and not (tmp_path.parent / "escaped").exists()


def test_nothing_is_written_over(store: Store, tmp_path: Path) -> None:
    back_up(store.folder, tmp_path / "b.tar", 5.0)
    first = (tmp_path / "b.tar").read_bytes()
    with pytest.raises(StoreError, match="is there already"):
        back_up(store.folder, tmp_path / "b.tar", 6.0)
    assert (tmp_path / "b.tar").read_bytes() == first
    with pytest.raises(StoreError, match="is not empty"):
        restore(tmp_path / "b.tar", store.folder)
    with pytest.raises(StoreError, match="there is no store here"):
        back_up(tmp_path / "nowhere", tmp_path / "c.tar", 6.0)
