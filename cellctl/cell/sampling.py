"""What the journal gets: samples and progress of a run with every status report, each layer's beginning; without a run what changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cellctl.cell.figures import TickJitter, figures, interlocks
from cellctl.cell.record import PROGRESS, SAMPLE, Sample
from cellctl.domain.channels import CHANNELS

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller
    from cellctl.cell.stream import Run
    from drivers.cell_wires import CellDrivers

LOOK_S = 1.0  # between two looks while no job runs
STILL_S = 10.0  # a sample at least so often, so that silence in the journal is silence of the cell


class Sampling:
    """Writes down how a run goes, and how the cell stands without one. Called by every tick; never waits."""

    def __init__(self, controller: Controller) -> None:
        self._c = controller
        self._layer = -1
        self._sampled_at = 0.0
        self._looked_at = -LOOK_S
        self._written: Sample | None = None  # without a run: the last that was written
        self._seen: Sample | None = None  # and the last that was looked at
        self.jitter = TickJitter(controller.cell.limits.tick_s)

    def take(self, now: float) -> None:
        """Journal what is news, at wire time `now` (s)."""
        self.jitter.struck(now)
        run, drivers = self._c.run, self._c.drivers
        if drivers is None:
            return
        if run is None:
            if now - self._looked_at >= LOOK_S:
                self._looked_at = now
                self._look(drivers)
        else:
            self._written = self._seen = None
            self._looked_at = now - LOOK_S  # the first tick behind the run is looked at
            self._of_run(run, drivers, now)

    def _of_run(self, run: Run, drivers: CellDrivers, now: float) -> None:
        c = self._c
        status = drivers.cnc.status
        is_told = status is not None and status.at > self._sampled_at
        if not is_told and now - self._sampled_at < 2.0 * c.cell.cnc.status_period_s:
            return
        self._sampled_at = now
        last, layer = run.follower.last, int(run.row["layer"])
        if layer != self._layer:
            self._layer = layer
            text = f"layer {layer + 1} of {len(run.program.layer_starts) - 1}"
            c.event("layer", text, {"layer": layer, "line": run.line})
        tip = run.timeline.tip_at(last.line, last.fraction)[0] if last else run.timeline.tip_end[0]
        sample = Sample(
            c.times.unix(), run.job, c.state.value, run.executed, layer, last.arc_mm if last else 0.0,
            figures(c, drivers, self.jitter.take()), (float(tip[0]), float(tip[1]), float(tip[2])), interlocks(drivers),
        )  # fmt: skip
        c.journal.write(SAMPLE, sample.row)
        c.journal.write(PROGRESS, (run.executed, run.job))

    def _look(self, drivers: CellDrivers) -> None:
        """Without a run: what differs from what was written last, with what was seen just before it, so that a step stays a step."""
        c = self._c
        now = Sample(
            c.times.unix(), "", c.state.value, None, None, None, figures(c, drivers, self.jitter.take()), interlocks=interlocks(drivers)
        )
        written, seen = self._written, self._seen
        self._seen = now
        if written is None or now.at - written.at >= STILL_S or now.at < written.at:
            self._write(now)
        elif differs(written, now):
            if seen is not None and seen is not written:
                self._write(seen)
            self._write(now)

    def _write(self, sample: Sample) -> None:
        self._written = sample
        self._c.journal.write(SAMPLE, sample.row)


def differs(one: Sample, other: Sample) -> bool:
    """Whether the cell stands otherwise: another state or interlock, a figure that changed by its channel's step, came or went."""
    if (one.state, one.interlocks) != (other.state, other.interlocks):
        return True
    for channel, before, after in zip(CHANNELS, one.figures, other.figures, strict=True):
        if before is None or after is None:
            if before is not after:
                return True
        elif abs(after - before) >= channel.step:
            return True
    return False
