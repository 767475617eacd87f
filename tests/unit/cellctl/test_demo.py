"""The demo as its own operator: a job that stays queued ends it with the reason that the service tells."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import cellctl.demo as demo
from cellctl.demo import Demo, DemoError

WHY = "tried again by itself: start is not possible while the cell is OFFLINE"


class Service:
    """A service whose job starts by itself after some looks; with none it never does."""

    def __init__(self, looks: int) -> None:
        self.looks = looks

    def job(self, _: str) -> dict[str, Any]:
        self.looks -= 1
        state = "completed" if self.looks == 0 else "queued"
        return {"id": "job-1", "state": state, "why": WHY, "name": "pipe", "progress": 0.0}


def follower(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Demo:
    made = Demo("trunnion_tcp", 25.0, folder, keep=False, as_json=True)
    monkeypatch.setattr(made._display, "show", lambda *_: None)
    monkeypatch.setattr(demo, "POLL_S", 0.0)
    return made


def test_a_start_that_the_service_tries_again_needs_nothing_of_the_demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    job = follower(tmp_path, monkeypatch)._until(Service(looks=5), "job-1", ("completed",))  # type: ignore[arg-type]
    assert job["state"] == "completed"


def test_a_cell_that_is_never_ready_ends_the_demo_with_its_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "STUCK_S", 0.2)
    with pytest.raises(DemoError, match="OFFLINE"):
        follower(tmp_path, monkeypatch)._until(Service(looks=0), "job-1", ("completed",))  # type: ignore[arg-type]
