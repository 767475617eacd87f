"""Fuzz the OBJ reader: `python -m tests.fuzz.obj -max_total_time=60`."""

import sys

from tests.fuzz.harness import fuzz

if __name__ == "__main__":
    sys.exit(fuzz(".obj", sys.argv[1:]))
