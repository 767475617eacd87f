"""Fuzz the 3MF reader: `python -m tests.fuzz.threemf -max_total_time=60`."""

import sys

from tests.fuzz.harness import fuzz

if __name__ == "__main__":
    sys.exit(fuzz(".3mf", sys.argv[1:]))
