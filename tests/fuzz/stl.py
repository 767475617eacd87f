"""Fuzz the STL reader: `python -m tests.fuzz.stl -max_total_time=60`."""

import sys

from tests.fuzz.harness import fuzz

if __name__ == "__main__":
    sys.exit(fuzz(".stl", sys.argv[1:]))
