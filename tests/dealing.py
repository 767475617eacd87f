"""Deals the test modules to several pytest processes: each takes the next that none has, so that all end together.

`python -m pytest -p tests.dealing --deal=FOLDER --lane=served|computed|gaps`, once for each lane, with one empty folder for all.
One lane talks to services, wires and browsers, which wait more than they compute, one computes; each goes on with what the other has
left. The third is for the gaps of both, at a low priority: it takes short modules only, of those whose tests start no process.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LANES = ("served", "computed", "gaps")
SERVED = (
    "tests/console/", "tests/wire/", "tests/cell/test_going_on_over_rest.py", "tests/cell/test_process.py",
    "tests/cell/test_rest.py", "tests/cell/test_tutorial.py",
)  # fmt: skip
PURE = ("tests/property/", "tests/unit/drivers/", "tests/unit/planner/", "tests/unit/sim/")
# Of each lane what takes ten seconds or more, longest first: it goes before all others, so that nobody waits for it at the end.
LONGEST = (
    "tests/cell/test_going_on_over_rest.py", "tests/console/test_console.py", "tests/cell/test_rest.py",
    "tests/console/test_parts.py", "tests/console/test_going_on.py", "tests/console/test_view.py",
    "tests/console/test_job_life.py", "tests/console/test_hand.py", "tests/cell/test_tutorial.py",
    "tests/unit/cellctl/test_abuse_requests.py", "tests/unit/planner/test_model_closed.py",
    "tests/unit/planner/test_layers_confirmed.py", "tests/unit/cellctl/test_api_schema.py",
    "tests/unit/planner/test_nurbs_offset_curves.py", "tests/unit/cellctl/test_own_material.py",
    "tests/unit/planner/test_proof_of_milling.py", "tests/unit/planner/test_nurbs_surface.py",
    "tests/unit/planner/decompose/test_division.py", "tests/cell/test_emission.py", "tests/cell/test_going_on.py",
    "tests/cell/test_stop.py", "tests/unit/planner/test_show.py", "tests/unit/planner/test_matching_walls.py",
    "tests/unit/planner/test_pipeline.py", "tests/unit/planner/test_section_planes.py",
    "tests/unit/planner/test_layers_handed_out.py",
)  # fmt: skip


def pytest_addoption(parser: pytest.Parser) -> None:
    """Where the processes tell one another what they took, and which of them this one is."""
    parser.addoption("--deal", type=Path, required=True, metavar="FOLDER", help="the same empty folder for all processes")
    parser.addoption("--lane", choices=LANES, required=True, help="which modules this process takes, and in which order")


def pytest_configure(config: pytest.Config) -> None:
    """Refuse to run without the repository's settings: pytest takes a folder that is named apart from `--deal=` for where the tests are."""
    if config.inipath is None or config.rootpath != ROOT:
        raise pytest.UsageError(f"{config.rootpath} is not where the tests are; name the folder as --deal=FOLDER")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """What a lane never takes it does not load."""
    is_other = collection_path.is_file() and not collection_path.relative_to(config.rootpath).as_posix().startswith(PURE)
    return True if is_other and config.getoption("lane") == "gaps" else None


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop(session: pytest.Session) -> bool:
    """Run what this process takes, a module at a time."""
    if session.testsfailed:
        raise session.Interrupted(f"{session.testsfailed} errors while collecting")
    if session.config.option.collectonly:
        return True
    items = taken(session)
    item = next(items, None)
    while item is not None:
        following = next(items, None)
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        if session.shouldfail:
            raise session.Failed(session.shouldfail)
        if session.shouldstop:
            raise session.Interrupted(session.shouldstop)
        item = following
    return True


def taken(session: pytest.Session) -> Iterator[pytest.Item]:
    """The tests of each module that is taken; the next one is taken when the last test of this one is about to begin."""
    folder: Path = session.config.getoption("deal")
    modules: dict[str, list[pytest.Item]] = {}
    for item in session.items:
        modules.setdefault(item.nodeid.partition("::")[0], []).append(item)
    for path in wanted(modules, session.config.getoption("lane")):
        if take(folder / path.replace("/", ".")):
            yield from modules[path]


def take(claim: Path) -> bool:
    """Whether nobody has taken it; this process has, from now on."""
    try:
        os.close(os.open(claim, os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return False
    return True


def wanted(paths: Iterable[str], lane: str) -> list[str]:
    """What a lane takes if nobody has, in this order. Lane "gaps" begins at the other end than "computed"."""
    longest_first = sorted(paths, key=lambda path: LONGEST.index(path) if path in LONGEST else len(LONGEST))
    if lane == "gaps":
        return [path for path in reversed(longest_first) if path.startswith(PURE) and path not in LONGEST]
    return sorted(longest_first, key=lambda path: path.startswith(SERVED) != (lane == "served"))
