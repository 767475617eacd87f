"""How long the tip would stand in its own light if the cell process died: what the control still holds, against the laser's dead-man."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellctl.cell.opened_program import MappedLines
from cellctl.domain.timeline import Timeline
from drivers.cnc.events import Identity
from drivers.modbus.device import DeviceClient
from planner.program import LineKind, Program

STANDING = (LineKind.DWELL, LineKind.TOOL)  # lines that take time and move nothing
QUICK_LINES = 20_000  # looked through in a millisecond or two; more of them are, beside the tick
LEAST_S = 0.01  # a laser's ramp and a step of the control; shorter is no standstill


@dataclass(frozen=True)
class LeftInLight:
    """The worst place of a Program for the cell process to die at.

    seconds : light at standstill there; line : number of the line, from 1; held_s : motion that the control then still holds
    lines : how many lines are such places, of `emitting` lines
    """

    seconds: float
    line: int
    held_s: float
    lines: int
    emitting: int

    def text(self, dead_man_s: float) -> str:
        """One line for the operator, with what bounds it."""
        return (
            f"if the cell process died the tip could stand in its light for up to {self.seconds:.2f} s: the control holds {self.held_s:.2f} s of "
            f"motion behind line {self.line}, the laser's dead-man is {dead_man_s:g} s ({self.lines} of {self.emitting} lines that emit)"
        )


def left_in_light(
    timeline: Timeline, kinds: NDArray[Any], sizes: NDArray[np.int64], barriers: NDArray[np.int64],
    identity: Identity, dead_man_s: float, *, is_stream_gated: bool,
) -> LeftInLight | None:  # fmt: skip
    """The worst place, None where the light is out before the tip stands, whenever the process dies.

    kinds : (n,) LineKind; sizes : (n,) bytes of each line with its newline; barriers : indices of lines at which the stream waits
    A control is taken to hold its planner's blocks from the line that executes on, and behind them what fits into its receive buffer.
    A gate in the stream shuts by itself at the first dark line that is held; a gate over Modbus stays open until the dead-man.
    """
    emitting = np.flatnonzero(timeline.is_emitting)
    if not len(emitting):
        return None
    count = len(timeline.time_end_s)
    filled = np.concatenate([[0], np.cumsum(sizes)])
    planned = np.minimum(emitting + identity.planner_blocks, count)
    held = np.searchsorted(filled, filled[planned] + identity.window_bytes, side="right") - 2  # last line that is held
    stops = np.unique(np.concatenate([barriers, np.flatnonzero(np.isin(kinds, STANDING)), [count]]))
    last = np.minimum(held, stops[np.searchsorted(stops, emitting, side="right")] - 1)
    held_s = np.asarray(timeline.time_end_s)[last] - np.asarray(timeline.time_end_s)[emitting]
    standing_s = np.maximum(dead_man_s - held_s, 0.0)
    if is_stream_gated:
        dark = np.append(np.flatnonzero(~timeline.is_emitting), count)
        standing_s[dark[np.searchsorted(dark, emitting)] <= last] = 0.0
    worst = int(np.argmax(standing_s))
    if standing_s[worst] <= LEAST_S:
        return None
    found = int(np.count_nonzero(standing_s > LEAST_S))
    return LeftInLight(float(standing_s[worst]), int(emitting[worst]) + 1, float(held_s[worst]), found, len(emitting))


def sizes_of(lines: Sequence[str]) -> NDArray[np.int64]:
    """(n,) bytes of each line on the wire, its newline included."""
    return lines.sizes if isinstance(lines, MappedLines) else np.fromiter((len(line) + 1 for line in lines), np.int64, len(lines))


async def told(program: Program, timeline: Timeline, client: DeviceClient, identity: Identity) -> str:
    """What the operator is told of it when a job starts, '' where there is nothing to tell. client : of the laser"""
    dead_man_s = client.device.dead_man_s

    def find() -> LeftInLight | None:
        return left_in_light(
            timeline, program.table["kind"], sizes_of(program.lines), np.flatnonzero(timeline.stops), identity, dead_man_s,
            is_stream_gated=program.gate == "stream",
        )  # fmt: skip

    found = find() if len(program.lines) < QUICK_LINES else await asyncio.to_thread(find)
    return found.text(dead_man_s) if found is not None else ""
