"""A WebSocket passed on to another cell's host: messages both ways, each side as fast as the other takes them; its close closes the other's."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Any

from starlette.types import Receive, Scope, Send
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus, WebSocketException

from cellctl.api.forward_headers import unreachable
from cellctl.api.forward_lanes import CONNECT_S, Lanes
from cellctl.api.neighbours import Host
from cellctl.api.problems import ApiError
from cellctl.domain.forwarded import HEADER

OPEN_S = 2 * CONNECT_S
CLOSE_S = 2.0
SEND_S = 30.0  # a side that takes a message no sooner is given up
PING_S = 20.0
MESSAGE_BYTES = 4 << 20  # far above a snapshot or a job
QUEUED = 16
BAD_GATEWAY = 1014
GONE_AWAY = 1001
OF_HANDSHAKE = (b"sec-websocket-", b"content-length")


async def joined(
    host: Host, target: str, headers: list[tuple[bytes, bytes]], lanes: Lanes, scope: Scope, receive: Receive, send: Send
) -> None:
    """Join both ends until one of them closes. Raises ApiError before the person's end is accepted."""
    assert (await receive())["type"] == "websocket.connect"
    far = await _opened(host, target, headers, lanes)
    try:
        await send({"type": "websocket.accept"})
        works = [asyncio.create_task(_to_person(far, send)), asyncio.create_task(_to_cell(far, receive))]
        try:
            await asyncio.wait(works, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for work in works:
                work.cancel()
            await asyncio.gather(*works, return_exceptions=True)
    finally:
        await far.close(GONE_AWAY)


async def _opened(host: Host, target: str, headers: list[tuple[bytes, bytes]], lanes: Lanes) -> ClientConnection:
    """The connection to the cell's host. Raises ApiError."""
    scheme, _, place = host.url.partition("://")
    kept = [(name.decode("latin-1"), value.decode("latin-1")) for name, value in headers if name != b"host" and not name.startswith(OF_HANDSHAKE)]
    secure: dict[str, Any] = {"ssl": lanes.tls_of(host)} if scheme == "https" else {}
    try:
        far = await connect(
            f"{'wss' if secure else 'ws'}://{place}{target}", additional_headers=kept, user_agent_header=None, compression=None, proxy=None,
            open_timeout=OPEN_S, close_timeout=CLOSE_S, ping_interval=PING_S, ping_timeout=PING_S, max_size=MESSAGE_BYTES, max_queue=QUEUED,
            process_exception=lambda error: error, **secure,
        )  # fmt: skip
    except InvalidStatus as error:
        raise ApiError(403, "Not allowed", f"{host.cell} refuses the live feed ({error.response.status_code})", "sign in") from None
    except TimeoutError:
        raise unreachable(host, "no answer in time", 504) from None
    except (OSError, InvalidHandshake, WebSocketException) as error:
        raise unreachable(host, f"the connection was not made ({type(error).__name__})") from None
    if far.response is None or HEADER not in far.response.headers:
        await far.close(GONE_AWAY)
        raise unreachable(host, "it does not take this host's word for whom a request is of: it is no host of this house, or has just started")
    return far


async def _to_person(far: ClientConnection, send: Send) -> None:
    code = BAD_GATEWAY
    try:
        async for message in far:
            async with asyncio.timeout(SEND_S):
                await send({"type": "websocket.send", "text" if isinstance(message, str) else "bytes": message})
        code = far.close_code or GONE_AWAY
    except ConnectionClosed as error:
        code = error.rcvd.code if error.rcvd is not None else BAD_GATEWAY
    except TimeoutError:
        code = GONE_AWAY
    with suppress(TimeoutError, OSError, RuntimeError):
        async with asyncio.timeout(SEND_S):
            await send({"type": "websocket.close", "code": code})


async def _to_cell(far: ClientConnection, receive: Receive) -> None:
    with suppress(ConnectionClosed, TimeoutError):
        while (message := await receive())["type"] != "websocket.disconnect":
            async with asyncio.timeout(SEND_S):
                await far.send(message["text"] if message.get("text") is not None else message["bytes"])
