"""LinuxCNC's stand-alone interpreter reads what is posted: its canonical moves are those of our own reread."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from config.cell import load_cell
from planner.post import post
from planner.post.reread import read
from planner.program import Program
from tests.unit.planner.hand_plan import hybrid_plan

RS274 = shutil.which("rs274")
pytestmark = pytest.mark.skipif(RS274 is None, reason="rs274 (Debian package linuxcnc-uspace) is not installed")

CANONICAL = "XYZABC"
MOVE = re.compile(r"N(\d+)\s+STRAIGHT_(FEED|TRAVERSE)\(([^)]*)\)")
RATE = re.compile(r"N(\d+)\s+SET_FEED_RATE\(([^)]*)\)")
MODE = re.compile(r"N(\d+)\s+SET_FEED_MODE\(0, ([01])\)")


def canonical(program: Program, folder: Path) -> str:
    path = folder / "program.ngc"
    path.write_text("".join(line + "\n" for line in program.lines))
    (folder / "tools.tbl").write_text("".join(f"T{n} P{n} D8.0 Z0.0\n" for n in program.tools))
    command = [str(RS274), "-g", "-t", str(folder / "tools.tbl"), "-v", str(folder / "rs274.var"), str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=folder)
    assert done.returncode == 0, done.stdout[-500:] + done.stderr[-500:]
    return done.stdout


@pytest.mark.parametrize("name", ["trunnion_tcp", "trunnion_rtu", "head_head", "head_table"])
def test_linuxcnc_makes_the_same_moves_of_the_text(name: str, tmp_path: Path) -> None:
    program = post(hybrid_plan(), load_cell(name))
    reading = read(program)
    text = canonical(program, tmp_path)
    found = [
        (int(n), kind == "TRAVERSE", [float(value) for value in values.split(",")])
        for n, kind, values in MOVE.findall(text)
    ]
    expected = np.flatnonzero(reading.is_motion) + 1
    assert [n for n, _, _ in found] == expected.tolist()
    assert [rapid for _, rapid, _ in found] == reading.is_rapid[expected - 1].tolist()
    columns = [CANONICAL.index(letter) for letter in program.axis_letters]
    theirs = np.array([values for _, _, values in found])[:, columns]
    ours = reading.joints[expected] - program.work_offset
    known = ~np.isnan(ours)
    assert np.abs(theirs - ours)[known].max() < 1e-4  # it prints four decimals
    assert known[5:].all()


def test_linuxcnc_reads_inverse_time_where_a_rotary_axis_turns_and_nowhere_else(tmp_path: Path) -> None:
    program = post(hybrid_plan(), load_cell("head_head"))
    reading = read(program)
    text = canonical(program, tmp_path)
    turning = np.append(False, np.any(np.diff(reading.joints[1:, 3:], axis=0) != 0.0, axis=1)) & ~reading.is_rapid
    by_time = np.array(["G93" in line for line in program.lines])
    switches = re.findall(r"interpreter: feed mode set to (inverse time|units per minute)", text)
    assert switches.count("inverse time") == by_time.sum() == 1
    assert turning.sum() > 50


def test_linuxcnc_keeps_the_feed_of_upright_deposition(tmp_path: Path) -> None:
    program = post(hybrid_plan(), load_cell("trunnion_tcp"))
    rates = {float(value) for _, value in RATE.findall(canonical(program, tmp_path))}
    assert 720.0 in rates  # 12 mm/s
