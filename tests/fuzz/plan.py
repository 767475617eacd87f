"""Fuzz the plan reader under checksums that fit: `python -m tests.fuzz.plan -max_total_time=60`."""

from __future__ import annotations

import sys
import tempfile
import types
from pathlib import Path

from planner.files import plan_tables
from planner.files.plan_file import HEAD_BYTES, _head, plan_bytes, plan_from_bytes
from planner.plan import PLAN_SCHEMA, Plan
from tests.fuzz.test_plan_files import assert_given_or_one_line
from tests.unit.planner.hand_plan import hybrid_plan


def read_body(body: bytes) -> None:
    """Read a plan file of this body behind a head that fits it: a Plan or one line, else it raises."""
    assert_given_or_one_line(lambda: plan_from_bytes(_head(PLAN_SCHEMA, body) + body), Plan)


def main(words: list[str]) -> int:
    """Fuzz for 60 s unless -max_total_time says otherwise. Returns 1, after one line, where atheris is not installed."""
    try:
        import atheris
    except ImportError:
        print("atheris is not installed: make bench installs it", file=sys.stderr)
        return 1
    for name, function in vars(plan_tables).copy().items():
        if isinstance(function, types.FunctionType) and function.__module__ == plan_tables.__name__:
            setattr(plan_tables, name, atheris.instrument_func(function))
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "seed").write_bytes(plan_bytes(hybrid_plan())[HEAD_BYTES:])
        options = ["-max_total_time=60", "-rss_limit_mb=1024", "-timeout=20", "-len_control=0", *words]
        atheris.Setup([sys.argv[0], *options, folder], read_body)
        atheris.Fuzz()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
