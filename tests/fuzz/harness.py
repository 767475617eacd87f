"""Coverage-guided fuzzing of one reader with atheris; words after the module are libFuzzer's."""

from __future__ import annotations

import sys
import tempfile
import types
from pathlib import Path

ALLOCATION_MB = 1024
"""Memory at which libFuzzer calls an input hostile; the seeds need a tenth."""


def fuzz(suffix: str, words: list[str]) -> int:
    """Fuzz the reader of one suffix until the time of -max_total_time (60 s if not given) is over.

    Returns 1, after one line, where atheris is not installed; otherwise libFuzzer ends the process.
    """
    try:
        import atheris
    except ImportError:
        print("atheris is not installed: make bench installs it", file=sys.stderr)
        return 1
    with atheris.instrument_imports(include=["trimesh.exchange"]):
        import trimesh.exchange.load  # noqa: F401
    from planner.mesh import read

    for name, function in vars(read).copy().items():  # not by import: compiled kernels bear no instruments
        if isinstance(function, types.FunctionType) and function.__module__ == read.__name__:
            setattr(read, name, atheris.instrument_func(function))
    from tests.fuzz.reading import assert_mesh_or_one_line
    from tests.fuzz.seeds import seeds

    with tempfile.TemporaryDirectory() as folder:
        for number, data in enumerate(seeds(suffix)):
            assert_mesh_or_one_line(data, suffix)  # compiles what is compiled on first use
            (Path(folder) / f"seed{number}").write_bytes(data)
        given = [word for word in words if word.startswith("-")]
        if not any(word.startswith("-max_total_time") for word in given):
            given.append("-max_total_time=60")
        options = [f"-rss_limit_mb={ALLOCATION_MB}", "-timeout=20", "-max_len=4096", *given]
        inputs = [word for word in words if not word.startswith("-")]
        atheris.Setup(
            [sys.argv[0], *options, *(inputs or [folder])], lambda data: assert_mesh_or_one_line(data, suffix) and None
        )
        atheris.Fuzz()
    return 0
