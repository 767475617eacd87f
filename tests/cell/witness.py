"""What the plant itself saw: light at standstill, light behind an unsafe level, which lines burnt, which lines the machine took."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from sim.trace import Trace
from sim.world import World
from tests.cell.faults.row import bound_s

DARK_W = 10.0  # about 1 % of the power: tail of the laser's ramp
NUMBER_WORD = re.compile(r"N(\d+)")
DEPOSITING_TOOLS = (1,)
LEVELS: dict[str, Callable[[World], bool]] = {
    "door": lambda world: world.io.door_closed,
    "estop": lambda world: world.io.estop_ok,
    "chiller": lambda world: world.io.chiller_ok,
    "gas": lambda world: world.io.gas_pressure_ok,
    "fume": lambda world: world.io.fume_extraction_ok,
    "laser": lambda world: not world.laser.faults and not world.laser.fibre_is_open,
    "feeder": lambda world: not world.feeder.faults,
}
"""Contacts and devices as they really are: whether each is safe."""


class PlantWitness:
    """Sees every piece of motion of a world. All times are of the wires (s)."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.max_standstill_emission_w = 0.0
        self.standstill_s = 0.0  # light at standstill, longest in one go
        self._standing_s = 0.0
        self.burnt_lines: set[int] = set()
        self.last_lit_at = -1.0
        self.unsafe_since: dict[str, float] = {}
        self.unsafe_lit_s: dict[str, float] = {}  # longest that light stayed behind an unsafe level
        self.unguarded = ""  # light with the wrong tool or with the head parked, in words
        self.parked_lit_s = 0.0  # longest that light stayed with the head parked
        self._parked_since: float | None = None
        self._unheard_at = -math.inf  # when the coupler could last not be heard
        self._hidden_s = bound_s("io", world.cell)
        io = world.cell.links["io"]
        sharing = [role for role, link in world.cell.links.items() if link.transport == "rtu" and link.serial_port == io.serial_port]
        self._line = sharing if io.transport == "rtu" else ["io"]
        self.taken: list[int] = []  # N-words of lines that the machine took, in their order
        world.metal = self
        self._watch_lines()

    def _watch_lines(self) -> None:
        firmware = self._world.cnc
        begin = firmware._take

        def take(line: str) -> None:
            said = len(firmware.transmitter._bytes)
            begin(line)
            number = NUMBER_WORD.match(line)
            if number and b"error" not in firmware.transmitter._bytes[said:]:
                self.taken.append(int(number[1]))

        firmware._take = take  # type: ignore[method-assign]

    def apply(self, trace: Trace) -> None:
        """Take in the pieces of a step. The world calls this when its time has gone on."""
        world = self._world
        end = world.wire_time_s
        if not self._is_heard():
            self._unheard_at = end
        if not world.io.is_parked:
            self._parked_since = None
        elif self._parked_since is None:
            self._parked_since = end
        is_lit = trace.emission_w > DARK_W
        if not is_lit.any():
            if trace.dt.any():
                self._standing_s = 0.0
            self._note_levels(end, False)
            return
        scale = world.time_scale
        still = (np.abs(trace.tip1 - trace.tip0).max(axis=1) == 0.0) & is_lit
        for k in np.flatnonzero(trace.dt > 0.0):
            if still[k]:
                self._standing_s += float(trace.dt[k]) / scale
                self.standstill_s = max(self.standstill_s, self._standing_s)
                self.max_standstill_emission_w = max(self.max_standstill_emission_w, float(trace.emission_w[k]))
            else:
                self._standing_s = 0.0
        self.burnt_lines.update(trace.line[is_lit].tolist())
        self.last_lit_at = end - float(trace.dt[int(np.flatnonzero(is_lit)[-1]) + 1 :].sum()) / scale
        if trace.tool not in DEPOSITING_TOOLS:
            self.unguarded = f"light with tool {trace.tool}"
        self._note_parked(self.last_lit_at)
        self._note_levels(end, True)

    def _note_parked(self, lit_at: float) -> None:
        """Light at wire time `lit_at` (s) with a parked head. A coupler that cannot be heard hides its contacts until the first goes stale."""
        if self._parked_since is None or lit_at < self._parked_since:
            return
        lit_s = lit_at - self._parked_since
        self.parked_lit_s = max(self.parked_lit_s, lit_s)
        allowed_s = self._hidden_s if lit_at - self._unheard_at < self._hidden_s else 0.0
        if lit_s >= allowed_s:
            self.unguarded = f"light {1000 * lit_s:.0f} ms after the head was parked, bound {1000 * allowed_s:.0f}"

    def _is_heard(self) -> bool:
        """Whether the coupler's line is as it should be, its other devices included."""
        wires = [self._world.wires[role] for role in self._line]
        return not any(w.is_silent or w.is_gone or w.delay_s or w.exception or w.extra_count or w.late_answers for w in wires)

    def _note_levels(self, now: float, is_lit: bool) -> None:
        for name, is_safe in LEVELS.items():
            if is_safe(self._world):
                self.unsafe_since.pop(name, None)
            elif name not in self.unsafe_since:
                self.unsafe_since[name] = now
            elif is_lit:
                lit_s = self.last_lit_at - self.unsafe_since[name]
                self.unsafe_lit_s[name] = max(self.unsafe_lit_s.get(name, 0.0), lit_s)

    def breaks_in_lines(self) -> list[tuple[int, int]]:
        """Places where the lines that the machine took are not in order: (one line, the line that came behind it)."""
        return [(a, b) for a, b in zip(self.taken, self.taken[1:], strict=False) if b != a + 1]

    def forget(self) -> dict[str, Any]:
        """Begin to look anew, for the next part of a story; what was seen until now."""
        seen = {"standstill_s": self.standstill_s, "unsafe_lit_s": dict(self.unsafe_lit_s)}
        self.standstill_s = self._standing_s = self.max_standstill_emission_w = 0.0
        self.unsafe_lit_s.clear()
        return seen
