"""What holds for every test: no window opens, searches repeat, no thread outlives the test that started it; which bench it runs at."""

from __future__ import annotations

import os
import threading
from collections.abc import AsyncIterator, Generator
from pathlib import Path

import pytest
import pytest_asyncio
from hypothesis import settings

from tests.hardware.bench_file import VARIABLE, BenchFileError, chosen_bench
from tests.hardware.joined import AtBench, at_bench
from tests.postgres import database, postgres

__all__ = ["database", "postgres"]

os.environ.setdefault("MPLBACKEND", "Agg")

settings.register_profile("repository", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("repository")

THREAD_GRACE_S = 2.0  # a stopped thread may still be on its way out when its test ends


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """Remember which threads the fixtures had started before the test itself began."""
    item.stash[THREADS_BEFORE] = set(threading.enumerate())
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Generator[None, None, None]:
    """Fail a test that leaves a thread of its own behind."""
    outcome = yield
    before = item.stash.get(THREADS_BEFORE, None)
    if before is not None:
        left = [thread for thread in threading.enumerate() if thread not in before and is_ours(thread)]
        for thread in left:
            thread.join(THREAD_GRACE_S)
        alive = [thread.name for thread in left if thread.is_alive()]
        assert not alive, f"{item.name} left threads running: {', '.join(alive)}"
    return outcome


def pytest_configure(config: pytest.Config) -> None:
    """Tell the marker, and refuse a bench file that must not be run, before anything opens."""
    config.addinivalue_line("markers", f"hardware_ok: may run at the real cell that {VARIABLE} names")
    try:
        config.stash[BENCH_IS_REAL] = chosen_bench()[0].is_real
    except BenchFileError as error:
        raise pytest.UsageError(str(error)) from None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """At real hardware nothing runs but what is marked for it."""
    if not config.stash[BENCH_IS_REAL]:
        return
    others = [item for item in items if item.get_closest_marker("hardware_ok") is None]
    config.hook.pytest_deselected(items=others)
    items[:] = [item for item in items if item.get_closest_marker("hardware_ok") is not None]


@pytest_asyncio.fixture
async def bench_cell(tmp_path: Path) -> AsyncIterator[AtBench]:
    """The far end that the bench file names, behind a guard; at the end nothing was asked that could lead to light."""
    facts, cell = chosen_bench()
    async with at_bench(facts, cell, tmp_path / "bench") as bench:
        yield bench
        bench.check_dark()


def is_ours(thread: threading.Thread) -> bool:
    """Whether a test answers for this thread: not daemons, and not the pool of an event loop that fixtures share."""
    return not thread.daemon and not thread.name.startswith("asyncio_")


BENCH_IS_REAL = pytest.StashKey[bool]()
THREADS_BEFORE = pytest.StashKey[set[threading.Thread]]()
