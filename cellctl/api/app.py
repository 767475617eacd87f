"""The web application: routes, middleware, and the tasks that live as long as it does."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI
from starlette.routing import Mount

from cellctl.api import (
    alarms,
    audit_trail,
    cell,
    consumables,
    drawings,
    estimates,
    facts,
    fleet,
    hand,
    health,
    job_life,
    job_threads,
    jobs,
    live,
    measured,
    openapi,
    parts,
    problems,
    queues,
    record,
    results,
    resumption,
    session,
    sign_in,
    tokens,
    trends,
    uploads,
    users,
    webhooks,
)
from cellctl.api.cell_link import CellLink
from cellctl.api.conditional import Conditional
from cellctl.api.context import Service, Settings
from cellctl.api.feed import Feed
from cellctl.api.fleet_keeper import FleetKeeper
from cellctl.api.fleet_telling import told_of
from cellctl.api.forward_stop import Round
from cellctl.api.forwarding import Forwarding
from cellctl.api.metrics import Measure, Metrics
from cellctl.api.page import Page
from cellctl.api.page_hosts import PageHosts
from cellctl.api.runs import Runs
from cellctl.api.security import BodyLimit, Guard
from cellctl.api.stop_trail import StopTrail
from cellctl.api.trend_keeper import TrendKeeper
from cellctl.api.vouched import Vouched
from cellctl.api.webhook_delivery import Deliveries
from cellctl.domain.messages import Event
from cellctl.domain.snapshot import Snapshot
from cellctl.planning.jobwork import JobWork
from cellctl.planning.keys import software_version
from cellctl.planning.pool.near import Pool
from cellctl.planning.previews import Previews
from cellctl.planning.process import Workers
from cellctl.planning.queue import PlanningQueue
from cellctl.planning.standing_cell import StandingCell
from cellctl.store import StoreError, open_store
from cellctl.store.fleet import Seat
from cellctl.store.owner import owner_of
from cellctl.store.tokens import Role
from config import load_cell

# In the order in which a path is looked for.
ROUTES = (
    session,
    parts,
    uploads,
    estimates,
    jobs,
    job_life,
    job_threads,
    queues,
    resumption,
    drawings,  # before results, whose /program/{name} would take its paths
    results,
    alarms,
    trends,
    record,
    consumables,
    webhooks,
    hand,
    measured,
    cell,
    fleet,
    facts,
    users, tokens, audit_trail,
    health,
    live,
)

DESCRIPTION = """Parts go in, plans are made and proved, a person approves, the cell builds.

Errors are problem documents (RFC 9457). Lists come in pages: pass `next` on as `cursor`. Times are Unix seconds.
Every POST that makes something takes an `Idempotency-Key`: sent again it makes nothing twice. What is read carries an `ETag`:
`If-None-Match` saves the body, `If-Match` at a change refuses one that was decided on an older state. What happens comes as server-sent
events at `/api/v1/events/stream` (`Last-Event-ID`) and as a WebSocket at `/api/v1/live?from=N&jobs_from=M`:
`{"type": "snapshot", "snapshot": …}` (newest wins), `{"type": "event", "event": …}` (in order) and `{"type": "job", "job": …}`.

Where cells share a store, this whole interface of another cell is at `/cells/NAME/api/v1/…`; `/api/v1/fleet` names the cells."""


def build_service(settings: Settings) -> Service:
    """Open the store and put the parts of the service together. Raises StoreError (LeaseHeldError: another service runs the cell), ConfigError."""
    served = load_cell(settings.cell_file)
    store = open_store(settings.store)
    facts.see_what_is_shipped(store, served, str(settings.cell_file))
    standing = StandingCell(settings.cell_file, store)
    seat = Seat(standing.cell.name, owner_of(settings.store))
    scratch = settings.store / "scratch"
    scratch.mkdir(exist_ok=True)
    workers = Workers(scratch, settings.worker_memory_bytes, settings.planning_slots)
    feed = Feed()
    stops = StopTrail(store, standing.cell.name)
    runs: Runs
    pages: PageHosts

    def on_snapshot(snapshot: Snapshot) -> None:
        feed.take_snapshot(snapshot)

    def on_event(event: Event) -> None:
        feed.take_event(event)
        stops.take(event)
        runs.wake()

    def on_connect() -> None:
        feed.look_in_store()
        runs.wake()
        pages.tell_again()

    link = CellLink(settings.run / "cell.sock", on_snapshot, on_event, on_connect)
    pages = PageHosts(link)
    runs = Runs(store, link, feed.take_job, standing.cell.by_hand, seat)
    pool = None
    if settings.pool is not None:
        pool = Pool(settings.pool, store.blobs.folder, scratch, software_version())
    work = JobWork(store, pool or workers, standing.cell, standing.file, seat, changed=feed.take_job)
    queue = PlanningQueue(store, work, feed.take_job)
    if pool is not None:
        pool.changed = queue.wake
    previews = Previews(settings.worker_memory_bytes)
    keeper = FleetKeeper(store, lambda: told_of(settings, standing, link, seat), queue, feed.take_job)
    try:
        keeper.take()
    except StoreError:
        store.close()
        raise
    return Service(
        settings, standing, store, workers, feed, link, queue, runs, asyncio.Semaphore(1), Metrics(), previews, keeper, pages, stops, pool
    )


def make_app(service: Service, bound_host: str, page: Page | None = None) -> FastAPI:
    """The ASGI application around a service."""
    page = page or Page()

    @asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        service.store.blobs.clear_staging()
        keeper = TrendKeeper(service.store)
        own = (service.link.run(), service.queue.run(), service.runs.run(), service.fleet.run(), service.presence.run(service.store))
        letters = Deliveries(service.store, service.cell.name)
        house = (service.neighbours.run(), service.page_hosts.run(), service.stops.run())
        running = (*own, *house, uploads.sweep_now_and_then(service), keeper.run(), service.keeping.run(), letters.run())
        tasks = [asyncio.create_task(task) for task in running]
        if service.pool is not None:
            tasks.append(asyncio.create_task(service.pool.keep()))
        service.turnstile.warm()
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await service.previews.close()
            await service.deeds.close()
            await forwarding.lanes.close()
            service.turnstile.close()
            await asyncio.to_thread(service.fleet.leave)
            service.store.close()

    app = FastAPI(
        title="Hybrid metal cell",
        version=software_version(),
        description=DESCRIPTION,
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
        generate_unique_id_function=openapi.name_of,
    )
    app.state.service = service
    problems.install(app)
    for module in ROUTES:
        app.include_router(module.router)
    forwarding = Forwarding(app, service.neighbours, lambda: service.store.clock(), page.of_cell, Round(service))
    app.router.routes.append(Mount("/cells", app=forwarding))
    app.include_router(page.router)
    app.add_middleware(Conditional)
    app.add_middleware(
        BodyLimit,
        upload_limit_bytes=service.settings.upload_limit_bytes,
        resumable_limit_bytes=service.settings.resumable_limit_bytes,
        may_upload=lambda connection: sign_in.is_let_in(connection, service, Role.OPERATOR),
    )
    app.add_middleware(Vouched, neighbours=service.neighbours, clock=lambda: service.store.clock(), on_page=service.page_hosts.seen)
    app.add_middleware(Measure, metrics=service.metrics)
    app.add_middleware(Guard, bound_host=bound_host, stop_url=service.stop_url, script_hashes=page.script_hashes, names=service.names)
    openapi.document_whole(app)
    return app
