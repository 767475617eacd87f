"""Runs every bench_*.py of this folder that has `run() -> list[Table]`, prints the tables and keeps them in results/.

Words on the command line choose: `python -m tests.bench slicing post` runs the modules whose names hold one of them (`rest` is bench_rest alone).
"""

from __future__ import annotations

import importlib
import platform
import sys
import time
from pathlib import Path

FOLDER = Path(__file__).resolve().parent


def chosen(words: list[str]) -> list[str]:
    """Names of the bench modules that hold one of the words, all if there is none, sorted. A word that is a whole name means that one."""
    names = sorted(path.stem for path in FOLDER.glob("bench_*.py"))
    whole = {word for word in words if f"bench_{word}" in names}
    return [name for name in names if not words or any(f"bench_{word}" == name if word in whole else word in name for word in words)]


def main(words: list[str]) -> int:
    """Measure; exit 1 if nothing was chosen or a measurement failed (the others still run)."""
    names = chosen(words)
    if not names:
        asked = f" with {' or '.join(words)} in its name" if words else ""
        print(f"bench: there is no tests/bench/bench_*.py{asked}", file=sys.stderr)
        return 1
    print(f"{platform.platform()}, Python {platform.python_version()}, {len(names)} measurements\n", flush=True)
    failed = []
    for name in names:
        started = time.perf_counter()
        try:
            tables = importlib.import_module(f"tests.bench.{name}").run()
        except Exception as error:  # noqa: BLE001  one measurement that fails must not hide the others
            failed.append(name)
            print(f"{name} failed: {type(error).__name__}: {error}\n", file=sys.stderr, flush=True)
            continue
        for table in tables:
            table.write()
            print(table.markdown())
        print(f"({name}: {time.perf_counter() - started:.1f} s)\n", flush=True)
    if failed:
        print(f"bench: failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
