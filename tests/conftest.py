"""What holds for every test: no window opens, searches repeat, no thread outlives the test that started it."""

from __future__ import annotations

import os
import threading
from collections.abc import Generator

import pytest
from hypothesis import settings

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


def is_ours(thread: threading.Thread) -> bool:
    """Whether a test answers for this thread: not daemons, and not the pool of an event loop that fixtures share."""
    return not thread.daemon and not thread.name.startswith("asyncio_")


THREADS_BEFORE = pytest.StashKey[set[threading.Thread]]()
