"""Figures for Prometheus: requests by route, the cell's state, set-points and read-backs."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cellctl.domain.snapshot import Snapshot
from cellctl.store import jobs

if TYPE_CHECKING:
    from cellctl.api.context import Service


INTERLOCKS = ("estop_ok", "door_closed", "chiller_ok", "gas_pressure_ok", "fume_extraction_ok")


class Metrics:
    """All figures of one web process."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.requests = Counter(
            "cellctl_http_requests", "Requests", ["method", "route", "status"], registry=self.registry
        )
        self.seconds = Histogram("cellctl_http_request_seconds", "Time to answer", ["route"], registry=self.registry)
        self.viewers = Gauge("cellctl_live_viewers", "Open live feeds", registry=self.registry)
        self.jobs = Gauge("cellctl_jobs", "Jobs by state", ["state"], registry=self.registry)
        self.cell_up = Gauge("cellctl_cell_up", "1: the cell process answers", registry=self.registry)
        self.cell_state = Gauge(
            "cellctl_cell_state", "1 for the state that the cell is in", ["state"], registry=self.registry
        )
        self.laser_w = Gauge("cellctl_laser_watts", "Laser power", ["kind"], registry=self.registry)
        self.powder = Gauge("cellctl_powder_grams_per_minute", "Powder rate", ["kind"], registry=self.registry)
        self.lines = Gauge("cellctl_program_lines", "Lines of the running program", ["count"], registry=self.registry)
        self.jitter = Gauge("cellctl_tick_jitter_p99_seconds", "Jitter of the safety tick", registry=self.registry)
        self.missed = Gauge("cellctl_tick_missed", "Safety ticks that came too late", registry=self.registry)

        self.gas = Gauge("cellctl_gas_litres_per_minute", "Gas flow", ["gas", "kind"], registry=self.registry)
        self.speed = Gauge("cellctl_tip_speed_metres_per_second", "Speed of the tip over the table", registry=self.registry)
        self.hopper = Gauge("cellctl_hopper_ratio", "Powder left in the hopper", registry=self.registry)
        self.age = Gauge("cellctl_reading_age_seconds", "Age of the oldest reading of a device", ["device"], registry=self.registry)
        self.interlock = Gauge("cellctl_interlock_safe", "1: the interlock is at its safe level", ["interlock"], registry=self.registry)
        self.alarms = Gauge("cellctl_active_alarms", "Latched alarms", registry=self.registry)
        self.progress = Gauge("cellctl_job_progress_ratio", "Progress of the job on the cell; 0 without one", registry=self.registry)
        self.remaining = Gauge("cellctl_job_remaining_seconds", "Predicted time to the end of the job on the cell", registry=self.registry)

    def collect(self, service: Service) -> bytes:
        """The text for Prometheus."""
        self.viewers.set(len(service.feed))
        with service.store.read() as rows:
            counts = jobs.count_by_state(rows)
        self.jobs.clear()
        for state, count in counts.items():
            self.jobs.labels(state).set(count)
        self.cell_state.clear()
        snapshot = service.link.fresh
        self.cell_up.set(snapshot is not None)
        if snapshot is None:
            self._forget()
        else:
            self._take(snapshot)
        return generate_latest(self.registry)

    def _forget(self) -> None:
        """The cell does not answer: what it said last says nothing about now."""
        for told in (self.laser_w, self.powder, self.gas, self.lines, self.age, self.interlock):
            told.clear()
        for figure in (self.speed, self.hopper, self.alarms, self.progress, self.remaining, self.jitter, self.missed):
            figure.set(float("nan"))

    def _take(self, snapshot: Snapshot) -> None:
        """What the cell says about itself."""
        laser, feeder, lines, job = snapshot.laser, snapshot.feeder, snapshot.lines, snapshot.job
        self.cell_state.labels(snapshot.state).set(1)
        self.laser_w.labels("setpoint").set(laser.power_setpoint_w)
        self.laser_w.labels("readback").set(laser.power_readback_w)
        self.powder.labels("setpoint").set(feeder.rate_setpoint_g_min)
        self.powder.labels("readback").set(feeder.rate_readback_g_min)
        for gas in ("carrier", "shield"):
            for kind in ("setpoint", "readback"):
                self.gas.labels(gas, kind).set(getattr(feeder, f"{gas}_gas_{kind}_l_min"))
        self.hopper.set(feeder.hopper_fraction)
        self.speed.set(snapshot.tip_speed_mm_s / 1000.0)
        for name in ("sent", "acknowledged", "executing", "executed", "total"):
            self.lines.labels(name).set(getattr(lines, name))
        for name in ("laser", "feeder", "io", "cnc"):
            self.age.labels(name).set(getattr(snapshot, name).age_s)
        for name in INTERLOCKS:
            self.interlock.labels(name).set(getattr(snapshot.io, name))
        self.alarms.set(len(snapshot.alarms))
        is_on = job is not None and not job.outcome
        self.progress.set(job.progress if job is not None and is_on else 0.0)
        self.remaining.set(job.remaining_s if job is not None and is_on else 0.0)
        self.jitter.set(snapshot.tick.jitter_p99_ms / 1000.0)
        self.missed.set(snapshot.tick.missed)


class Measure:
    """ASGI middleware: counts and times requests by route."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self.app = app
        self.metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, and look at the clock."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        started, status = time.perf_counter(), 500

        async def watch(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self.app(scope, receive, watch)
        finally:
            route: Any = scope.get("route")
            name = getattr(route, "path", None) or "other"
            self.metrics.requests.labels(scope["method"], name, str(status)).inc()
            self.metrics.seconds.labels(name).observe(time.perf_counter() - started)
