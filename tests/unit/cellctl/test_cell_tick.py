"""The beat: evenly spaced, missed beats counted."""

from __future__ import annotations

import asyncio
import time

import pytest

from cellctl.cell.tick import Beat, Ticker


def test_spacing_and_missed_beats_are_counted() -> None:
    beat = Beat(0.01)
    at = 0.0
    for k in range(200):
        at += 0.01 if k % 50 else 0.013
        beat.struck(at, 1 if k % 50 else 2)
    assert beat.count == 200
    assert beat.missed == 4
    assert beat.jitter_p99_ms == pytest.approx(3.0, abs=0.1)


async def test_a_ticker_beats_at_its_period_and_ends_when_closed() -> None:
    times: list[float] = []
    beat = Beat(0.005)
    started = time.monotonic()
    ticker = Ticker(beat, time.monotonic, lambda: times.append(time.monotonic()))
    async with asyncio.timeout(60):
        while beat.count + beat.missed < 50:
            await asyncio.sleep(0.005)
    ticker.close()
    ticker.close()
    count = len(times)
    assert beat.count == count
    assert count + beat.missed == pytest.approx((times[-1] - started) / 0.005, abs=8)
    await asyncio.sleep(0.03)
    assert len(times) == count
