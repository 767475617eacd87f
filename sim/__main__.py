"""`python -m sim --cell FILE --run DIR`: the devices of one cell, simulated, behind real wires."""

from __future__ import annotations

import argparse
import asyncio
import sys
from pathlib import Path

from config import ConfigError, load_cell
from sim.control import CommandError
from sim.faults import FaultScriptError
from sim.server import serve
from sim.wires import WireError


def arguments() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m sim", description="A simulated cell behind real wires.")
    parser.add_argument("--cell", default="trunnion_tcp", help="cell file, or name of a shipped one")
    parser.add_argument(
        "--run", type=Path, required=True, help="directory for ports, socket and the resolved cell.toml"
    )
    parser.add_argument("--time-scale", type=float, default=1.0, help="process time per wall time")
    parser.add_argument(
        "--fault", action="append", default=[], metavar="TEXT", help="as in 'at=12.5s door_open'; again for more"
    )
    parser.add_argument("--stock-cell-mm", type=float, default=0.5, help="grid of the metal")
    parser.add_argument("--mesh", type=Path, help="part to measure the metal against, in the build frame")
    parser.add_argument("--at-baud", action="store_true", help="carry bytes at the pace of the baud rates")
    return parser


def main() -> int:
    """Run until told to stop. Exit 2 for what the user can put right, told in one line and a hint."""
    given = arguments().parse_args()
    try:
        asyncio.run(
            serve(
                load_cell(given.cell), given.run, time_scale=given.time_scale, faults=given.fault,
                stock_cell_mm=given.stock_cell_mm, mesh_path=given.mesh, at_baud=given.at_baud,
            )
        )  # fmt: skip
    except (ConfigError, FaultScriptError, WireError) as error:
        print(f"sim: {error.message}", file=sys.stderr)
        if error.hint:
            print(f"  {error.hint}", file=sys.stderr)
        return 2
    except CommandError as error:
        print(f"sim: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
