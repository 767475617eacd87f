"""Taking the head back along the tool axis after a fault: at standstill, laser locked, where the position is trusted and the way is free."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

import numpy as np

from cellctl.domain.states import State
from drivers.errors import LinkError

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller

LEAST_MM = 1.0  # a shorter way is not worth a move
TIMEOUT_S = 10.0  # for the whole move
SETTLE_S = 0.15  # a report older than that may be of before the move


class Retract:
    """One retract at a time: wanted by a reaction, advanced by the tick, cancelled by whatever allows no motion."""

    def __init__(self, controller: Controller) -> None:
        self._c = controller
        self._is_wanted = False
        self._sent_at: float | None = None

    @property
    def is_pending(self) -> bool:
        """Whether the head is still to be moved or on its way."""
        return self._is_wanted

    @property
    def is_moving(self) -> bool:
        """Whether the move was sent and has not ended."""
        return self._sent_at is not None

    def want(self) -> None:
        """Take the head back as soon as the machine was reset at standstill. Harmless twice."""
        self._is_wanted = True

    def cancel(self, because: str) -> None:
        """No motion from now on. because : told in an event if a retract was pending."""
        if not self._is_wanted:
            return
        if self._sent_at is not None and self._c.drivers is not None:
            with contextlib.suppress(LinkError):
                self._c.drivers.cnc.jog_cancel()
                self._c.drivers.cnc.hold()
        self._end(f"the head was not taken back: {because}", is_done=False)

    def _end(self, text: str, *, is_done: bool) -> None:
        self._is_wanted = False
        self._sent_at = None
        self._c.event("retract", text, {"done": is_done})

    def advance(self, now: float) -> None:
        """Go as far as the machine allows. Called by every tick of a latched cell, after the machine's standstill was seen to."""
        c = self._c
        if not self._is_wanted or c.drivers is None:
            return
        if c.state is not State.FAULT or not c.is_cnc_alive:
            self.cancel(f"the cell is {c.state.value}")
            return
        status = c.drivers.cnc.status
        if self._sent_at is None:
            if c.run is None and c.quiesce.is_clear and not c.gate.is_awaited:
                self._send(now)
            return
        if status is not None and status.at > self._sent_at + SETTLE_S and status.is_idle:
            self._end("the head was taken back along the tool axis", is_done=True)
        elif now - self._sent_at > TIMEOUT_S:
            self.cancel(f"no end of the move within {TIMEOUT_S:g} s")

    def _send(self, now: float) -> None:
        c = self._c
        assert c.drivers is not None
        status = c.drivers.cnc.status
        if status is None or not status.is_idle:
            self._end(f"the head was not taken back: the CNC is {status.state if status else 'silent'}", is_done=False)
            return
        way = self._way(status.machine, status.tool or 0)
        if not way:
            self._end("the head was not taken back: no travel is left along the tool axis", is_done=False)
            return
        words, feed = way
        try:
            c.drivers.cnc.enqueue(f"$J=G91 G21 {words} F{feed:.0f}")
            c.drivers.cnc.query_status()
        except LinkError as error:
            self._end(f"the head was not taken back: {error.message}", is_done=False)
            return
        self._sent_at = now

    def _way(self, machine: dict[str, float], tool: int) -> tuple[str, float] | None:
        """Axis words (mm) and feed (mm/min) of the longest way along the tool axis that the travels leave; None if there is none.

        The tip moves with the linear joints alone, so its displacement is linear in theirs.
        """
        cell = self._c.cell
        linear = [axis for axis in cell.axes if axis.kind == "linear"]
        tip, axis_of_tool = self._c.tips.find(machine, tool)
        columns = []
        for axis in linear:
            moved, _ = self._c.tips.find({**machine, axis.letter: machine.get(axis.letter, 0.0) + 1.0}, tool)
            columns.append(np.subtract(moved, tip))
        step, *_ = np.linalg.lstsq(np.array(columns).T, np.array(axis_of_tool), rcond=None)
        length = cell.limits.retract_mm
        for axis, share in zip(linear, step, strict=True):
            at = machine.get(axis.letter, 0.0)
            if abs(share) > 1e-9:
                length = min(length, ((axis.max if share > 0 else axis.min) - at) / share)
        if length < LEAST_MM:
            return None
        speed = min(axis.max_velocity / abs(share) for axis, share in zip(linear, step, strict=True) if abs(share) > 1e-9)
        words = " ".join(
            f"{axis.letter}{share * length:.3f}" for axis, share in zip(linear, step, strict=True) if abs(share * length) > 5e-4
        )
        return words, 60.0 * speed
