"""The application driven by rules: its clock, planner and cell go on only when a rule says so, and a model goes along."""

from __future__ import annotations

import shutil
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import requests
from hypothesis.stateful import RuleBasedStateMachine

from cellctl.api.context import Service
from cellctl.cell.program_form import form_beside
from tests.unit.cellctl.asked_in_process import URL, InProcess, in_process
from tests.unit.cellctl.interrupted import Posted
from tests.unit.cellctl.job_model import Job, Shop

PROGRAM = "a" * 64
LOOKS_MAX = 20
BEGIN = 1_750_000_000.0


class Clock:
    """A clock that goes when it is told."""

    def __init__(self) -> None:
        self.now = BEGIN

    def __call__(self) -> float:
        return self.now


async def never() -> None:
    """In place of what works by itself: here all of it happens when a rule says so."""


class Driven(RuleBasedStateMachine):
    """A service, the model beside it, and what is asked of both. Rules are a subclass's."""

    folder: Path
    empty: Path
    wall: Posted
    count = 0

    def __init__(self) -> None:
        super().__init__()
        Driven.count += 1
        here = self.folder / f"life{Driven.count}"
        here.mkdir()
        self.clock, self.shop, self.work = Clock(), Shop(), {}
        self._open = ExitStack()
        self.served: InProcess = self._open.enter_context(in_process(here, self.empty, prepare=self._still))
        blobs = self.served.service.store.blobs
        shutil.copytree(self.wall.program, blobs.program(PROGRAM))
        shutil.copytree(form_beside(self.wall.program), form_beside(blobs.program(PROGRAM)))
        assert self.served.far is not None
        self.far = self.served.far
        self.far.unix = self.clock
        self.shop.add(Job(self.served.job_id, 0))
        self.shop.lanes["planning"] = [self.served.job_id]
        self.work: dict[str, list[tuple[str, ...]]]
        self.outcome: dict[str, str] = {}
        self.seen: dict[str, dict[str, int]] = {}
        self.lay: str | None = None

    def _still(self, service: Service) -> None:
        object.__setattr__(service.store, "clock", self.clock)
        for one in (service.queue, service.runs):
            one.run = never  # type: ignore[method-assign]

    def teardown(self) -> None:
        """At the end every step of every life was written down, and all notes are there."""
        try:
            for job in self.shop.jobs.values():
                told = self.ask("GET", f"/jobs/{job.id}/life")[1]["items"]
                assert [step["state"] for step in told] == job.life and all(step["why"] for step in told)
                assert [note["text"] for note in self.ask("GET", f"/jobs/{job.id}/notes")[1]["items"]] == job.notes
        finally:
            self._open.close()
            shutil.rmtree(self.folder / f"life{Driven.count}")

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, Any]:
        """(status, document)."""
        sent = {"Authorization": f"Bearer {self.served.token}", **headers}
        answer = self.served.ask(requests.Request(method, f"{URL}/api/v1{path}", json=body, headers=sent).prepare())
        assert answer.status_code < 500, answer.text
        return answer.status_code, answer.json() if answer.content else None

    def post(self, path: str, ok: bool, body: Any = None) -> Any:
        """The answer to what the model allows; of what it forbids only that it was refused in one line."""
        status, document = self.ask("POST", path, body or {})
        assert (status < 300) == ok, f"{path} {body}: {status} {document}"
        assert ok or (status in (403, 409, 422) and "\n" not in document["detail"] and document["hint"]), document
        return document

    def job(self, pick: int) -> Job:
        """One of the jobs."""
        return list(self.shop.jobs.values())[pick % len(self.shop.jobs)]

    def settle(self) -> None:
        """The service looks at the cell and at the queue, until nothing changes any more; a second passes."""
        runner, service = self.served.runner, self.served.service

        async def look() -> None:
            await self.far.show(lambda seq: service.link.snapshot is not None and service.link.snapshot.seq >= seq)
            await service.runs.follow()
            await service.runs._start_next()

        is_vouched_for = any(job.confirmed_at is not None for job in self.shop.jobs.values())
        self.shop.settle(self.clock.now)
        runner.run(look())
        for _ in range(LOOKS_MAX):  # a machine that is busy for a second makes the cell's word too old to act on
            if [one for one, *_ in self.far.started] == self.shop.started:
                break
            runner.run(look())
        if is_vouched_for:
            runner.run(look())  # what was to start has: nothing more may
        self.clock.now += 1.0

    def made(self, document: dict[str, Any], **fields: Any) -> None:
        """A new job stands behind all others of its priority."""
        self.shop.add(Job(document["id"], len(self.shop.jobs), **fields))
        self.settle()
