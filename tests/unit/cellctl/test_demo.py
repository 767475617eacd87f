"""The demo as its own operator: a start that the cell refused for a moment is confirmed once more, and not for ever."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import cellctl.demo as demo
from cellctl.demo import Demo, DemoError

REFUSED = "the cell refused to start it: start is not possible while the cell is OFFLINE"


class Service:
    """A service that refuses the first starts; the cell is OFFLINE for one look after each, then IDLE."""

    def __init__(self, refusals: int) -> None:
        self.refusals, self.looks, self.confirmed = refusals, 0, 0
        self.state, self.why = "queued", REFUSED

    def job(self, _: str) -> dict[str, Any]:
        return {"id": "job-1", "state": self.state, "why": self.why, "name": "pipe", "progress": 0.0}

    def snapshot(self) -> dict[str, Any]:
        self.looks += 1
        return {"state": "IDLE" if self.looks > 1 else "OFFLINE", "alarms": []}

    def approve(self, _: str, **said: Any) -> None:
        assert said["table_clear"] and said["because"]
        self.confirmed, self.looks = self.confirmed + 1, 0
        if self.confirmed >= self.refusals:
            self.state, self.why = "completed", ""


def follower(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Demo:
    made = Demo("trunnion_tcp", 25.0, folder, keep=False, as_json=True)
    monkeypatch.setattr(made._display, "show", lambda *_: None)
    monkeypatch.setattr(demo, "POLL_S", 0.0)
    return made


def test_a_start_refused_while_a_wire_was_gone_is_confirmed_again_once_the_cell_is_idle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = Service(refusals=1)
    job = follower(tmp_path, monkeypatch)._until(service, "job-1", ("completed",))  # type: ignore[arg-type]
    assert job["state"] == "completed" and service.confirmed == 1


def test_a_cell_that_refuses_for_ever_ends_the_demo_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    service = Service(refusals=1000)
    monkeypatch.setattr(demo, "STUCK_S", 0.2)
    with pytest.raises(DemoError, match="OFFLINE"):
        follower(tmp_path, monkeypatch)._until(service, "job-1", ("completed",))  # type: ignore[arg-type]
    assert service.confirmed == demo.RECOVERIES
