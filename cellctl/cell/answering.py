"""An answer is given once what it tells is durable. A stop is done whatever the store says: its answer does not wait long for it."""

from __future__ import annotations

import asyncio

from cellctl.cell.record import Journal, StoreError
from cellctl.cell.refusal import STORE
from cellctl.domain.messages import Command, Reply

STOP_WRITTEN_S = 0.5  # a stop is answered then, written down or not


async def written(journal: Journal, command: Command, reply: Reply) -> Reply:
    """The reply to give: the same once it is durable; one that says so where it is not yet (what is queued is written later)."""
    is_stop = command.verb == "stop"
    try:
        async with asyncio.timeout(STOP_WRITTEN_S if is_stop else None):
            await journal.durable()
    except TimeoutError:
        return Reply(command.id, reply.ok, reply.error, reply.hint, {**reply.data, "is_written": False}, reply.kind)
    except StoreError as error:
        done = f"{command.verb} was carried out, but is not written down yet: " if reply.ok else ""
        return Reply(command.id, reply.ok and is_stop, f"{done}{error.message}", error.hint, reply.data, STORE)
    return reply
