"""The command line: `cellctl`. Commands import what they need when they run, so that `--help` is quick."""

from __future__ import annotations

import os
import sys


def main() -> None:
    """Run the command line; user faults become one line, a hint and an exit code here and nowhere else."""
    from cellctl import faults
    from cellctl.cli.app import app

    try:
        app()
    except KeyboardInterrupt:
        sys.stderr.write("cellctl: interrupted\n")
        sys.exit(130)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except Exception as error:
        fault = faults.explain(error)
        if fault is None:
            raise
        faults.report(fault)
        sys.exit(fault.exit_code)
