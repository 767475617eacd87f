"""What a cell runs lies on its own host's disk before it starts, whatever becomes of the files that hosts share."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from cellctl.cell.program_form import form_beside
from cellctl.planning.at_hand import KEPT, bring
from cellctl.store.blobs import Blobs


def name_of(number: int) -> str:
    return f"{number:064x}"


def put(blobs: Blobs, sha256: str) -> None:
    """A program and its form, as planning leaves them."""
    for folder in (blobs.program(sha256), form_beside(blobs.program(sha256))):
        folder.mkdir(parents=True)
        (folder / "body").write_text(f"{folder.name}", encoding="ascii")


@pytest.fixture
def shared(tmp_path: Path) -> Blobs:
    blobs = Blobs(tmp_path / "net", tmp_path / "own", "host")
    blobs.make_folders()
    return blobs


def test_program_of_shared_files_is_copied_with_its_form_and_outlives_them(shared: Blobs) -> None:
    put(shared, name_of(1))
    here = bring(shared, name_of(1))
    shutil.rmtree(shared.folder)
    assert bring(shared, name_of(1)) == here and shared.folder not in here.parents
    assert (here / "body").read_text() == here.name and (form_beside(here) / "body").read_text() == f"{here.name}.form"


def test_copy_that_broke_off_is_made_anew(shared: Blobs) -> None:
    put(shared, name_of(1))
    target = shared.program_at_hand(name_of(1))
    (target.with_name(f".{target.name}.part") / "rubbish").mkdir(parents=True)
    assert sorted(path.name for path in bring(shared, name_of(1)).iterdir()) == ["body"]


def test_program_that_is_not_there_is_an_error_and_leaves_nothing_to_start(shared: Blobs) -> None:
    with pytest.raises(OSError):
        bring(shared, name_of(7))
    assert not shared.program_at_hand(name_of(7)).exists()


def test_those_started_last_stay_and_older_ones_go(shared: Blobs) -> None:
    for number in range(KEPT + 3):
        put(shared, name_of(number))
        os.utime(bring(shared, name_of(number)), (number, number))
    bring(shared, name_of(0))
    there = {path.name for path in shared.program_at_hand("x").parent.iterdir()}
    kept = {name_of(number) for number in (0, *range(4, KEPT + 3))}
    assert there == kept | {f"{name}.form" for name in kept}


def test_nothing_is_copied_where_nothing_is_shared(tmp_path: Path) -> None:
    blobs = Blobs(tmp_path)
    put(blobs, name_of(1))
    assert bring(blobs, name_of(1)) == blobs.program(name_of(1))
