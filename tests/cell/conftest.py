"""A fresh cell with a store of its own for every test."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from tests.cell.harness import CellUnderTest


@pytest.fixture
async def cell(tmp_path: Path) -> AsyncIterator[CellUnderTest]:
    async with CellUnderTest(tmp_path / "store.db") as under_test:
        yield under_test
