"""One connection to the pool's scheduler: from when it opens until it breaks, with what machines there are."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import msgspec

from cellctl.planning.pool import far
from cellctl.planning.pool.order import Away, Machine, Order, OrderError, as_json, resource_of
from cellctl.planning.pool.wire import PoolWire

CONNECT_S = 10.0
CALL_S = 60.0  # for one message to a machine and its answer
LOOK_S = 1.0  # between two looks at the machines of the pool
CLOSE_S = 5.0
MACHINES_NAMED = 3  # in a sentence


class Gone(Exception):
    """The scheduler was lost. What it had in work is to be sent again."""


class Connection:
    """Made by `connected`. machines : by address, as of the last look   software, version : of the service"""

    def __init__(self, client: Any, wire: PoolWire, software: str, version: str) -> None:
        self._client, self._wire = client, wire
        self.software, self.version = software, version
        self.machines: dict[str, Machine] = {}

    @classmethod
    async def opened(
        cls, wire: PoolWire, software: str, version: str, topic: str, hear: Callable[[dict[str, Any]], None]
    ) -> Connection:
        """Connect. hear : told what machines tell under the topic.  Raises OSError, TimeoutError."""
        import distributed

        make: Any = distributed.Client
        client = make(
            wire.address, asynchronous=True, security=wire.security(), timeout=CONNECT_S, set_as_default=False, name="cellctl"
        )
        try:
            await asyncio.wait_for(client, 2 * CONNECT_S)
            client.subscribe_topic(topic, lambda event: hear(event[1]))
            opened = cls(client, wire, software, version)
            await opened.look()
        except BaseException:
            await _closed(client)
            raise
        return opened

    async def close(self) -> None:
        """Let go: the scheduler takes what was sent off its list."""
        await _closed(self._client)

    async def look(self) -> None:
        """See which machines there are. Raises OSError, TimeoutError when the scheduler is gone."""
        if self._client.status != "running":
            raise ConnectionResetError("the connection broke")
        seen = await asyncio.wait_for(self._client.scheduler.identity(n_workers=-1), CALL_S)
        told = {address: worker.get("cellctl") for address, worker in seen["workers"].items()}
        self.machines = {address: msgspec.convert(facts, Machine) for address, facts in told.items() if facts}

    @property
    def fitting(self) -> list[Machine]:
        """Machines with the software of the service."""
        return [machine for machine in self.machines.values() if machine.software == self.software]

    @property
    def places(self) -> int:
        """How many tasks all fitting machines take at once."""
        return sum(machine.places for machine in self.fitting)

    @property
    def why_none(self) -> str:
        """Why no machine takes a task; "" if some do."""
        if self.fitting:
            return ""
        if not self.machines:
            return f"no planning machine is in the pool of {self._wire.address}: start `cellctl planner-worker {self._wire.address}` on one"
        others = [f"{one.name} has {one.version} ({one.software[:12]})" for one in list(self.machines.values())[:MACHINES_NAMED]]
        more = f" and {len(self.machines) - MACHINES_NAMED} more" if len(self.machines) > MACHINES_NAMED else ""
        return (
            f"no planning machine has this service's software {self.version} ({self.software[:12]}): {', '.join(others)}{more}; "
            "install the same version on them"
        )

    def submit(self, order: Order) -> Any:
        """Send an order; a future that can be awaited and cancelled."""
        return self._client.submit(
            far.carry_out, as_json(order), key=order.key, resources={resource_of(order.software): 1}, retries=0, pure=False
        )

    async def call(self, function: Callable[..., Any], *args: Any, at: str) -> Any:
        """The answer of a function of `far` at a machine. Raises Away if it cannot be reached, OrderError."""
        try:
            answers = await asyncio.wait_for(self._client.run(function, *args, workers=[at]), CALL_S)
        except (ConnectionError, TimeoutError) as error:
            raise Away(f"{at} does not answer: {error}") from None
        except OSError as error:
            if error.errno is None:  # dask's own: the machine cannot be reached
                raise Away(f"{at} does not answer: {error}") from None
            raise OrderError(f"the planning machine {self.machines[at].name if at in self.machines else at}: {error.strerror}") from None
        return answers[at]


async def _closed(client: Any) -> None:
    with suppress(TimeoutError, OSError):
        await asyncio.wait_for(client.close(timeout=CLOSE_S), 2 * CLOSE_S)
