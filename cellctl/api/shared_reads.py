"""Reads of the tables that people share, for those who watch the machine: a shared database that is away stops nobody's view of the cell."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TypeVar

from sqlalchemy.exc import SQLAlchemyError

from cellctl.api.acquaintance import ASKED_S
from cellctl.api.context import Service
from cellctl.domain.trouble import trouble_of

T = TypeVar("T")


class AwayError(Exception):
    """The shared database does not answer now."""


async def read_shared(service: Service, work: Callable[[], T]) -> T:
    """What `work` reads, in a thread. Raises AwayError within ASKED_S where the store is shared and its database does not answer."""
    if not service.store.is_shared:
        return await asyncio.to_thread(work)
    seen = service.acquaintance
    if seen.is_away:
        raise AwayError
    asked = asyncio.ensure_future(asyncio.to_thread(work))
    asked.add_done_callback(lambda late: late.exception() if not late.cancelled() else None)
    await asyncio.wait({asked}, timeout=ASKED_S)
    if not asked.done():  # its thread ends with the connection's own time-out
        seen.went_away()
        raise AwayError
    try:
        return asked.result()
    except SQLAlchemyError as error:
        if trouble_of(error) is None:
            raise
        seen.went_away()
        raise AwayError from None
