"""`cellctl prove` on files: verdict by exit code, figures as JSON, report and picture as files, words for a person."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
import trimesh

from cellctl import cli

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
