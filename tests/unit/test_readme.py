"""README may be believed: every path and every command that it names exists."""

from __future__ import annotations

import pkgutil
import re
import shlex
import subprocess
import sys
from functools import cache
from itertools import takewhile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
TOP_LEVEL = ("cellctl", "planner", "drivers", "sim", "tests", "config", ".setup", ".ci")
ALIAS = re.compile(r"^[\w.@/*{}<>-]+$")  # what a path may be written with
TEMPLATE = re.compile(r"[<>{}]|\.\.\.|…")  # stands for a path of the reader's own

pytestmark = pytest.mark.skipif(not README.exists(), reason="README.md is not written yet")


def readme() -> str:
    return README.read_text(encoding="utf-8")


def code_lines() -> list[str]:
    """Each code span and each line of a code block, comments cut off."""
    text = readme()
    blocks = re.findall(r"^```[^\n]*\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)
    spans = re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE))
    lines = [line.split(" #")[0].strip().removeprefix("$ ") for block in blocks for line in block.splitlines()]
    return [line for line in lines + spans if line]


def linked_paths() -> list[str]:
    """Targets of links and pictures that lie in the repository."""
    targets = re.findall(r"\]\(([^)\s]+)[^)]*\)|src=\"([^\"]+)\"", readme())
    paths = (first or second for first, second in targets)
    return sorted({path.split("#")[0] for path in paths if not re.match(r"^(#|[a-z]+:)", path)})


def named_paths() -> list[str]:
    """Words of code that begin with one of our top-level names and a slash."""
    words = {word.strip(",;:()") for line in code_lines() for word in line.split()}
    ours = (word for word in words if "/" in word and word.split("/")[0] in TOP_LEVEL)
    return sorted(word for word in ours if ALIAS.match(word) and not TEMPLATE.search(word))


def make_targets() -> set[str]:
    return set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE))


def commands_of(program: str) -> list[list[str]]:
    """The words after `program`, for each place where README calls it."""
    calls = []
    for line in code_lines():
        for part in re.split(r"&&|\s\|\s|;", line):
            words = [word for word in part.split() if "=" not in word or word.startswith("-")]
            if words and Path(words[0]).name == program:
                calls.append(words[1:])
    return calls


@cache
def help_of(command: str) -> subprocess.CompletedProcess[str]:
    cellctl = Path(sys.executable).parent / "cellctl"
    words = [str(cellctl), *shlex.split(command), "--help"]
    environment = {"PATH": "/usr/bin:/bin", "COLUMNS": "200", "TERM": "dumb", "NO_COLOR": "1"}
    return subprocess.run(words, capture_output=True, text=True, check=False, env=environment)


def test_every_link_leads_to_a_file_of_the_repository() -> None:
    missing = [path for path in linked_paths() if not (ROOT / path).exists()]
    assert not missing, f"README.md links to {missing}"


def test_every_path_named_in_code_exists() -> None:
    missing = [path for path in named_paths() if not any(ROOT.glob(path.rstrip("/")))]
    assert not missing, f"README.md names {missing}"


def test_every_make_command_is_a_target() -> None:
    named = {word for words in commands_of("make") for word in words if re.fullmatch(r"[a-z]+", word)}
    assert {"demo", "test"} <= named
    assert named <= make_targets(), f"the Makefile has no {sorted(named - make_targets())}"


def test_every_cellctl_command_and_option_is_known_to_the_command_line() -> None:
    unknown = []
    for words in commands_of("cellctl"):
        plain = list(takewhile(re.compile(r"[a-z][a-z|-]*").fullmatch, words))
        options = [word.split("=")[0].strip("[],)") for word in words if word.lstrip("[").startswith("--")]
        for command in plain[0].split("|") if plain else []:
            shown = help_of(" ".join([command, *plain[1:]]))
            if shown.returncode != 0:
                unknown.append(f"cellctl {' '.join([command, *plain[1:]])}")
            unknown += [f"cellctl {command} {option}" for option in options if option not in shown.stdout]
    assert not unknown, f"README.md names {unknown}"


def test_every_function_named_in_full_exists() -> None:
    names = {line for line in code_lines() if re.fullmatch(r"(planner|cellctl|drivers|sim)(\.\w+){2,}", line)}
    missing = []
    for name in sorted(names):
        try:
            pkgutil.resolve_name(name)
        except (ImportError, AttributeError):
            missing.append(name)
    assert names, "README.md follows a layer and a line function by function"
    assert not missing, f"README.md names {missing}"
