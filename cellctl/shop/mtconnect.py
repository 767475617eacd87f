"""The MTConnect process: follows the service, tells agents over SHDR, and answers as an agent over HTTP."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass

import uvicorn

from cellctl.shop.adapter import LINE_MAX, Adapter
from cellctl.shop.agent import Agent
from cellctl.shop.freshness import Known
from cellctl.shop.mirror import Mirror

LOOK_S = 0.1


@dataclass(frozen=True)
class Listening:
    """Where to listen. agent_port : of HTTP; None: no agent of one's own. A port 0 is any free one."""

    host: str
    adapter_port: int
    agent_port: int | None


async def look_for_ever(mirror: Mirror, adapter: Adapter, known: Known) -> None:
    """Look ten times a second what changed, and tell it."""
    while True:
        adapter.tell(mirror.update(known, time.monotonic(), time.time()))
        await asyncio.sleep(LOOK_S)


async def run(known: Known, mirror: Mirror, where: Listening, ready: Callable[[int, int | None], None]) -> None:
    """Serve until cancelled. ready : told the ports. Raises OSError for a port that is taken."""
    adapter = Adapter(mirror, time.time)
    server = await asyncio.start_server(adapter.serve, where.host, where.adapter_port, limit=LINE_MAX)
    looking = asyncio.create_task(look_for_ever(mirror, adapter, known))
    http: uvicorn.Server | None = None
    tasks = [looking]
    try:
        agent_port = None
        if where.agent_port is not None:
            family = socket.AF_INET6 if ":" in where.host else socket.AF_INET
            listener = socket.create_server((where.host, where.agent_port), family=family)
            agent_port = listener.getsockname()[1]
            app = Agent(mirror, time.time).app()
            http = uvicorn.Server(uvicorn.Config(app, log_level="warning", access_log=False, lifespan="off", limit_concurrency=64))
            tasks.append(asyncio.create_task(http.serve([listener])))
        ready(server.sockets[0].getsockname()[1], agent_port)
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        looking.cancel()
        if http is not None:
            http.should_exit = True
        await asyncio.gather(*tasks, return_exceptions=True)
        adapter.close()
        server.close()
