"""The cell process at the cell that the bench file names: it comes up, sees every level, and runs a dry program with hold and resume."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.hardware.joined import DRY_MOVES, AtBench, BenchProcess, dry_program, process_at

pytestmark = pytest.mark.hardware_ok
ATTEMPTS = 4
UP = {"IDLE", "UNHOMED", "FAULT"}


async def up(process: BenchProcess) -> None:
    """All wires are there and every signal was read."""
    await process.until(lambda: process.state in UP and process.snapshot.cnc.connected)
    await process.until(lambda: all(view.connected for view in (process.snapshot.laser, process.snapshot.feeder, process.snapshot.io)))


async def held_in_the_midst(process: BenchProcess) -> None:
    """Start the dry program and hold it. A simulated cell in this loop may come too late on a loaded machine: reset, and once more."""
    for attempt in range(1 if process.at.facts.is_real else ATTEMPTS):
        reply = await process.command("start", job=f"dry-{attempt}", name="dry", program="dry")
        assert reply.ok, reply.error
        await process.until(lambda: process.snapshot.lines.executed >= DRY_MOVES // 4 or process.state == "FAULT")
        if (await process.command("hold")).ok:
            await process.until(lambda: process.state in ("HELD", "FAULT"))
        if process.state == "HELD":
            return
        assert not process.at.facts.is_real, process.controller.because
        await process.until(lambda: process.controller.run is None and not process.controller.quiesce_pending)
        assert (await process.command("reset")).ok
        await process.until(lambda: process.state == "IDLE")
    raise AssertionError(f"{ATTEMPTS} faults: {process.controller.because}")


async def test_cell_comes_up_and_tells_every_level_with_its_age(bench_cell: AtBench, tmp_path: Path) -> None:
    async with process_at(bench_cell, tmp_path / "store.db") as process:
        await up(process)
        await process.until(lambda: all(p.age_s < p.stale_s for p in process.snapshot.permissives if p.stale_s > 0.0))
        seen = process.snapshot
        assert seen.permissives and any(not permissive.ok for permissive in seen.permissives)  # nothing runs: no leave to emit
        assert not seen.laser.permitted and not seen.laser.enabled and seen.laser.power_setpoint_w == 0.0
        assert set(seen.cnc.machine) == set(bench_cell.cell.letters)
        reply = await process.command("stop")
        assert reply.ok and process.state == "STOPPED"


async def test_dry_program_is_held_stands_still_goes_on_and_ends_with_its_last_line(bench_cell: AtBench, tmp_path: Path) -> None:
    if not bench_cell.facts.may_move:
        pytest.skip("the bench file does not permit to move")
    async with process_at(bench_cell, tmp_path / "store.db") as process:
        await up(process)
        if process.state != "IDLE":
            pytest.skip(f"the cell is {process.state}, {process.controller.because}: home it, clear its faults first")
        status = process.controller.drivers.cnc.status if process.controller.drivers is not None else None
        assert status is not None
        began = dict(status.machine)
        joints = np.array([began[letter] for letter in bench_cell.cell.letters])
        process.programs["dry"] = program = dry_program(bench_cell.facts, bench_cell.cell, joints)
        await held_in_the_midst(process)
        held = process.snapshot
        await process.until(lambda: process.snapshot.cnc.machine == held.cnc.machine and process.snapshot.cnc.age_s < held.cnc.age_s + 1.0)
        assert held.lines.executed < len(program.lines)
        assert (await process.command("resume")).ok
        await process.until(lambda: process.state == "IDLE")
        ended = process.controller.ended
        assert ended is not None and (ended.view.outcome, ended.lines.executed) == ("completed", len(program.lines))
        assert {k: round(v, 3) for k, v in process.snapshot.cnc.machine.items()} == {k: round(v, 3) for k, v in began.items()}
