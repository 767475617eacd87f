"""The black box: what was written last is read back, whatever a kill tore."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.cell.black_box import JOB_BYTES, SLOT_BYTES, BlackBox, Moment, Place


def moment(k: int, job: str = "job-1") -> Moment:
    at, lit, dark = Place(k, 0.25, 3.5 * k), Place(k - 1, 1.0, 3.0), Place(k, 0.5, 4.0)
    return Moment(job, 1.8e9 + k, float(k), at, 0.1 * k, lit, 0.9, dark, k, k + 9, True, 800.0, 10.0)


def test_the_last_moment_is_there_for_the_next_process(tmp_path: Path) -> None:
    first = BlackBox(tmp_path / "box")
    assert first.last is None
    for k in range(5):
        first.write(moment(k))
    second = BlackBox(tmp_path / "box")  # while the first still has its mapping, as a killed one leaves it
    assert second.last == moment(4)
    assert second.of_job("job-1") == moment(4) and second.of_job("job-2") is None
    second.write(moment(9))
    assert BlackBox(tmp_path / "box").last == moment(9)
    first.close()
    second.remove()
    assert not (tmp_path / "box").exists()


@given(cut=st.integers(0, SLOT_BYTES - 1), junk=st.binary(min_size=1, max_size=64))
def test_a_torn_record_is_told_and_the_one_before_it_counts(tmp_path_factory: pytest.TempPathFactory, cut: int, junk: bytes) -> None:
    path = tmp_path_factory.mktemp("box") / "box"
    box = BlackBox(path)
    for k in range(4):
        box.write(moment(k))
    box.close()
    content = bytearray(path.read_bytes())
    newest = content[SLOT_BYTES * (4 % 2) :]
    torn = bytes(newest[:cut]) + junk
    content[SLOT_BYTES * (4 % 2) : SLOT_BYTES * (4 % 2) + min(len(torn), SLOT_BYTES)] = torn[:SLOT_BYTES]
    path.write_bytes(bytes(content))
    again = BlackBox(path)
    assert again.last in (moment(2), moment(3))
    again.close()


def test_a_file_of_another_kind_is_no_moment_and_is_written_over(tmp_path: Path) -> None:
    (tmp_path / "box").write_bytes(b"something else" * 100)
    box = BlackBox(tmp_path / "box")
    assert box.last is None
    box.write(moment(1, "ä" * JOB_BYTES))
    again = BlackBox(tmp_path / "box")
    assert again.of_job("ä" * JOB_BYTES) is not None
    box.close()
    again.close()
