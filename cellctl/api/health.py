"""/healthz, /readyz and /metrics."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import JSONResponse, Response
from prometheus_client import CONTENT_TYPE_LATEST

from cellctl.api.models import Health
from cellctl.api.sign_in import ServiceOf
from cellctl.store import jobs

router = APIRouter(tags=["health"])


@router.get("/healthz")
def healthz() -> dict[str, str]:
    """The web process answers."""
    return {"status": "ok"}


@router.get("/readyz", response_model=Health, responses={503: {"model": Health}})
def readyz(service: ServiceOf) -> JSONResponse:
    """The web process, its store and the cell process work together."""
    with service.store.read() as rows:
        jobs.count_by_state(rows)
    snapshot = service.link.fresh
    health = Health(
        status="ok" if snapshot else "the cell process does not answer",
        cell=snapshot is not None,
        cell_state=snapshot.state if snapshot else "",
        snapshot_age_s=round(service.link.age_s, 3) if service.link.snapshot else None,
    )
    return JSONResponse(health.model_dump(), 200 if snapshot else 503)


@router.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
def metrics(service: ServiceOf) -> Response:
    """Figures for Prometheus."""
    return Response(service.metrics.collect(service), media_type=CONTENT_TYPE_LATEST)
