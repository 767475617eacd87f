"""Figures for Prometheus: requests by route, the cell's state, set-points and read-backs."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cellctl.store import jobs

if TYPE_CHECKING:
    from cellctl.api.context import Service


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
        if snapshot is not None:
            self.cell_state.labels(snapshot.state).set(1)
            self.laser_w.labels("setpoint").set(snapshot.laser.power_setpoint_w)
            self.laser_w.labels("readback").set(snapshot.laser.power_readback_w)
            self.powder.labels("setpoint").set(snapshot.feeder.rate_setpoint_g_min)
            self.powder.labels("readback").set(snapshot.feeder.rate_readback_g_min)
            for name in ("sent", "acknowledged", "executing", "executed", "total"):
                self.lines.labels(name).set(getattr(snapshot.lines, name))
            self.jitter.set(snapshot.tick.jitter_p99_ms / 1000.0)
            self.missed.set(snapshot.tick.missed)
        return generate_latest(self.registry)


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
