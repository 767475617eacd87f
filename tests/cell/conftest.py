"""A fresh cell with a store of its own for every test."""

from __future__ import annotations

import os
import tempfile
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

from tests.cell.harness import CellUnderTest

MEMORY = Path("/dev/shm")
"""A file system in memory: hundreds of commits per test do not wait for a disk."""


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """Where the test's store lies: in memory if this machine has such a place."""
    if not os.access(MEMORY, os.W_OK):
        yield tmp_path
        return
    with tempfile.TemporaryDirectory(prefix="cell-", dir=MEMORY) as name:
        yield Path(name)


@pytest.fixture
async def cell(folder: Path) -> AsyncIterator[CellUnderTest]:
    async with CellUnderTest(folder / "store.db") as under_test:
        yield under_test
