"""What the journal gets of a run: a sample with every status report, progress, and each layer's beginning."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cellctl.cell.record import PROGRESS, SAMPLE, Sample

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller


class Sampling:
    """Writes down how a run goes. Called by every tick; writes when the machine has told something, or should have."""

    def __init__(self, controller: Controller) -> None:
        self._c = controller
        self._layer = -1
        self._sampled_at = 0.0

    def take(self, now: float) -> None:
        """Journal the run, if there is news, at wire time `now` (s)."""
        c = self._c
        run, drivers = c.run, c.drivers
        if run is None or drivers is None:
            return
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
        laser, feeder = drivers.laser, drivers.feeder
        sample = Sample(
            c.times.unix(), run.job, c.state.value, run.executed, layer, last.arc_mm if last else 0.0,
            laser.power_setpoint_w, laser.power_readback_w, feeder.rate_setpoint_g_min, feeder.rate_readback_g_min,
            (float(tip[0]), float(tip[1]), float(tip[2])),
        )  # fmt: skip
        c.journal.write(SAMPLE, sample.row)
        c.journal.write(PROGRESS, (run.executed, run.job))
