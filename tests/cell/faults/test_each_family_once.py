"""One run of the matrix for each family of faults; `python -m tests.bench.bench_faults` plays all of them many times."""

from __future__ import annotations

import pytest

from tests.cell.faults.play import Key, play
from tests.cell.faults.rows import ROWS

KEYS: list[Key] = [
    ("serial unplugged", "depositing", "stream", 0),
    ("replugged under another name", "jogging", "stream", 0),
    ("half a line to the machine", "depositing", "modbus", 0),
    ("ok doubled", "depositing", "stream", 0),
    ("machine says nothing", "homing", "stream", 0),
    ("firmware reset", "depositing", "modbus", 0),
    ("limit hit", "homing", "stream", 0),
    ("laser gone, connection refused", "depositing", "stream", 0),
    ("laser server restarted", "depositing", "stream", 0),
    ("io server restarted", "depositing", "modbus", 0),
    ("io answers exceptions", "depositing", "modbus", 0),
    ("door opened and closed within a tick", "depositing", "stream", 0),
    ("E-stop pressed", "jogging", "stream", 0),
    ("powder clogged", "depositing", "stream", 0),
    ("machine powered off", "jogging", "stream", 0),
]


@pytest.mark.parametrize("key", KEYS, ids=lambda key: "-".join(str(part).replace(" ", "_") for part in key[:3]))
def test_a_fault_is_told_leaves_no_light_and_can_be_reset(key: Key) -> None:
    outcome = play(key)
    assert not outcome.wrong, f"{outcome.key}: {outcome.wrong}"
    assert outcome.ended not in ("", "passed")


def test_every_row_has_a_name_of_its_own_and_says_what_has_to_be_told() -> None:
    assert len({row.name for row in ROWS}) == len(ROWS)
    assert all(row.codes or row.words for row in ROWS if row.must)
