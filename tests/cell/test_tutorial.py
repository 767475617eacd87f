"""The tutorial does what it says: its commands in order, in an empty folder, and what it promises among what they print."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from cellctl.cli.tutorial import TEXT, tutorial_text

ROOT = Path(__file__).parents[2]
STEP = re.compile(r"(?ms)^```(?P<info>[^\n]*)\n(?P<body>.*?)^```$|^<!-- stop (?P<stop>\w+) -->$")
START_S, END_S = 60.0, 30.0
COMMAND_S = 170.0
GATE = re.compile(r"\bM0*(62|64|67|68)\b")
LIGHT = re.compile(r"\bM0*(3|4|62|64|67|68)\b")


@dataclass
class Step:
    info: str
    body: str
    stop: str
    promised: list[str] = field(default_factory=list)


def steps() -> list[Step]:
    """What is to be executed, each with the lines that are promised of it."""
    found: list[Step] = []
    for match in STEP.finditer(TEXT.read_text(encoding="utf-8")):
        info, body = match["info"] or "", match["body"] or ""
        if info == "text":
            found[-1].promised += body.splitlines()
        elif match["stop"] or info.startswith("sh"):
            found.append(Step(info, body, match["stop"] or ""))
    return found


class Shell:
    """A folder in which the tutorial's commands run; what runs on is ended at the end."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        programs = folder.parent / f"{folder.name}-bin"
        programs.mkdir()
        for name, words in (("cellctl", "-m cellctl"), ("python", "")):
            (programs / name).write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {words} "$@"\n')
            (programs / name).chmod(0o755)
        self.env = {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT), "COLUMNS": "200", "PYTHONUNBUFFERED": "1"}
        self.env.pop("CELLCTL_TOKEN", None)
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def execute(self, step: Step) -> str:
        """What the step printed. Raises AssertionError when it ends otherwise than the tutorial says."""
        if step.stop:
            self.stop(step.stop)
            return ""
        words = shlex.split(step.info)
        if "background" in words:
            return self._start(words[2], step.body, words[-1])
        done = subprocess.run(
            ["bash", "-e", "-c", step.body], cwd=self.folder, env=self.env, stdin=subprocess.DEVNULL, timeout=COMMAND_S,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
        )  # fmt: skip
        assert (done.returncode != 0) == ("fails" in words), f"{step.body}\n{done.stdout}"
        return done.stdout

    def _start(self, name: str, body: str, until: str) -> str:
        log = self.folder.parent / f"{self.folder.name}-{name}.log"
        with log.open("wb") as file:
            self._running[name] = subprocess.Popen(
                ["bash", "-c", f"exec {body}"], cwd=self.folder, env=self.env, stdin=subprocess.DEVNULL, stdout=file, stderr=file
            )
        end = time.monotonic() + START_S
        while until not in (text := log.read_text(errors="replace")):
            assert self._running[name].poll() is None and time.monotonic() < end, text
            time.sleep(0.05)
        return text

    def stop(self, name: str) -> None:
        child = self._running.pop(name)
        child.send_signal(signal.SIGINT)
        child.wait(END_S)

    def close(self) -> None:
        for name in list(self._running)[::-1]:
            self.stop(name)


@pytest.fixture
def shell() -> Iterator[Shell]:
    with tempfile.TemporaryDirectory(prefix="first-") as name:  # short: the names of sockets have to fit
        folder = Path(name) / "t"
        folder.mkdir()
        opened = Shell(folder)
        try:
            yield opened
        finally:
            opened.close()


def squeezed(text: str) -> str:
    return " ".join(text.split())


def follow(shell: Shell, some: list[Step]) -> None:
    for step in some:
        said = squeezed(shell.execute(step))
        for line in step.promised:
            assert squeezed(line) in said, f"{step.body}promises {line!r}; it printed: {said[-3000:]}"


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_every_command_of_the_tutorial_in_order_brings_what_it_promises(shell: Shell) -> None:
    follow(shell, steps())
    folder = shell.folder
    assert "passed" in (folder / "proof.html").read_text() and (folder / "record.json").stat().st_size > 1000
    assert "your name" in (folder / "doctor.html").read_text()
    assert not LIGHT.search((folder / "selftest" / "selftest.ngc").read_text())
    air = [path.read_text() for path in (folder / "air").glob("*.ngc")]
    assert air and not any(GATE.search(text) for text in air)


@pytest.mark.timeout(120)
def test_the_tutorials_doctor_finds_no_fault_at_the_simulated_cell(shell: Shell) -> None:
    wanted = [step for step in steps() if "sim --run" in step.body or ("my_cell.toml" in step.body and "--cell run" not in step.body)]
    follow(shell, [step for step in wanted if " plan " not in step.body and "--may-move" not in step.body and "--by" not in step.body])
    assert not LIGHT.search((shell.folder / "selftest" / "selftest.ngc").read_text())


def test_the_tutorial_is_shown_without_the_marks_of_its_test() -> None:
    text = tutorial_text()
    assert "<!--" not in text and "background" not in text and "```sh\ncellctl sim" in text
    assert {"setup", "submit", "doctor", "selftest"} <= set(re.findall(r"\w+", text))
