"""A sealed record: whatever is done to its files afterwards is noticed, and named."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from cellctl.record.layout import MANIFEST, PUBLIC_KEY, SIGNATURE
from cellctl.record.seal import KEY_FILE, Seal, SealError, open_seal, verify


@pytest.fixture
def record(tmp_path: Path) -> Path:
    folder = tmp_path / "record"
    folder.mkdir()
    (folder / "record.json").write_text('{"laser_w": 1200}', encoding="utf-8")
    (folder / "samples.parquet").write_bytes(bytes(range(256)) * 10)
    open_seal(tmp_path).close(folder, {"job": "job-1", "sealed_at": 1.0})
    return folder


def change_a_figure(folder: Path) -> None:
    (folder / "record.json").write_text('{"laser_w": 1100}', encoding="utf-8")


def change_a_byte(folder: Path) -> None:
    data = bytearray((folder / "samples.parquet").read_bytes())
    data[1234] ^= 1
    (folder / "samples.parquet").write_bytes(data)


def take_one_away(folder: Path) -> None:
    (folder / "record.json").unlink()


def add_one(folder: Path) -> None:
    (folder / "more.json").write_text("{}", encoding="utf-8")


def change_the_manifest(folder: Path) -> None:
    """The figure and its hash in the manifest: only the signature tells."""
    change_a_figure(folder)
    manifest = json.loads((folder / MANIFEST).read_bytes())
    manifest["files"]["record.json"] = hashlib.sha256((folder / "record.json").read_bytes()).hexdigest()
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=1, sort_keys=True), encoding="utf-8")


def seal_it_anew(folder: Path) -> None:
    """Everything, with a key of one's own: only who knows the service's key notices."""
    change_a_figure(folder)
    for name in (MANIFEST, SIGNATURE, PUBLIC_KEY):
        (folder / name).unlink()
    Seal(Ed25519PrivateKey.generate()).close(folder, {"job": "job-1", "sealed_at": 1.0})


CHANGES: list[tuple[Callable[[Path], None], str]] = [
    (change_a_figure, "record.json: was changed"),
    (change_a_byte, "samples.parquet: was changed"),
    (take_one_away, "record.json: is missing"),
    (add_one, "more.json: was not there"),
    (change_the_manifest, "its signature does not fit"),
    (seal_it_anew, "its signature does not fit"),
]


@pytest.mark.parametrize(("change", "said"), CHANGES, ids=lambda value: getattr(value, "__name__", ""))
def test_whatever_is_changed_in_a_sealed_record_is_named(record: Path, change: Callable[[Path], None], said: str) -> None:
    key = (record / PUBLIC_KEY).read_bytes()
    assert set(verify(record, key)["files"]) == {"record.json", "samples.parquet"}
    change(record)
    with pytest.raises(SealError, match=said):
        verify(record, key)


def test_the_key_is_the_owners_alone_and_stays(tmp_path: Path) -> None:
    first, again = open_seal(tmp_path), open_seal(tmp_path)
    assert first.fingerprint == again.fingerprint and (tmp_path / KEY_FILE).stat().st_mode & 0o777 == 0o600
    assert [path.name for path in tmp_path.iterdir()] == [KEY_FILE]
    (tmp_path / KEY_FILE).chmod(0o644)
    with pytest.raises(SealError, match="others may read"):
        open_seal(tmp_path)


def test_a_record_moved_elsewhere_verifies_by_the_key_beside_it(record: Path, tmp_path: Path) -> None:
    moved = shutil.copytree(record, tmp_path / "elsewhere")
    assert verify(moved)["key"] == open_seal(tmp_path).fingerprint
