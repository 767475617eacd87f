"""Set-up: what is refused, what is built again, and what is left alone."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
from pathlib import Path

import pytest

from cellctl.console.build import ConsoleBuildError, build, digest_of, is_current

ROOT = Path(__file__).resolve().parents[2]
SHELL_TOOLS = ("bash", "dirname", "cat", "sha256sum", "cut", "sed", "flock")
NPM = """#!/bin/bash
echo "$1" >> "$NPM_CALLS"
if [ "$1" = run ]; then mkdir -p ../dist && echo "<html></html>" > ../dist/index.html; fi
exit "${NPM_EXIT:-0}"
"""


def executable(path: Path, text: str) -> None:
    path.write_text(text)
    path.chmod(path.stat().st_mode | stat.S_IXUSR)


@pytest.fixture
def web(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of page sources, and a node and npm of our own that record what they are asked."""
    tools = tmp_path / "tools"
    tools.mkdir()
    executable(tools / "node", "#!/bin/bash\necho v22.1.0\n")
    executable(tools / "npm", NPM)
    monkeypatch.setenv("PATH", f"{tools}{os.pathsep}/usr/bin{os.pathsep}/bin")
    monkeypatch.setenv("NPM_CALLS", str(tmp_path / "calls"))
    sources = tmp_path / "web"
    sources.mkdir()
    (sources / "package.json").write_text("{}")
    (sources / "main.ts").write_text("start()")
    return sources


def calls(web: Path) -> list[str]:
    """What npm was asked so far."""
    record = web.parent / "calls"
    return record.read_text().split() if record.exists() else []


def test_page_is_built_once_for_one_state_of_its_sources(web: Path) -> None:
    dist = web.parent / "dist"
    assert build(web, dist) == "console: built"
    assert build(web, dist) == "console: up to date"
    assert calls(web) == ["ci", "run"]


def test_changed_source_is_built_again(web: Path) -> None:
    dist = web.parent / "dist"
    build(web, dist)
    (web / "main.ts").write_text("start(again)")
    assert not is_current(web, dist)
    assert build(web, dist) == "console: built"


def test_installed_modules_are_no_sources(web: Path) -> None:
    before = digest_of(web)
    (web / "node_modules").mkdir()
    (web / "node_modules" / "left.js").write_text("")
    assert digest_of(web) == before


def test_failed_build_is_reported_with_the_command_and_not_trusted_afterwards(
    web: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dist = web.parent / "dist"
    build(web, dist)
    (web / "main.ts").write_text("broken(")
    monkeypatch.setenv("NPM_EXIT", "1")
    with pytest.raises(ConsoleBuildError, match="npm ci"):
        build(web, dist)
    assert not is_current(web, dist)


def test_console_without_sources_is_no_error(tmp_path: Path) -> None:
    assert "nothing to build" in build(tmp_path / "web", tmp_path / "dist")


def run_setup(folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """The set-up script of a copy that has no environment yet, with no more programs than it needs itself."""
    tools = folder / "bin"
    tools.mkdir()
    for name in SHELL_TOOLS:
        found = shutil.which(name, path="/usr/bin:/bin")
        if found:
            (tools / name).symlink_to(found)
    (folder / ".setup").mkdir()
    for name in ("setup.sh", "requirements.txt"):
        shutil.copy(ROOT / ".setup" / name, folder / ".setup" / name)
    command = [str(tools / "bash"), str(folder / ".setup" / "setup.sh")]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, env={"PATH": str(tools), **environment}, timeout=20
    )


def test_machine_without_a_new_enough_python_is_told_so_in_one_line(tmp_path: Path) -> None:
    done = run_setup(tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.count("\n") == 1
    assert "no Python 3.11 or newer found" in done.stderr


def test_interpreter_named_by_the_user_that_is_none_is_refused_in_one_line(tmp_path: Path) -> None:
    done = run_setup(tmp_path, PYTHON="/bin/false")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "setup: PYTHON=/bin/false is not a Python 3.11 or newer; name another one\n"
    assert not (tmp_path / ".venv").exists()


def test_shim_that_exists_but_fails_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / "shims").mkdir()
    executable(tmp_path / "shims" / "python3", "#!/bin/false\n")
    done = run_setup(tmp_path, PATH=f"{tmp_path / 'shims'}:{tmp_path / 'bin'}")
    assert "no Python 3.11 or newer found" in done.stderr
