"""Acceleration-limited motion of all axes: planner buffer in, pieces of exact motion out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from config import Axis
from sim.cnc import lookahead as la
from sim.cnc.lookahead import Floats

PIECES = 2048  # rows to begin with; grows with the length of a step


class Motion:
    """The planner buffer and what moves. Positions are machine coordinates in the order of the axes, mm or degrees.

    `pieces` holds the motion since `begin`: rows of duration, outputs, line, end speed, joints from, joints to.
    """

    def __init__(self, axes: Sequence[Axis], capacity: int, start: Sequence[float], junction_deviation_mm: float = 0.01) -> None:
        self.capacity, self.junction_deviation_mm = capacity, junction_deviation_mm
        self.n = len(axes)
        self.limits = np.array(
            [[axis.max_velocity, axis.max_acceleration, float(axis.kind == "rotary")] for axis in axes]
        )
        self._rotary = np.ascontiguousarray(self.limits[:, 2])
        self._blocks = np.zeros((capacity + 1, la.BLOCK_COLUMNS))
        self._state = np.zeros(la.STATE_SIZE)
        self._out = np.zeros((PIECES, la.PIECE_COLUMNS))
        self._row = 0
        self._last_line = 0.0  # N-word of the last motion: what stands after it belongs to it
        self._set_mask = self._clear_mask = 0
        self._is_dirty = False
        self.feed_override = self.rapid_override = 1.0
        self.place(start)

    @property
    def count(self) -> int:
        """Blocks in the buffer, the executing one included."""
        return int(self._state[la.COUNT])

    @property
    def is_full(self) -> bool:
        """Whether a further move has to wait."""
        return self.count >= self.capacity

    @property
    def free(self) -> int:
        """Free blocks (`Bf:` says this)."""
        return self.capacity - self.count

    @property
    def speed(self) -> float:
        """Path speed now, in the norm of all axes."""
        return float(self._state[la.SPEED])

    @property
    def outputs(self) -> int:
        """Digital outputs, one bit each."""
        return int(self._state[la.OUTPUTS])

    @property
    def line(self) -> int:
        """N-word of the executing block, 0 when there is none."""
        return int(self._blocks[int(self._state[la.HEAD]), la.LINE]) if self.count else 0

    @property
    def position(self) -> Floats:
        """(n,) where the axes are."""
        if not self.count:
            return self._state[la.END : la.END + self.n].copy()
        block = self._blocks[int(self._state[la.HEAD])]
        back = block[la.LENGTH] - self._state[la.DISTANCE]
        return np.asarray(block[la.TARGET : la.TARGET + self.n] - block[la.UNIT : la.UNIT + self.n] * back)

    @property
    def velocity(self) -> Floats:
        """(n,) axis velocities now, mm/s or deg/s."""
        if not self.count:
            return np.zeros(self.n)
        block = self._blocks[int(self._state[la.HEAD])]
        return np.asarray(block[la.UNIT : la.UNIT + self.n] * self.speed)

    @property
    def feed_mm_min(self) -> float:
        """Speed in the norm that F uses: linear axes if one moves, else rotary ones."""
        velocity = self.velocity
        linear = float(np.linalg.norm(velocity[self._rotary == 0.0]))
        return 60.0 * (linear if linear > 0.0 else float(np.linalg.norm(velocity)))

    @property
    def pieces(self) -> Floats:
        """(k, PIECE_COLUMNS) motion since `begin`; valid until the next `begin`."""
        return self._out[: self._row]

    def begin(self) -> None:
        """Forget the pieces."""
        self._row = 0

    @property
    def row(self) -> int:
        """How many pieces there are since `begin`."""
        return self._row

    def note_spindle(self, row: int, rpm: float) -> None:
        """Write the spindle's speed beside the pieces from `row` on."""
        self._out[row : self._row, la.PIECE_RPM] = rpm

    def planned_s(self) -> float:
        """Time that the planned blocks would take at their programmed speeds: a lower bound of what they will take."""
        return float(la.planned_s(self._blocks, self._state))

    def planned_before_s(self, line: int) -> float:
        """Time of the planned blocks of lines before one without ramps and corners, overrides as they are: a lower bound of when it begins."""
        return float(la.planned_before_s(self._blocks, self._state, float(line), self.feed_override, self.rapid_override))

    def place(self, position: Sequence[float] | Floats) -> None:
        """Stand at a position with an empty buffer; queued outputs are dropped, outputs keep their level."""
        outputs = self._state[la.OUTPUTS]
        self._state[:] = 0.0
        self._state[la.OUTPUTS] = outputs
        self._state[la.END : la.END + self.n] = position
        self._set_mask = self._clear_mask = 0

    def flush(self) -> Floats:
        """Stop at once and drop everything planned. Returns (n,) by how much the axes coast on while they brake at their limit."""
        velocity, position = self.velocity, self.position
        slowest = 0.0
        if velocity.any():
            slowest = float(np.max(np.abs(velocity) / self.limits[: self.n, 1]))
        self.place(position)
        return velocity * slowest / 2.0

    def output(self, port: int, on: bool, synchronised: bool) -> None:
        """Set a digital output now or with the start of the next move."""
        bit = 1 << port
        if synchronised:
            self._set_mask = self._set_mask | bit if on else self._set_mask & ~bit
            self._clear_mask = self._clear_mask & ~bit if on else self._clear_mask | bit
        else:
            outputs = self.outputs
            self._state[la.OUTPUTS] = float(outputs | bit if on else outputs & ~bit)

    def append(self, target: Sequence[float], kind: int, value: float, line: int) -> None:
        """Plan a straight joint move (actions.Move); one without length is none."""
        goal = np.array(target)
        masks = float(self._set_mask), float(self._clear_mask)
        if la.append(
            self._blocks, self._state, goal, self.limits, self.junction_deviation_mm, kind, value, float(line), *masks
        ):
            self._set_mask = self._clear_mask = 0
            self._is_dirty = True

    def override(self, feed: float, rapid: float) -> None:
        """Factors on programmed feed and on rapid speed, from now on."""
        self.feed_override, self.rapid_override = feed, rapid
        self._is_dirty = True

    def advance(self, dt: float, braking: bool, stop_count: int) -> float:
        """Move for at most dt; returns the time used (lookahead.advance)."""
        if self._is_dirty:
            la.replan(self._blocks, self._state, self.feed_override, self.rapid_override)
            self._is_dirty = False
        used = 0.0
        while True:
            self._row, taken = la.advance(
                self._blocks, self._state, self._out, self._row, self._rotary, dt - used, braking,
                self.feed_override, self.rapid_override, stop_count,
            )  # fmt: skip
            used += taken
            if self._row < len(self._out) - 1:
                break
            self._out = np.concatenate((self._out, np.zeros_like(self._out)))
        if self._row:
            self._last_line = float(self._out[self._row - 1, la.PIECE_LINE])
        if braking:
            self._is_dirty = True  # resumed from a speed that was not planned
        return used

    def wait(self, dt: float, is_timed: bool = False) -> None:
        """Stand still for dt: on the executing line; without one on the last that moved if a dwell or the like is_timed, else on none."""
        if self._row >= len(self._out) - 1:
            self._out = np.concatenate((self._out, np.zeros_like(self._out)))
        row = self._out[self._row]
        here = self.position
        row[la.DURATION], row[la.PIECE_OUTPUTS], row[la.PIECE_LINE], row[la.PIECE_SPEED] = (
            dt,
            self.outputs,
            self.line or (self._last_line if is_timed else 0.0),
            0.0,
        )
        row[la.FROM : la.FROM + self.n] = here
        row[la.TO : la.TO + self.n] = here
        row[la.PIECE_PROGRAMMED] = row[la.PIECE_CAP] = row[la.PIECE_RAPID] = 0.0
        self._row += 1
