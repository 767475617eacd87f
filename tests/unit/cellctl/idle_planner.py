"""A planning queue that starts nothing: what is submitted stays so."""

from __future__ import annotations

from dataclasses import replace

from cellctl.api.context import Service
from cellctl.planning.process import Workers


def plan_at_once(service: Service, count: int) -> None:
    """How many jobs the service takes into work at the same time from now on; 0: none."""
    assert isinstance(service.workers, Workers)
    service.queue._work = replace(service.queue._work, workers=replace(service.workers, places=count))
