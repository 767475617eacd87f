"""One job's way from its part to a proof: each stage is found made already, or made by a worker, and written down."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cellctl.cell.program_form import form_beside
from cellctl.domain.jobs import JobState
from cellctl.planning import keys
from cellctl.planning.ending import to_its_end
from cellctl.planning.engine import Engine
from cellctl.planning.task import (
    PICTURE_FILE,
    PLAN_FILE,
    PROGRAM_FOLDER,
    PROOF_FILE,
    REPORT_FILE,
    SURFACE_FILE,
    VIEW_FOLDER,
    Link,
    Task,
)
from cellctl.planning.track import track_beside
from cellctl.store import Store, blobs, jobs, lineage, made, parts, versions
from cellctl.store.fleet import Seat
from cellctl.store.jobs import JobRow
from cellctl.store.made import Made
from cellctl.store.parts import PartRow
from config import Cell, ConfigError, load_material
from planner.recipe import parse_recipe

J = JobState
WORKED_ON = (J.PLANNING, J.POSTING, J.PROVING)
Report = Callable[[str, float], None]


class Stopped(Exception):
    """The job is not worked on any more (cancelled meanwhile)."""


@dataclass(frozen=True)
class JobWork:
    """Work on jobs of one cell. cell_file : where the workers read the same cell; seat : of this service at it

    drawings : by job, the folder into which the layers of the plan that is being made are written one by one
    changed : told a job's id when it waits for something else
    """

    store: Store
    workers: Engine
    cell: Cell
    cell_file: Path
    seat: Seat
    drawings: dict[str, Path] = field(default_factory=dict)
    changed: Callable[[str], None] = lambda _job: None

    async def take_through(self, job: JobRow, report: Report) -> None:
        """From submitted to waiting for approval. Raises WorkerError, WrongJobStateError (cancelled meanwhile), WrongCellError."""
        part = await asyncio.to_thread(self._part, job)
        if job.continues_job is not None:
            await self._move(job, J.POSTING, why="")
            posted = await self._resume(job, part, report)
        else:
            await self._move(job, J.PLANNING, why="")
            planned = await self._plan(job, part, report)
            await self._move(
                job, J.PLANNED, J.POSTING, plan_sha256=planned.sha256, layers=int(planned.summary.get("layers", 0))
            )
            posted = await self._post(job, part, planned, report)
        await self._move(
            job,
            J.PROVING,
            program_sha256=posted.sha256,
            cell_sha256=self.cell.sha256,
            lines_total=int(posted.summary.get("lines", 0)),
            duration_s=float(posted.summary.get("duration_s", 0.0)),
            resumption=posted.summary.get("resumption"),
        )
        proved = await self._prove(job, part, posted, report)
        passed = bool(proved.summary.get("passed"))
        why = (
            "a person has to approve it"
            if passed
            else "the proof did not pass: an engineer may override it with a reason"
        )
        await self._move(
            job, J.PROVEN, J.WAITING_FOR_APPROVAL, proof_sha256=proved.sha256, proof=proved.summary, why=why
        )

    def _part(self, job: JobRow) -> PartRow:
        with self.store.read() as connection:
            return parts.get(connection, job.part_id)

    async def _move(self, job: JobRow, *targets: JobState, **changes: Any) -> None:
        def move() -> None:
            with self.store.write() as connection:
                jobs.move(connection, job.id, *targets, at=self.store.clock(), seat=self.seat, **changes)

        await asyncio.to_thread(move)

    def _stock(self, job: JobRow) -> tuple[str, str]:
        """Path and hash of the raw stock's mesh, where the recipe names one by its part id."""
        stock = parse_recipe(job.recipe_toml).stock
        if not stock:
            return "", ""
        with self.store.read() as connection:
            part = parts.get(connection, stock)
        return str(self.store.blobs.mesh(part.inspection.mesh_sha256)), part.inspection.mesh_sha256

    async def _with_stock(self, job: JobRow) -> dict[str, str]:
        """The mesh of the raw stock as a field of a task, if there is one."""
        stock, _ = await asyncio.to_thread(self._stock, job)
        return {"stock": stock} if stock else {}

    async def _run(self, job: JobRow, task: Task, report: Report) -> dict[str, Any]:
        """The engine's summary of a task; what the task waits for stands in the job until it goes on."""
        told = asyncio.Queue[str | None]()
        writing = asyncio.create_task(self._write_waits(job, told))
        try:
            return await self.workers.run(task, report, told.put_nowait)
        finally:
            told.put_nowait(None)
            await to_its_end(writing)

    async def _write_waits(self, job: JobRow, told: asyncio.Queue[str | None]) -> None:
        """Write down why a job waits, in order; at the end nothing of it stays."""
        written = ""

        def write(why: str) -> None:
            with self.store.write() as connection:
                row = jobs.get(connection, job.id)
                if row.state in WORKED_ON and row.cell == self.seat.cell:
                    jobs.change(connection, job.id, why=why)

        while (why := await told.get()) is not None:
            if why != written:
                written = why
                await asyncio.to_thread(write, why)
                self.changed(job.id)
        if written:
            await asyncio.to_thread(write, "")

    async def _make(self, kind: made.Kind, key: str, path_of: Callable[[str], Path], make: Callable[[], Any]) -> Made:
        """What was made for the key and is still there, or what `make` makes now."""

        def find() -> Made | None:
            with self.store.read() as connection:
                found = made.find(connection, kind, key)
            return found if found is not None and path_of(found.sha256).exists() else None

        found = await asyncio.to_thread(find)
        if found is not None:
            return found
        fresh: Made = await make()

        def remember() -> None:
            with self.store.write() as connection:
                made.add(connection, kind, key, fresh, self.store.clock())

        await asyncio.to_thread(remember)
        return fresh

    def _material(self, job: JobRow) -> dict[str, str]:
        """The version of its material that the job is made with: {} where it is the one that comes with the software.

        Raises ConfigError, NotFoundError.
        """
        if not job.material_sha256:
            return {}
        with suppress(ConfigError):
            if load_material(job.material).sha256 == job.material_sha256:
                return {}
        with self.store.read() as connection:
            row = versions.material(connection, job.material, sha256=job.material_sha256)
        return {"material": job.material, "material_toml": row.toml}

    def _pin(self, job: JobRow) -> str:
        """Hash of the job's own version of its material, empty for the shipped one."""
        return job.material_sha256 if self._material(job) else ""

    def _task(self, part: PartRow, folder: Path, kind: Any, **fields: Any) -> Task:
        mesh = self.store.blobs.part(part.sha256, part.suffix)
        return Task(
            kind=kind,
            folder=str(folder),
            parent=0,
            memory_bytes=0,
            part_name=part.name,
            mesh=str(mesh),
            units=part.units,
            cell=str(self.cell_file),
            **fields,
        )

    async def _plan(self, job: JobRow, part: PartRow, report: Report) -> Made:
        stock, stock_sha256 = await asyncio.to_thread(self._stock, job)
        key = keys.plan_key(part.sha256, part.units, part.name, job.recipe_toml, stock_sha256, await asyncio.to_thread(self._pin, job))

        async def make() -> Made:
            with self.store.blobs.staging() as folder:
                task = self._task(part, folder, "plan", recipe_toml=job.recipe_toml, stock=stock, **self._material(job))
                self.drawings[job.id] = folder / VIEW_FOLDER
                try:
                    summary = await self._run(job, task, report)
                    return await asyncio.to_thread(self._keep_plan, folder, summary)
                finally:
                    del self.drawings[job.id]

        return await self._make("plan", key, self.store.blobs.plan, make)

    async def _post(self, job: JobRow, part: PartRow, planned: Made, report: Report) -> Made:
        async def make() -> Made:
            with self.store.blobs.staging() as folder:
                plan = str(self.store.blobs.plan(planned.sha256))
                task = self._task(part, folder, "post", plan=plan, **await self._with_stock(job), **self._material(job))
                summary = await self._run(job, task, report)
                return await asyncio.to_thread(self._keep_program, folder / PROGRAM_FOLDER, summary)

        key = keys.program_key(planned.sha256, self.cell, await asyncio.to_thread(self._pin, job))
        return await self._make("program", key, self.store.blobs.program, make)

    def _before(self, job: JobRow) -> list[JobRow]:
        with self.store.read() as connection:
            return lineage.chain_of(connection, job)[:-1]

    def _links(self, job: JobRow) -> list[Link]:
        """The interrupted programs before this job's, and where each left the part."""
        before = self._before(job)
        points = [one.resume_point or {} for one in (*before, job)][1:]
        return [
            Link(str(self.store.blobs.program(one.program_sha256 or "")), int(point["line"]), float(point["fraction"]))
            for one, point in zip(before, points, strict=True)
        ]

    async def _resume(self, job: JobRow, part: PartRow, report: Report) -> Made:
        """What is left of the program of the job that this one continues."""
        before = (await asyncio.to_thread(self._before, job))[-1]
        program, plan, point = before.program_sha256 or "", before.plan_sha256 or "", job.resume_point or {}

        async def make() -> Made:
            with self.store.blobs.staging() as folder:
                files = {"program": str(self.store.blobs.program(program)), "plan": str(self.store.blobs.plan(plan))}
                task = self._task(part, folder, "resume", point=point, **files, **await self._with_stock(job), **self._material(job))
                summary = await self._run(job, task, report)
                return await asyncio.to_thread(self._keep_program, folder / PROGRAM_FOLDER, summary)

        key = keys.resumption_key(program, plan, self.cell, point, await asyncio.to_thread(self._pin, job))
        return await self._make("program", key, self.store.blobs.program, make)

    async def _prove(self, job: JobRow, part: PartRow, posted: Made, report: Report) -> Made:
        stock, stock_sha256 = await asyncio.to_thread(self._stock, job)
        links = await asyncio.to_thread(self._links, job)

        async def make() -> Made:
            with self.store.blobs.staging() as folder:
                program = str(self.store.blobs.program(posted.sha256))
                checkpoints = str(self.store.blobs.checkpoints)
                files = {"program": program, "stock": stock, "checkpoints": checkpoints}
                task = self._task(part, folder, "prove", links=links, **files, **self._material(job))
                document = await self._run(job, task, report)
                return await asyncio.to_thread(self._keep_proof, folder, document)

        told = [f"{Path(link.program).name} {link.line} {link.fraction!r}" for link in links]
        key = keys.proof_key(posted.sha256, part.sha256, part.units, self.cell, stock_sha256, told, await asyncio.to_thread(self._pin, job))
        return await self._make("proof", key, self.store.blobs.proof, make)

    def _keep_plan(self, folder: Path, summary: dict[str, Any]) -> Made:
        sha256 = blobs.sha256_of(folder / PLAN_FILE)
        blobs.place(folder / VIEW_FOLDER, self.store.blobs.view(sha256))
        blobs.place(folder / PLAN_FILE, self.store.blobs.plan(sha256))
        return Made(sha256, summary)

    def _keep_program(self, source: Path, summary: dict[str, Any]) -> Made:
        """The hash of program.json names the program: it holds the hashes of its other files."""
        sha256 = blobs.sha256_of(source / "program.json")
        blobs.place(form_beside(source), form_beside(self.store.blobs.program(sha256)))
        if track_beside(source).is_dir():
            blobs.place(track_beside(source), track_beside(self.store.blobs.program(sha256)))
        blobs.place(source, self.store.blobs.program(sha256))
        return Made(sha256, summary)

    def _keep_proof(self, folder: Path, document: dict[str, Any]) -> Made:
        sha256 = blobs.sha256_of(folder / PROOF_FILE)
        kept = self.store.blobs
        beside = ((PICTURE_FILE, kept.picture(sha256)), (REPORT_FILE, kept.report(sha256)), (SURFACE_FILE, kept.surface(sha256)))
        for name, target in beside:
            if (folder / name).exists():
                blobs.place(folder / name, target)
        blobs.place(folder / PROOF_FILE, self.store.blobs.proof(sha256))
        return Made(sha256, proof_summary(document))


def proof_summary(document: dict[str, Any]) -> dict[str, Any]:
    """The figures of a proof that a job shows: its scalars, and how many findings of each severity."""
    figures: dict[str, Any] = {
        name: value for name, value in document.items() if isinstance(value, bool | int | float | str)
    }
    for name, value in document.get("deviation", {}).items() if isinstance(document.get("deviation"), dict) else ():
        if isinstance(value, bool | int | float | str):
            figures[name] = value
    counts: dict[str, int] = {}
    for finding in document.get("findings", []):
        severity = str(finding.get("severity", "note")) if isinstance(finding, dict) else "note"
        counts[severity] = counts.get(severity, 0) + 1
    figures["findings"] = counts
    return dict(json.loads(json.dumps(figures)))
