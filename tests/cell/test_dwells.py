"""Waits of the Program, at the plant: as long as they were programmed, dark, whoever has the gate and whether the control tells lines or not."""

from __future__ import annotations

from pathlib import Path

import pytest

from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest, shipped_cell
from tests.cell.jobs import FEED_MM_S, one_wall

DWELL_S = 2.0
PACE = 3.0
LENGTH_MM = 12.0
EDGES_S = 0.3  # what light may be on longer or shorter, at that pace
LINE_NUMBERS = 4  # grbl 1.1, $10: the bit of Ln:


def tell_no_lines(cell: CellUnderTest) -> None:
    """From now on the control's reports are without Ln:, as of one that cannot tell it."""
    settings = cell.sim.cnc.settings
    settings[10] = int(settings[10]) & ~LINE_NUMBERS


async def lit_times(cell: CellUnderTest) -> list[tuple[float, float]]:
    """Begin and end of each stretch of light until the job is over, s of the plant."""
    found: list[tuple[float, float]] = []
    is_lit = False
    while not cell.outcome:
        await cell.forward(ticks=1)
        now, was_lit, is_lit = cell.sim.time_s, is_lit, cell.sim.laser.is_emitting
        if is_lit and not was_lit:
            found.append((now, now))
        elif is_lit:
            found[-1] = (found[-1][0], now)
        assert cell.state is not State.FAULT, cell.latched
    return found


@pytest.mark.parametrize(("name", "tells_lines"), [("trunnion_rtu", True), ("trunnion_rtu", False), ("trunnion_tcp", False)])
async def test_wait_between_layers_is_kept_dark_and_the_next_bead_is_lit(folder: Path, name: str, tells_lines: bool) -> None:
    async with CellUnderTest(folder / "store.db", cell=shipped_cell(name)) as cell:
        if not tells_lines:
            tell_no_lines(cell)
        program = one_wall(cell.facts, layers=2, length_mm=LENGTH_MM, pieces=3, dwell_s=DWELL_S, mill=False)
        reply = await cell.start(program)
        assert reply.ok, reply.error
        cell.set_pace(PACE)
        first, second = await lit_times(cell)
        assert cell.outcome == "completed" and cell.max_standstill_emission_w == 0.0
    assert cell.snapshot.job is not None and (cell.snapshot.job.followed_by == "Ln") == tells_lines
    assert second[0] - first[1] > DWELL_S
    assert [end - begin for begin, end in (first, second)] == pytest.approx([LENGTH_MM / FEED_MM_S] * 2, abs=EDGES_S)
