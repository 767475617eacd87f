"""What the scheduler and the link call on a planning machine. dask sends these functions by their names."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from cellctl.planning.pool.order import Order, OrderError

if TYPE_CHECKING:
    from cellctl.planning.pool.machine import PlanningMachine

MACHINE: PlanningMachine | None = None  # the planning machine of this process


def here() -> PlanningMachine:
    """The planning machine of this process. Raises OrderError."""
    if MACHINE is None:
        raise OrderError("this process is no planning machine: start `cellctl planner-worker`")
    return MACHINE


async def carry_out(order: bytes) -> None:
    """Do a task: an Order as JSON. The machine tells of it under the order's topic."""
    await here().carry_out(msgspec.json.decode(order, type=Order))


async def put(run: str, sha256: str, offset: int, data: bytes) -> None:
    """A piece of a file that a task reads."""
    await here().put(run, sha256, offset, data)


async def so_far(run: str) -> bytes:
    """What a task that still runs has finished since it was asked last."""
    return await here().so_far(run)


async def ended(run: str) -> bytes:
    """How a task ended: an End as JSON."""
    return here().ended(run)


async def piece(run: str, name: str, offset: int, size: int) -> bytes:
    """A piece of a result."""
    return await here().piece(run, name, offset, size)


async def taken(run: str) -> None:
    """All results of a task were fetched: it is done."""
    here().taken(run)
