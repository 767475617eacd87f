"""Fuzz the PLY reader: `python -m tests.fuzz.ply -max_total_time=60`."""

import sys

from tests.fuzz.harness import fuzz

if __name__ == "__main__":
    sys.exit(fuzz(".ply", sys.argv[1:]))
