"""`cellctl model`: a part in, a watertight file and its measure out; bad options are one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cellctl import cli
from planner.mesh import load

PIPE = Path(__file__).resolve().parents[3] / "config" / "parts" / "pipe.stl"


def run(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    """The exit code of a command line."""
    monkeypatch.setattr("sys.argv", ["cellctl", *words])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return int(ended.value.code or 0)


def test_a_model_is_written_and_its_deviation_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
):
    out = tmp_path / "pipe.stl"
    assert run(monkeypatch, "model", str(PIPE), "-o", str(out), "--direction", "+x", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["layers"] == 1 and told["deviation"]["max_mm"] < 0.04
    assert load(out).is_closed


@pytest.mark.parametrize(
    "words",
    [("-o", "model.txt"), ("--rule", "wavy"), ("--direction", "auto"), ("--direction", "0,0,0"), ("--cusp", "0")],
)
def test_an_option_that_makes_no_sense_is_one_line_and_exit_2(
    words: tuple[str, str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
):
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, "model", str(PIPE), *words, "--json") == 2
    printed = capsys.readouterr()
    assert printed.out == "" and "Traceback" not in printed.err and len(printed.err.strip().splitlines()) <= 2
    assert not list(tmp_path.iterdir())
