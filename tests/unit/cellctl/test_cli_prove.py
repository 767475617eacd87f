"""`cellctl prove` on files: verdict by exit code, figures as JSON, report and picture as files, words for a person."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from cellctl import cli
from planner.files import read_program, write_program

pytestmark = pytest.mark.timeout(600)  # the first plan and proof after a change compile their kernels
GRID = ("--cell-mm", "0.5")


def run(*words: str, monkeypatch: pytest.MonkeyPatch) -> int:
    """Exit code of the command line in this process."""
    monkeypatch.setattr(sys, "argv", ["cellctl", *words])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    return int(caught.value.code or 0)


@pytest.fixture
def planned(block: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Path:
    """A plan of the block in a folder of one's own, which is the current one."""
    monkeypatch.chdir(tmp_path)
    options = ("--process", "deposit", "--tolerance", "0.5", "--cusp", "0.2")
    assert run("plan", str(block), "-o", "p.h5", *options, "--json", monkeypatch=monkeypatch) == 0
    capfd.readouterr()
    return tmp_path / "p.h5"


def test_report_and_picture_are_written_and_the_exit_code_is_the_verdict(
    planned: Path, block: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    words = ("prove", str(planned), "--mesh", str(block), *GRID, "--html", "out/r.html", "--png", "out/r.png", "--json")
    code = run(*words, monkeypatch=monkeypatch)
    said = json.loads(capfd.readouterr().out)
    assert code == (0 if said["passed"] else 1)
    report = Path("out/r.html").read_text(encoding="utf-8")
    assert report.startswith("<!doctype html>") and said["program_sha256"] in report and Path("out/r.png").read_bytes().startswith(b"\x89PNG")
    assert run(*words, monkeypatch=monkeypatch) == code
    assert json.loads(capfd.readouterr().out) == said and Path("out/r.html").read_text(encoding="utf-8") == report


def test_program_that_builds_another_part_does_not_pass_and_says_why(
    planned: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    trimesh.creation.box((16.0, 12.0, 2.0)).export("larger.stl")
    assert run("prove", str(planned), "--mesh", "larger.stl", *GRID, monkeypatch=monkeypatch) == 1
    first, *rest = capfd.readouterr().out.splitlines()
    assert first.startswith("NOT passed: block, 99 % of the surface within") and any("missing metal" in line for line in rest)


@pytest.mark.parametrize("option", ["--html", "--png"])
def test_place_that_cannot_be_written_is_said_before_the_work(
    option: str, block: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").mkdir()
    assert run("prove", "p.h5", "--mesh", str(block), option, "taken", monkeypatch=monkeypatch) == 2
    assert "taken: is a folder" in capfd.readouterr().err


@pytest.fixture
def posted(planned: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Path:
    """The program of that plan in a folder."""
    assert run("post", str(planned), "-o", "program", monkeypatch=monkeypatch) == 0
    capfd.readouterr()
    return planned.parent / "program"


def edit_late_layer(folder: Path) -> int:
    """Give a line in the middle of the last layer a slower feed; which layer that is."""
    given = read_program(folder)
    last = int(given.table["layer"].max())
    here = [k for k in np.flatnonzero(given.table["layer"] == last).tolist() if re.fullmatch(r"N[0-9]+X[-.0-9]+", given.lines[k])]
    index = here[len(here) // 2]
    write_program(replace(given, lines=(*given.lines[:index], given.lines[index] + "F480", *given.lines[index + 1 :])), folder)
    return last


def test_folder_of_a_program_gives_the_same_proof_as_its_plan(
    planned: Path, posted: Path, block: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    said = []
    for given in (planned, posted):
        code = run("prove", str(given), "--mesh", str(block), *GRID, "--json", monkeypatch=monkeypatch)
        said.append((code, capfd.readouterr().out))
    assert said[0] == said[1] and json.loads(said[0][1])["lines"] > 100


def test_program_whose_late_layer_was_edited_goes_on_there_and_is_proven_as_if_from_the_start(
    posted: Path, block: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    words = ("prove", str(posted), "--mesh", str(block), *GRID, "--json")
    keeping = (*words, "--checkpoints", "kept")
    first = run(*keeping, monkeypatch=monkeypatch)
    before = capfd.readouterr()
    assert "resumed" not in before.err and any(Path("kept").iterdir())
    layer = edit_late_layer(posted)
    again = run(*keeping, monkeypatch=monkeypatch)
    resumed = capfd.readouterr()
    fresh = run(*words, monkeypatch=monkeypatch)
    said = capfd.readouterr()
    assert resumed.out == said.out != before.out and again == fresh
    assert first in (0, 1)
    note = re.search(r"^resumed at layer ([0-9]+)", resumed.err, re.MULTILINE)
    assert note is not None and int(note.group(1)) == layer and "resumed" not in said.err


def test_file_of_a_program_that_somebody_changed_by_hand_is_refused_in_one_line(
    posted: Path, block: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    file = max(posted.glob("layer_*.ngc"))
    file.write_bytes(file.read_bytes() + b"N9 G0 Z-100\n")
    assert run("prove", str(posted), "--mesh", str(block), *GRID, monkeypatch=monkeypatch) == 2
    said = capfd.readouterr().err
    assert file.name in said and "Traceback" not in said


def test_milling_is_proven_from_the_stock_that_is_given(
    block: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box(bounds=[[-7.0, -5.0, -1.0], [7.0, 5.0, 1.5]]).export("raw.stl")
    trimesh.creation.box(bounds=[[-3.0, -2.0, -1.0], [3.0, 2.0, 0.5]]).export("scrap.stl")
    options = ("--process", "mill", "--tolerance", "0.2", "--json")
    assert run("plan", str(block), "-o", "m.h5", *options, monkeypatch=monkeypatch) == 0
    capfd.readouterr()
    words = ("prove", "m.h5", "--mesh", str(block), *GRID, "--json")
    assert run(*words, "--stock", "raw.stl", monkeypatch=monkeypatch) == 0
    good = json.loads(capfd.readouterr().out)
    raw_mm3, part_mm3 = 14.0 * 10.0 * 2.5, 12.0 * 8.0 * 2.0
    assert good["passed"] and good["deposited_mm3"] == 0.0 and 0.5 * (raw_mm3 - part_mm3) < good["removed_mm3"] < raw_mm3 - part_mm3 + 20.0
    assert run(*words, "--stock", "scrap.stl", monkeypatch=monkeypatch) == 1
    assert any(reason.startswith("missing metal") for reason in json.loads(capfd.readouterr().out)["reasons"])
