"""LinuxCNC's own interpreter reads what is posted: its canonical moves are those of our own reread, its NURBS are our curves."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from config.cell import load_cell
from planner.post import post
from planner.post.read_blocks import Reading
from planner.post.read_curves import de_boor
from planner.post.reread import read
from planner.program import Program
from tests.unit.planner.hand_plan import cone_operation, contour_operation, fill_operation, oval_operation, plan_of

RS274 = shutil.which("rs274")
PYTHON = "/usr/bin/python3"  # the one that Debian's module `gcode` is built for
GCODE = next(Path("/usr/lib/python3/dist-packages").glob("gcode.*.so"), None)
pytestmark = pytest.mark.skipif(RS274 is None, reason="rs274 (Debian package linuxcnc-uspace) is not installed")

CANONICAL = "XYZABC"
MOVE = re.compile(r"N(\d+)\s+STRAIGHT_(FEED|TRAVERSE)\(([^)]*)\)")
ARC = re.compile(r"N(\d+)\s+ARC_FEED\(([^)]*)\)")
NURBS = re.compile(r"N\S+\s+NURBS_FEED\((\d+), \.\.\.\)")
RATE = re.compile(r"N(\d+)\s+SET_FEED_RATE\(([^)]*)\)")
OUTPUT = re.compile(r"N(\d+)\s+(SET|CLEAR)_MOTION_OUTPUT_BIT\(0\)")
VALUE = re.compile(r"N(\d+)\s+SET_MOTION_OUTPUT_VALUE\(0,([\d.]+)\)")
INCH_MM = 25.4
PRINTED = 1e-4  # four decimals
PREVIEW = """
import gcode, json, sys

class Canon:
    parameter_file = sys.argv[2]
    def __init__(self):
        self.feeds, self.line = [], 0
    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        return lambda *words: None
    def next_line(self, state):
        self.line = state.sequence_number
    def straight_feed(self, *place):
        self.feeds.append([self.line, place[0], place[1]])
    def get_axis_mask(self):
        return 63
    def get_tool(self, pocket):
        return (pocket, *(0.0,) * 12, 0)
    def get_external_length_units(self):
        return 1 / 25.4
    def get_external_angular_units(self):
        return 1.0
    def get_block_delete(self):
        return False
    def check_abort(self):
        return False
    def get_axis_limits(self):
        return (-1e9, 1e9) * 9

canon = Canon()
result, line = gcode.parse(sys.argv[1], canon, "G21", "")
print(json.dumps({"result": result, "line": line, "feeds": canon.feeds}))
"""


@cache
def posted(name: str, dialect: str) -> Program:
    plan = plan_of([contour_operation(0), oval_operation(0), fill_operation(0), cone_operation(0)])
    return post(plan, load_cell(name), dialect=dialect)


def written(program: Program, folder: Path, without: str = "") -> Path:
    path = folder / "program.ngc"
    lines = [re.sub(without, "", line) if without else line for line in program.lines]
    path.write_text("".join(line + "\n" for line in lines))
    return path


def canonical(program: Program, folder: Path) -> str:
    path = written(program, folder)
    (folder / "tools.tbl").write_text("".join(f"T{n} P{n} D8.0 Z0.0\n" for n in program.tools))
    command = [str(RS274), "-g", "-t", str(folder / "tools.tbl"), "-v", str(folder / "rs274.var"), str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=folder)
    assert done.returncode == 0, done.stdout[-500:] + done.stderr[-500:]
    return done.stdout


def straight_lines(reading: Reading) -> NDArray[np.int64]:
    """N-words of the moves that are neither arcs nor parts of a NURBS."""
    bent = np.concatenate([reading.arcs.lines, reading.splines.lines])
    return np.setdiff1d(np.flatnonzero(reading.is_motion), bent) + 1


@pytest.mark.parametrize("dialect", ["grblhal", "linuxcnc"])
@pytest.mark.parametrize("name", ["trunnion_tcp", "trunnion_rtu", "head_head", "head_table"])
def test_linuxcnc_makes_the_same_moves_of_the_text(name: str, dialect: str, tmp_path: Path) -> None:
    program = posted(name, dialect)
    reading = read(program)
    text = canonical(program, tmp_path)
    found = [
        (int(n), kind == "TRAVERSE", [float(value) for value in values.split(",")])
        for n, kind, values in MOVE.findall(text)
    ]
    expected = straight_lines(reading)
    assert [n for n, _, _ in found] == expected.tolist()
    assert [rapid for _, rapid, _ in found] == reading.is_rapid[expected - 1].tolist()
    columns = [CANONICAL.index(letter) for letter in program.axis_letters]
    theirs = np.array([values for _, _, values in found])[:, columns]
    ours = reading.joints[expected] - program.work_offset
    known = ~np.isnan(ours)
    assert np.abs(theirs - ours)[known].max() < PRINTED
    assert known[5:].all()
    _assert_arcs(ARC.findall(text), reading, program)


def _assert_arcs(found: list[tuple[str, str]], reading: Reading, program: Program) -> None:
    """Ends, centre and sense of each arc."""
    assert [int(n) for n, _ in found] == (reading.arcs.lines + 1).tolist()
    xy = [program.axis_letters.index(letter) for letter in "XY"]
    for (_, text), line, centre, sweep in zip(
        found, reading.arcs.lines, reading.arcs.centre, reading.arcs.sweep, strict=True
    ):
        values = [float(value) for value in text.split(",")]
        ends = reading.joints[line + 1] - program.work_offset
        assert np.allclose(values[:2], ends[xy], atol=PRINTED)
        assert np.allclose(values[2:4], centre - program.work_offset[xy], atol=PRINTED)
        assert np.sign(values[4]) == np.sign(sweep)


def test_linuxcnc_reads_inverse_time_where_a_rotary_axis_turns_and_nowhere_else(tmp_path: Path) -> None:
    program = posted("head_head", "grblhal")
    reading = read(program)
    text = canonical(program, tmp_path)
    turning = np.append(False, np.any(np.diff(reading.joints[1:, 3:], axis=0) != 0.0, axis=1)) & ~reading.is_rapid
    by_time = np.array(["G93" in line for line in program.lines])
    switches = re.findall(r"interpreter: feed mode set to (inverse time|units per minute)", text)
    assert switches.count("inverse time") == by_time.sum() == 1
    assert turning.sum() > 50


def test_linuxcnc_keeps_the_feed_of_upright_deposition(tmp_path: Path) -> None:
    rates = {float(value) for _, value in RATE.findall(canonical(posted("trunnion_tcp", "grblhal"), tmp_path))}
    assert 720.0 in rates  # 12 mm/s


def test_linuxcnc_switches_gate_and_power_where_our_reading_has_them_and_blends_within_the_tolerance(
    tmp_path: Path,
) -> None:
    program = posted("trunnion_tcp", "linuxcnc")
    reading = read(program)
    text = canonical(program, tmp_path)
    edges = (np.flatnonzero(np.diff(reading.gate, prepend=False)) + 1).tolist()
    switched = [(int(n), kind == "SET") for n, kind in OUTPUT.findall(text)]
    assert switched == [(n, bool(reading.gate[n - 1])) for n in edges]
    for n, watts in VALUE.findall(text):
        assert reading.power_w[int(n) - 1] == pytest.approx(float(watts), abs=1e-3)
    path, merge = (
        float(re.search(pattern, text)[1])  # type: ignore[index]
        for pattern in (r"CANON_CONTINUOUS, ([\d.]+)", r"SET_NAIVECAM_TOLERANCE\(([\d.]+)")
    )
    assert 0.0 < merge < path and path + merge <= 0.4 * load_cell("trunnion_tcp").chord_tolerance_mm + 1e-9
    assert [int(n) for n in NURBS.findall(text)] == [len(points) for points in reading.splines.points]


@pytest.mark.skipif(GCODE is None, reason="Debian's Python module gcode (package linuxcnc-uspace) is not installed")
def test_linuxcnc_expands_each_nurbs_to_points_of_our_curve(tmp_path: Path) -> None:
    program = posted("trunnion_tcp", "linuxcnc")
    reading = read(program)
    script = tmp_path / "preview.py"
    script.write_text(PREVIEW)
    file = written(program, tmp_path, without=r"M6 T\d+")  # the preview looks for a running LinuxCNC's tool table there
    done = subprocess.run(
        [PYTHON, str(script), str(file), str(tmp_path / "preview.var")],
        capture_output=True, text=True, timeout=60, cwd=tmp_path, check=True,
    )  # fmt: skip
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["line"] >= len(program.lines) - 1
    splines = reading.splines
    assert len(splines.points) == 1
    feeds = np.array(told["feeds"])
    for k, points in enumerate(splines.points):
        end = int(splines.lines[splines.number == k][-1]) + 1
        theirs = INCH_MM * feeds[feeds[:, 0] == end][:, 1:]
        count = 15 * len(points)  # LinuxCNC's preview: so many steps of equal parameter a NURBS
        assert len(theirs) in (count, count + 1)
        top = len(points) - splines.order[k] + 1.0
        u = np.minimum(np.arange(1, len(theirs) + 1) * top / count, top)
        ours = de_boor(points, splines.weights[k], splines.order[k], u) - program.work_offset[:2]
        assert np.abs(theirs - ours).max() < 1e-6
