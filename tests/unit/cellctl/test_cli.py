from __future__ import annotations

import json
import resource
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from cellctl import cli
from cellctl.cli.files import direction_of
from cellctl.cli.input import InputFault
from cellctl.first_start import ServeError, check_reach, first_token
from cellctl.supervise import free_port, only_one
from planner.errors import PlannerError


def run(*words: str, monkeypatch: pytest.MonkeyPatch) -> int:
    """Exit code of the command line in this process."""
    monkeypatch.setattr(sys, "argv", ["cellctl", *words])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    return int(caught.value.code or 0)


def says_one_line_and_a_hint(text: str) -> bool:
    """At the end; stages of the work may have been told before."""
    *stages, what, hint = text.splitlines()
    return (
        what.startswith("cellctl: ")
        and hint.startswith("  hint: ")
        and all(len(stage.split()) <= 3 for stage in stages)
    )


def test_help_is_quick_and_loads_nothing_heavy() -> None:
    code = "import sys, cellctl.cli.app; print([m for m in ('numpy', 'fastapi', 'sqlalchemy', 'httpx', 'h5py') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


BAD = {
    "plan: no such file": ["plan", "nowhere.stl"],
    "plan: a folder": ["plan", "."],
    "plan: not a mesh": ["plan", "text.stl"],
    "plan: empty": ["plan", "empty.stl"],
    "plan: units": ["plan", "block.stl", "--units", "furlong"],
    "plan: direction": ["plan", "block.stl", "--direction", "up"],
    "plan: no direction": ["plan", "block.stl", "--direction", "0,0,0"],
    "plan: material": ["plan", "block.stl", "--material", "unobtainium"],
    "plan: tolerance": ["plan", "block.stl", "--tolerance", "-1"],
    "plan: recipe": ["plan", "block.stl", "--recipe", "recipe.toml"],
    "show: not a plan": ["show", "text.stl"],
    "post: cell": ["post", "text.stl", "--cell", "nowhere"],
    "post: cell with unknown keys": ["post", "text.stl", "--cell", "cell.toml"],
    "prove: no program": ["prove", "text.stl", "--mesh", "block.stl"],
    "submit: no service": ["submit", "block.stl"],
    "jobs: no service": ["jobs"],
    "jobs: nobody listens": ["jobs", "--url", "http://127.0.0.1:9"],
    "token: role": ["token", "create", "me", "--role", "boss"],
    "token: no store": ["token", "list", "--store", "nowhere"],
    "serve: cell": ["serve", "--cell", "nowhere"],
}


@pytest.mark.parametrize("words", BAD.values(), ids=BAD.keys())
def test_bad_input_is_one_line_a_hint_and_exit_2(
    words: list[str], block: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("CELLCTL_TOKEN", raising=False)
    (tmp_path / "text.stl").write_text("I am not a mesh")
    (tmp_path / "empty.stl").write_bytes(b"")
    (tmp_path / "recipe.toml").write_text("colour = 'red'")
    (tmp_path / "cell.toml").write_text("schema_version = 1\ncolour = 'red'")
    assert run(*words, monkeypatch=monkeypatch) == 2
    said = capfd.readouterr().err
    assert says_one_line_and_a_hint(said) and "Traceback" not in said


@pytest.mark.timeout(600)  # the first plan after a change compiles the planner's kernels
def test_part_is_planned_shown_and_posted_on_files(
    block: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["plan", str(block), "-o", "p.h5", "--process", "deposit", "--tolerance", "0.5", "--cusp", "0.2", "--json"]
    monkeypatch.setattr(sys, "argv", ["cellctl", *words])
    assert run(*words, monkeypatch=monkeypatch) == 0
    planned = json.loads(capfd.readouterr().out)
    assert planned["layers"] > 0 and planned["size_mm"] == pytest.approx([12.0, 8.0, 2.0])
    assert run("show", "p.h5", "--json", monkeypatch=monkeypatch) == 0
    assert json.loads(capfd.readouterr().out)
    assert run("post", "p.h5", "-o", "program", "--json", monkeypatch=monkeypatch) == 0
    assert json.loads(capfd.readouterr().out)["lines"] > 0
    (tmp_path / "p.h5").write_bytes(flipped((tmp_path / "p.h5").read_bytes()))
    assert run("post", "p.h5", monkeypatch=monkeypatch) == 2


def flipped(data: bytes) -> bytes:
    """With one bit changed in the middle."""
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


@pytest.mark.parametrize(
    ("text", "direction"),
    [("+x", (1, 0, 0)), ("-z", (0, 0, -1)), ("y", (0, 1, 0)), ("1,0,1", (1, 0, 1)), ("auto", "auto")],
)
def test_direction_is_read(text: str, direction: object) -> None:
    assert direction_of(text) == direction


@pytest.mark.parametrize("text", ["", "w", "1,2", "1,2,3,4", "a,b,c"])
def test_what_is_no_direction_is_refused(text: str) -> None:
    with pytest.raises(InputFault):
        direction_of(text)


def test_first_start_makes_one_operator_token_that_only_this_user_can_read(empty_store: Path, tmp_path: Path) -> None:
    import shutil

    shutil.copytree(empty_store, tmp_path / "store")
    secret = first_token(tmp_path / "store")
    kept = tmp_path / "store" / "operator.token"
    assert secret and kept.read_text().strip() == secret and kept.stat().st_mode & 0o777 == 0o600
    assert first_token(tmp_path / "store") is None


def test_no_host_beyond_loopback_without_an_admin(
    empty_store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import shutil

    folder = tmp_path / "store"
    shutil.copytree(empty_store, folder)
    check_reach(folder, "127.0.0.1")
    for host in ("0.0.0.0", "192.0.2.1", "::", "cell.example"):
        with pytest.raises(ServeError, match="no admin"):
            check_reach(folder, host)
    assert run("token", "create", "boss", "--role", "admin", "--store", str(folder), monkeypatch=monkeypatch) == 0
    check_reach(folder, "0.0.0.0")


def test_port_in_use_and_second_service_are_refused(tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(ServeError, match="cannot listen"):
            free_port("127.0.0.1", other.getsockname()[1])
    with only_one(tmp_path), pytest.raises(ServeError, match="another service"), only_one(tmp_path):
        pass


def test_fault_of_ours_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    from cellctl import faults

    assert faults.explain(ZeroDivisionError("x")) is None
    fault = faults.explain(PlannerError("two\nlines", "hint"))
    assert fault is not None and fault.detail == "two lines" and fault.exit_code == 2


def test_command_line_answers_help() -> None:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "cellctl", "--help"], capture_output=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    work_s = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    assert work_s < 3.0  # of the processor, whatever else it does; 0.3 s on an idle machine


def test_selftest_is_written_with_the_readings_to_expect_and_judges_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("post", "--selftest", "-o", "st", "--json", monkeypatch=monkeypatch) == 0
    told = json.loads(capsys.readouterr().out)
    program = (tmp_path / "st" / "selftest.ngc").read_text(encoding="ascii")
    assert program.count("G38.3") == len(told["touches"]) and program.count("M0") == 1
    answers = [f"[PRB:{','.join(f'{value:.3f}' for value in touch['reading'])}:1]" for touch in told["touches"]]
    (tmp_path / "said.txt").write_text("ok\n".join(answers), encoding="ascii")
    assert run("post", "--selftest", "--readings", "said.txt", monkeypatch=monkeypatch) == 0
    assert "describes this machine" in capsys.readouterr().out
    lifted = [float(value) for value in told["touches"][0]["reading"]]
    lifted[2] += 0.5
    answers[0] = f"[PRB:{','.join(f'{value:.3f}' for value in lifted)}:1]"
    (tmp_path / "said.txt").write_text("\n".join(answers), encoding="ascii")
    assert run("post", "--selftest", "--readings", "said.txt", monkeypatch=monkeypatch) == 1
    assert "does not describe this machine" in capsys.readouterr().out
    assert run("post", monkeypatch=monkeypatch) == 2
